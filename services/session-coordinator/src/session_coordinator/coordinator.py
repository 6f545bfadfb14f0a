"""The handshake as a state machine: events and the time in, effects out. No ROS, no clock.

    IDLE --start--> PREPARING --all ready--> RECORDING --stop--> STOPPING --all finished--> IDLE
                        |  stop: STOPPING                            |
                        +-- silent, or never ready --> FAILED <------+-- somebody did not finish

Both from IDLE and from FAILED a new session may start.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime

from sense4hri.patterns import Patterns

from session_coordinator.answers import Answers
from session_coordinator.config import Config
from session_coordinator.hindrances import Hindrances
from session_coordinator.request import Request
from session_coordinator.session import ACTIVE, SECOND_NS, Ack, Effect, Note, Now, Outcome, Phase, Publish, Session
from session_coordinator.writers import Writers

DISCOVERY_S = 2.0  # of a fresh coordinator, before it knows who is on the graph
SETTLE_S = 20.0  # of one that goes on with a session, or stood still, before it says that anything has gone
MOST_NAMES = 1000  # of sessions remembered
MOST_SERVICES, MOST_WAITED = 300, 1000  # what everybody can still read, and a restart
LONGEST_LINE, LONGEST_DIRECTORY, LONGEST_DETAIL = 300, 4096, 10_000  # characters


def _line(text: str, longest: int = LONGEST_LINE) -> str:
    return text if len(text) <= longest else f"{text[: longest - 2]}.."


def _refused(message: str) -> Outcome:
    return Outcome(False, "", "", message, [])


class Coordinator:
    """The one session of a study. Every method returns the effects that it has."""

    def __init__(
        self,
        config: Config,
        now: Now,
        session: Session | None = None,
        used: Iterable[str] = (),
        gone_for_s: float = 0.0,
    ) -> None:
        """session, used, gone_for_s: what was kept by the run before, and how long ago that was; NaN: not known."""
        self._config, self._onlookers = config, Patterns(config.ignored_services)
        self.session = session or Session()
        self.used: tuple[str, ...] = tuple(used)
        self._present: dict[str, frozenset[bytes]] = {}
        self._answers = Answers(config.last_services)
        self._hindrances = Hindrances()
        self._writers = Writers(config.last_services)
        self._left: set[str] = set()  # gone while recording, and not back
        self._ill_before: set[str] = set()  # who took no part and was in trouble before the recording began
        self._told: set[str] = set()
        self._began_with: tuple[str, ...] = ()  # who records, of those there when the session was asked for
        self._prepared: set[str] = set()  # who was there when the start was announced, and is still the same process
        self._dirty = True
        self._since_s = self._alone_since_s = now.monotonic_s
        self._knows_graph_at_s = now.monotonic_s + DISCOVERY_S
        self._settled_at_s = now.monotonic_s
        self._resumed = ""
        if self.session.phase in ACTIVE:
            self._began_with = self.recorded_by
            self._resume(now, gone_for_s)

    def _resume(self, now: Now, gone_for_s: float) -> None:
        if gone_for_s > self._config.resume_within_s:
            why = f"session_coordinator was away for {gone_for_s:.0f} s while it was {self.session.phase.name}"
            self.session = replace(self.session, phase=Phase.FAILED, waiting_for=(), detail=f"interrupted: {why}")
            return
        self._settled_at_s = now.monotonic_s + SETTLE_S
        known = not math.isnan(gone_for_s)
        absence = f"for {gone_for_s:.1f} s" if known else "for a time that is not known: the clock was set back"
        self._resumed = f"session_coordinator was away {absence}"

    def woke(self, now: Now) -> None:
        """This process stood still: whom DDS has forgotten meanwhile is found again, and has not gone."""
        self._settled_at_s = now.monotonic_s + SETTLE_S

    @property
    def entered_s(self) -> float:
        """When the phase began, on the clock of `Now`."""
        return self._since_s

    @property
    def present(self) -> tuple[str, ...]:
        """The nodes that a session started now would expect."""
        return tuple(sorted({*self._present, *self._config.required_services}))

    @property
    def recorded_by(self) -> tuple[str, ...]:
        """The nodes that write the session which runs; none where there is none, or nobody does."""
        expected = self.session.expected if self.session.phase in ACTIVE else ()
        return tuple(name for name in expected if name in self._config.last_services)

    # events

    def start(self, request: Request, now: Now) -> Outcome:
        """Somebody wants a session."""
        session = self.session
        if session.phase in ACTIVE:
            return _refused(f"session '{session.session_id}' is {session.phase.name}; stop it first")
        session_id = request.session_id or self._generated(now)
        if session_id in self.used:
            return _refused(f"session_id '{session_id}' was used before; choose another one")
        self.session = Session(
            Phase.PREPARING,
            session_id,
            request.study,
            request.task,
            request.metadata_json,
            request.human_ids,
            request.required_streams,
            expected=self.present,
        )
        self._hindrances, self._writers = Hindrances(), Writers(self._config.last_services)
        self._told, self._left, self._resumed = set(), set(), ""
        self._began_with = self.recorded_by
        self._enter(now)
        return Outcome(True, session_id, "", f"session '{session_id}' is being prepared", self._publish())

    def stop(self, session_id: str, now: Now) -> Outcome:
        """Somebody wants the session to end; an empty session_id means whichever runs."""
        session = self.session
        if session.phase not in ACTIVE:
            last = f"; the last one failed: {session.detail}" if session.phase is Phase.FAILED else ""
            return _refused(f"no session is running{last}")
        if session_id not in ("", session.session_id):
            return _refused(f"session '{session_id}' is not running, '{session.session_id}' is")
        if session.phase is Phase.STOPPING:
            message = f"session '{session.session_id}' is stopping already"
            return Outcome(True, session.session_id, session.directory, message, [])
        detail = session.detail if self._has_started(now) else "stopped before it had begun"
        self.session = replace(session, phase=Phase.STOPPING, stop_ns=now.ros_ns, detail=detail)
        self._enter(now)
        message = f"session '{session.session_id}' is stopping"
        return Outcome(True, session.session_id, session.directory, message, self._publish() + self.tick(now))

    def _has_started(self, now: Now) -> bool:
        """Return whether the common start, which is announced ahead, has come; a clock that was set takes none back."""
        ahead = now.ros_ns < self.session.start_ns and now.monotonic_s - self._since_s < self._config.lead_s
        return self.session.phase is Phase.RECORDING and not ahead

    def ack(self, ack: Ack, now: Now) -> list[Effect]:
        """A service says something about a phase; what is not about this one is too late to matter.

        Only who records says where; a detail is a line, what is beyond that is cut.
        """
        session, ack = self.session, ack._replace(detail=_line(ack.detail))
        if (ack.session_id, ack.phase) != (session.session_id, session.phase) or session.phase not in ACTIVE:
            return []
        first = bool(self._answers.silent([ack.service]))
        if not self._answers.take(ack, session.expected):
            return []
        records = ack.service in self._config.last_services and len(ack.directory) <= LONGEST_DIRECTORY
        if records and ack.directory not in ("", session.directory):
            self.session = replace(session, directory=ack.directory)
            self._dirty = True
        begins = first and session.phase is Phase.RECORDING and ack.service in self._prepared
        late = begins and ack.said_ns > session.start_ns
        return (self._late(ack) if late else []) + self._advance(now)

    def _late(self, ack: Ack) -> list[Effect]:
        """Say that a service has not begun with the others: its first segment opens where it heard of the start."""
        late_s = (ack.said_ns - self.session.start_ns) / SECOND_NS
        return [Note(f"{ack.service} heard of the start {late_s:.1f} s after it")]

    def seen(self, services: Mapping[str, frozenset[bytes]], now: Now) -> list[Effect]:
        """The nodes that hear `/study/session` now, each with the processes it is seen in."""
        before = self._present
        self._present = {name: services[name] for name in self._heeded(services)}
        if self.session.phase not in ACTIVE:
            return []
        effects: list[Effect] = []
        for name in sorted(self._newcomers()):
            effects.append(Note(f"service appeared: {name}"))
            self._left.discard(name)
            self.session = replace(self.session, expected=tuple(sorted({*self.session.expected, name})))
        for name in sorted(self._present.keys() & before.keys()):
            if self._present[name] - before[name]:
                effects.append(Note(f"service started afresh: {name}"))
                self._prepared.discard(name)
                self._answers.forget(name)
        effects += self._watch_last()
        if now.monotonic_s >= self._settled_at_s:
            effects += self._without_gone()
        return effects + self._advance(now)

    def _newcomers(self) -> set[str]:
        """Who is to be expected, too. Who comes while it stops has nothing to finish, unless it records."""
        found = self._present.keys() - set(self.session.expected)
        return found & {*self._config.last_services} if self.session.phase is Phase.STOPPING else found

    def _heeded(self, services: Iterable[str]) -> list[str]:
        """Who counts of these: at most MOST_SERVICES, first who is needed, then who took part already."""
        config, expected = self._config, self.session.expected
        needed = config.required_services + config.last_services
        names = sorted(services, key=lambda name: (name not in needed, name not in expected, name))
        return [name for name in names if not self._ignored(name)][:MOST_SERVICES]

    def _watch_last(self) -> list[Effect]:
        """Note who records and is back."""
        if self.session.phase is Phase.PREPARING:
            return []
        self._writers.seen(self._present)
        back = {name for name in self._config.last_services if name in self._present and f"gone {name}" in self._told}
        return [Note(f"service is back: {name}") for name in sorted(back)]

    def troubles(self, troubles: Mapping[str, str], now: Now) -> list[Effect]:
        """What is wrong now with services that hang, are silent or do not record, by their nodes' names.

        A start waits for those that take part; while recording anybody's trouble is told, also once DDS shows it gone,
        but of who took no part and had been in trouble before it began.
        """
        strangers = troubles.keys() - set(self.session.expected)
        self._ill_before = self._ill_before & strangers if self._has_begun else strangers
        found = {name: _line(why) for name, why in troubles.items() if name not in self._ill_before}
        notes = self._hindrances.services_are(found, self._config.last_services)
        return self._told_in_recording(notes) + self._advance(now)

    @property
    def _needed(self) -> tuple[str, ...]:
        """Who is waited for also when gone: what is required, and who records, once that was asked for or has begun."""
        return self._config.required_services + (self._config.last_services if self._has_begun else self._began_with)

    @property
    def _has_begun(self) -> bool:
        return self.session.phase in (Phase.RECORDING, Phase.STOPPING)

    def _without_gone(self) -> list[Effect]:
        """Note who has gone. A required service is waited for; without the others the session goes on."""
        effects: list[Effect] = []
        self._told -= {f"gone {name}" for name in self._present}
        for name in sorted(set(self.session.expected) - self._present.keys()):
            if f"gone {name}" in self._told:
                continue
            if name in self._needed or self.session.phase is Phase.STOPPING:
                self._told.add(f"gone {name}")
            else:
                self.session = replace(self.session, expected=tuple(e for e in self.session.expected if e != name))
            if self.session.phase is Phase.RECORDING:
                self._left.add(name)
            if not (self.session.phase is Phase.STOPPING and self._answers.is_ok(name)):
                self._answers.forget(name)
                effects.append(Note(f"service gone: {name}"))
        return effects

    def streams(self, troubles: Mapping[str, str], now: Now) -> list[Effect]:
        """What is wrong with required streams now: topic or glob -> why; who has just begun knows no stream yet."""
        if self.session.phase is Phase.RECORDING and now.monotonic_s < self._settled_at_s:
            return []
        return self._told_in_recording(self._hindrances.streams_are(troubles)) + self._advance(now)

    def _told_in_recording(self, notes: list[Note]) -> list[Effect]:
        return [*notes] if self.session.phase is Phase.RECORDING else []

    def tick(self, now: Now) -> list[Effect]:
        """Time has passed."""
        effects: list[Effect] = []
        if self._resumed and now.monotonic_s >= self._knows_graph_at_s:  # not before somebody can hear it
            effects, self._resumed = [Note(self._resumed)], ""
        session, config = self.session, self._config
        elapsed_s = now.monotonic_s - self._since_s
        silent = self._answers.silent(session.expected)
        if session.phase is Phase.PREPARING:
            if silent and elapsed_s > config.answer_timeout_s:
                self._fail(f"did not answer within {config.answer_timeout_s:g} s: {', '.join(silent)}", now)
            elif elapsed_s > config.prepare_timeout_s:
                self._fail(f"not ready within {config.prepare_timeout_s:g} s: {'; '.join(self._waiting())}", now)
        elif session.phase is Phase.RECORDING:
            for name in silent if elapsed_s > config.answer_timeout_s else ():
                if f"silent {name}" not in self._told:
                    self._told.add(f"silent {name}")
                    effects.append(Note(f"{name} has not acknowledged the recording"))
        elif session.phase is Phase.STOPPING:
            self._give_up(now)
        return effects + self._advance(now) + (self._publish() if self._dirty else [])

    # what follows from them

    def _give_up(self, now: Now) -> None:
        """Leave behind who has not finished in time, first all but the last ones, then these too."""
        first, last = self._answers.unfinished(self.session.expected)
        if first and now.monotonic_s - self._since_s > self._config.flush_timeout_s:
            self._answers.give_up(first)
        elif not first and last and now.monotonic_s - self._alone_since_s > self._config.flush_timeout_s:
            self._answers.give_up(last)

    def _advance(self, now: Now) -> list[Effect]:
        """Go on to the next phase where this one is done; note what is waited for."""
        session = self.session
        if session.phase in ACTIVE and (waiting := self._waiting()) != session.waiting_for:
            self.session = session = replace(session, waiting_for=waiting)
            self._dirty = True
        first, last = self._answers.unfinished(self.session.expected)
        if first or session.phase is not Phase.STOPPING:
            self._alone_since_s = now.monotonic_s
        if session.phase is Phase.PREPARING and not session.waiting_for and now.monotonic_s >= self._knows_graph_at_s:
            self.used = (*self.used, session.session_id)[-MOST_NAMES:]
            start_ns = now.ros_ns + round(self._config.lead_s * SECOND_NS)
            self.session = replace(session, phase=Phase.RECORDING, start_ns=start_ns)
            self._prepared = set(session.expected)
            self._enter(now)
            return self._publish()
        if session.phase is Phase.STOPPING and not first and not last:
            return self._finish(now)
        return []

    def _finish(self, now: Now) -> list[Effect]:
        session, left = self.session, sorted(self._left - set(self.session.expected))
        given_up = self._answers.given_up
        if gone := [n for n in given_up if n in self._config.last_services and n not in self._present]:
            self._fail(f"gone before the end: {', '.join(gone)}", now)
        elif given_up:
            self._fail(f"did not finish within {self._config.flush_timeout_s:g} s: {', '.join(given_up)}", now)
        else:
            what = session.detail or self._outcome() + (f", but gone before the end: {', '.join(left)}" if left else "")
            detail = _line(f"session '{session.session_id}': {what}", LONGEST_DETAIL)
            self.session = Session(directory=session.directory, detail=detail)
        return self._publish()

    def _outcome(self) -> str:
        """What has become of the recording: whoever finishes last says what it lacks."""
        last = self._answers.of_last()
        lacking = [f"{name}: {ack.detail}" for name, ack in last.items() if ack.detail] or self._writers.lacking
        if lacking:
            return f"incomplete: {'; '.join(lacking)}"
        return "complete" if last else "not recorded: no recorder took part"

    def _fail(self, why: str, now: Now) -> None:
        self.session = replace(self.session, phase=Phase.FAILED, waiting_for=(), detail=_line(why, LONGEST_DETAIL))
        self._enter(now)
        self.session = replace(self.session, waiting_for=())

    def _enter(self, now: Now) -> None:
        self._answers.clear()
        self._since_s = self._alone_since_s = now.monotonic_s
        self.session = replace(self.session, waiting_for=self._waiting())
        self._dirty = True

    def _publish(self) -> list[Effect]:
        self._dirty = False
        return [Publish(self.session)]

    def _waiting(self) -> tuple[str, ...]:
        """What this phase waits for, as in SessionState."""
        entries = self._answers.waited(self.session.expected)
        if self.session.phase in (Phase.PREPARING, Phase.RECORDING):
            entries += self._hindrances.waited({entry.who for entry in entries})
        if self.session.phase is Phase.PREPARING:
            entries += self._hindrances.unseen(self.session.required_streams)
        return tuple(map(str, entries[:MOST_WAITED]))

    def _ignored(self, name: str) -> bool:
        return self._onlookers.match(f"/{name}")

    def _generated(self, now: Now) -> str:
        base = f"s{datetime.fromtimestamp(now.ros_ns / SECOND_NS, UTC):%Y%m%dT%H%M%S}"
        names = (base, *(f"{base}_{n}" for n in range(2, MOST_NAMES + 2)))
        return next(name for name in names if name not in self.used)
