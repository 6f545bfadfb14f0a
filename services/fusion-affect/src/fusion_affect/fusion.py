"""Everything fusion-affect knows, and the states that follow from it at every grid point; pure."""

from bisect import insort
from collections import deque
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from functools import partial
from operator import itemgetter

from sense4hri.names import StreamName

from fusion_affect.align import JUMP_NS, ClockModel, Grid
from fusion_affect.faces import Faces
from fusion_affect.heart_rate import Baselines, combine
from fusion_affect.held import Held
from fusion_affect.persons import People, match, newest_person_ids
from fusion_affect.state import Expression, State, confidence, extra, indicators, missing
from fusion_affect.streams import Rate, Streams, live_humans
from fusion_affect.tree import Tree, decide

MOST_NEWS = 1000


@dataclass(frozen=True)
class _Input:
    """One input with a stamp. put: what it does. moves: it moves time on. awaited: states wait for its source."""

    source: str
    stamp_ns: int
    put: Callable[[], object]
    awaited: bool = False
    moves: bool = True


class Fusion:
    """Inputs go in in any order, each with its stamps in ROS time; `due` gives the states that can be computed now.

    on_news(): called where more may be due than before.
    """

    def __init__(
        self,
        tree: Tree,
        heart_rate_source: str = "auto",
        baseline_s: float = 0.0,
        on_news: Callable[[], None] = lambda: None,
    ) -> None:
        self._tree, self._source, self._baseline_s, self._on_news = tree, heart_rate_source, baseline_s, on_news
        self._persons: dict[str, frozenset[str]] = {}
        self._face_of: dict[str, str] = {}
        self._alias_of: dict[str, str] = {}
        self._assigned: dict[str, str] = {}
        self._assigned_ns = 0  # from when on the newest of them holds
        self._computed: set[str] = set()  # sources that somebody computes, also before they have spoken
        self.unstamped_expressions = 0
        self._cut_ns: int | None = None  # where the next session begins, until it has begun
        self._held: Held[_Input] = Held()  # of the next session already
        self._news: deque[tuple[int, Callable[[], None]]] = deque()  # who is who, and from when on
        self._begin()

    def cut_at(self, start_ns: int) -> None:
        """Begin afresh with the first input stamped start_ns or later: what was before counts no more after it.

        Streams, faces, expressions and the resting baseline are learnt anew, from what is stamped start_ns or later
        alone, whenever it comes; who is who (persons, aliases, assignments) stays, for that has no time.
        """
        self._cut_ns = start_ns

    def _begin(self, floor_ns: int = 0) -> None:
        """Forget all that has a time: at the start, at a session's, and where time has stepped back.

        floor_ns: what is stamped before it is left out from now on.
        """
        self._floor_ns = floor_ns
        self._grid = Grid(floor_ns, self._computed)
        self._streams = Streams()
        self._faces = Faces(self._tree.limits)
        self._waiting: dict[str, Expression] = {}
        self._baselines = Baselines(self._baseline_s)

    # --- what sensors say

    def rate(self, name: StreamName, source: str, rate: Rate, receipt_ns: int, device_ns: int = 0) -> None:
        """A heart rate from `features` or `device`, as old as the newest sample in it, on corrected time."""

        if receipt_ns:  # the contract demands this stamp; without it nothing can be said of when
            put = partial(self._rate_at, name, source, rate, receipt_ns, device_ns)
            self._take(_Input(f"{name} {source}", receipt_ns, put, awaited=source == "features"))

    def features_offered(self, name: StreamName) -> None:
        """Somebody computes the features of a stream: states wait for the first ones too."""
        self._computed.add(f"{name} features")
        self._grid.expect(f"{name} features")

    def clock(self, name: StreamName, model: ClockModel) -> None:
        """A clock model holds for what comes after it."""
        self._streams.clock(name, model)

    def health(self, name: StreamName, receipt_ns: int, streaming: bool, ends: bool = False) -> None:
        """Health moves time on, and while its driver is streaming a stream of any type is live, until that ends."""
        if receipt_ns:
            put = partial(self._health_at, receipt_ns, name, streaming, ends)
            self._take(_Input(f"{name} health", receipt_ns, put))

    def vanished(self, name: StreamName, field_: str) -> None:
        """A field of a stream is no longer on the graph; with the last of them the stream is forgotten."""
        self._computed.discard(f"{name} {field_}")
        self._forget(f"{name} {field_}")
        self._streams.vanished(name, field_)
        self._on_news()

    # --- what ROS4HRI says

    def faces(self, face_ids: Iterable[str], stamp_ns: int) -> None:
        """The tracked faces; an unstamped list gets the time of the newest input."""
        time_ns = stamp_ns or self._grid.now_ns
        if time_ns:
            put = partial(self._faces_at, time_ns, frozenset(face_ids))
            self._take(_Input("faces", time_ns, put, moves=bool(stamp_ns)))

    def faces_vanished(self) -> None:
        """Nobody lists faces any more."""
        self._forget("faces")

    def expression(self, face_id: str, expression: Expression, stamp_ns: int, receipt_ns: int = 0) -> None:
        """A face's expression. Unstamped, as real recognisers send it, its receipt counts.

        A receipt that is unknown (0), or far from all stamps, as with a recording played by another player, gives way
        to the stamp of the newest input.
        """
        time_ns = stamp_ns
        if not stamp_ns:
            self.unstamped_expressions += 1
            now_ns = self._grid.now_ns or self._floor_ns
            if not now_ns:
                self._waiting[face_id] = expression
                return
            time_ns = receipt_ns if abs(receipt_ns - now_ns) < JUMP_NS else now_ns
        put = partial(self._expression_at, time_ns, face_id, expression)
        self._take(_Input(f"expression {face_id}", time_ns, put, moves=bool(stamp_ns)))

    def persons(self, topic: str, person_ids: Iterable[str]) -> None:
        """The persons one list (`tracked`, `known`) holds now."""
        held = frozenset(person_ids)
        self._learn(lambda: self._persons.update({topic: held}))

    def person_face(self, person_id: str, face_id: str | None) -> None:
        """The face a person has now, empty = none; None = the person is no longer on the graph."""
        self._learn(lambda: _set(self._face_of, person_id, face_id))

    def alias(self, person_id: str, other_id: str | None) -> None:
        """The person this one was merged into, empty or None = none."""
        self._learn(lambda: _set(self._alias_of, person_id, other_id or None))

    def face_vanished(self, face_id: str) -> None:
        """A face's expression is no longer on the graph."""
        self._forget(f"expression {face_id}")
        self._waiting.pop(face_id, None)
        self._faces.forget(face_id)

    # --- what the study says

    def assignments(self, entries: list[tuple[str, str, int]], stamp_ns: int = 0) -> None:
        """(human_id, person_id, since in ns) of every sensor, from stamp_ns on; what is told later holds later."""
        assigned = newest_person_ids(entries)

        def learn() -> None:
            self._assigned = assigned

        self._assigned_ns = self._learn(learn, max(stamp_ns, self._assigned_ns))

    def marker(self, name: str, human_id: str, stamp_ns: int) -> None:
        """A marker, in time or late; those of a baseline concern one participant, or all where human_id is empty.

        One without a stamp gets the time of the newest input.
        """
        time_ns = stamp_ns or self._grid.now_ns
        if time_ns and name in ("baseline_start", "baseline_end"):
            put = partial(self._mark, time_ns, name, human_id)
            self._take(_Input("markers", time_ns, put, moves=False))

    def _mark(self, stamp_ns: int, name: str, human_id: str) -> None:
        self._baselines.mark(stamp_ns, name, human_id)

    # --- what follows

    def due(self) -> list[State]:
        """The states of every participant with live streams at each grid point that is settled."""
        states = self._states(self._grid.due())
        return states + self._states(self._grid.due()) if self._cut() else states

    def _states(self, times_ns: Iterable[int]) -> list[State]:
        found = []
        for time_ns in times_ns:
            if self._cut_ns is not None and time_ns >= self._cut_ns:
                break  # the session's own
            while self._news and self._news[0][0] <= time_ns:
                self._news.popleft()[1]()
            worn = self._streams.worn(time_ns)
            humans = live_humans(worn, time_ns, self._tree.limits.stream_live_s)
            found += [self._state(human_id, time_ns, humans, worn) for human_id in sorted(humans)]
        return found

    def _learn(self, news: Callable[[], None], from_ns: int = 0) -> int:
        """Who is who holds from from_ns on; where it bears no stamp or one far ahead of all inputs, from the newest.

        What is told before the first state holds for that too: at a start nothing orders it among the inputs. Returns
        from when on it holds.
        """
        now_ns = self._grid.now_ns
        if now_ns is None:
            news()
            return 0
        newest_ns = now_ns if self._grid.begun else min(now_ns, self._grid.next_ns)
        time_ns = from_ns if 0 < from_ns < now_ns + JUMP_NS else newest_ns
        insort(self._news, (time_ns, news), key=itemgetter(0))
        if len(self._news) > MOST_NEWS:  # no input moves the grid
            self._news.popleft()[1]()
        return time_ns

    def _learn_all(self) -> None:
        """Time is not what it was: whatever is told of who is who holds now."""
        while self._news:
            self._news.popleft()[1]()

    def _state(self, human_id: str, time_ns: int, humans: frozenset[str], worn: Container[tuple[str, str]]) -> State:
        heart_rate = combine(self._streams.readings(human_id, time_ns, worn), self._source, self._tree.limits)
        baseline = self._baselines.of(human_id)
        baseline.learn(time_ns, heart_rate.bpm)
        who = match(human_id, self._people(time_ns, humans))
        seen, problem = self._faces.expression_of(who.face_id, time_ns)
        word = seen.word if seen else ""
        verdict = decide(self._tree, word, heart_rate.bpm, baseline.bpm)
        learnt = (baseline.reason,) if baseline.reason else ()
        graded = indicators(seen, who, heart_rate, baseline.bpm)
        return State(
            time_ns,
            human_id,
            verdict.state,
            confidence(verdict.state, seen, heart_rate),
            who.person_id,
            who.face_id,
            word,
            heart_rate.bpm,
            graded,
            extra(heart_rate, baseline.bpm),
            (who.reason, *problem, *heart_rate.reasons, *learnt, *missing(graded, who), *verdict.path),
        )

    def _people(self, time_ns: int, humans: frozenset[str]) -> People:
        return People(
            humans,
            self._assigned,
            frozenset().union(*self._persons.values()),
            self._face_of,
            self._alias_of,
            self._faces.fresh(time_ns),
        )

    def _rate_at(self, name: StreamName, source: str, rate: Rate, receipt_ns: int, device_ns: int) -> None:
        self._streams.rate(name, source, rate, receipt_ns, device_ns)

    def _health_at(self, time_ns: int, name: StreamName, streaming: bool, ends: bool) -> None:
        if self._streams.health(name, time_ns, streaming, ends) and f"{name} features" in self._computed:
            self._grid.expect(f"{name} features")

    def _faces_at(self, time_ns: int, face_ids: frozenset[str]) -> None:
        self._faces.track(time_ns, face_ids)

    def _expression_at(self, time_ns: int, face_id: str, expression: Expression) -> None:
        self._faces.express(time_ns, face_id, expression)

    def _take(self, given: _Input) -> None:
        """Move time on and put an input where it belongs: to what is now, or to the session that is to begin."""
        self._on_news()
        before_the_cut = given.moves and given.stamp_ns < self._floor_ns - JUMP_NS  # another recording, other sources
        if before_the_cut or self._grid.stepped_back(given.source, given.stamp_ns):  # as when a replay starts over
            self._held.take()
            self._learn_all()
            self._begin_afresh(0)
        if given.stamp_ns < self._floor_ns:
            return
        if given.moves:
            self._grid.saw(given.source, given.stamp_ns, given.awaited)
            waiting, self._waiting = self._waiting, {}
            for face_id, expression in waiting.items():
                self._expression_at(given.stamp_ns, face_id, expression)
        if self._cut_ns is None or given.stamp_ns < self._cut_ns:
            given.put()
        else:
            self._held.put(given.source, given)
            self._cut()

    def _forget(self, source: str) -> None:
        """A source has gone, with what it has said of the session that is to begin."""
        if self._grid.forget(source):  # what bore no stamp got its time
            self._learn_all()
            self._faces = Faces(self._tree.limits)
        self._held.forget(source)

    def _cut(self) -> bool:
        """Begin the session once every grid point before it is done; True where that was now."""
        if self._cut_ns is None or not self._held or self._grid.next_ns < self._cut_ns:
            return False
        self._begin_afresh(self._cut_ns)
        self._cut_ns = None
        for given in self._held.take():
            self._take(given)
        return True

    def _begin_afresh(self, floor_ns: int) -> None:
        """Forget what has a time, but for the clock models."""
        streams = self._streams.afresh()
        self._begin(floor_ns)
        self._streams = streams


def _set(table: dict[str, str], key: str, value: str | None) -> None:
    if value is None:
        table.pop(key, None)
    else:
        table[key] = value
