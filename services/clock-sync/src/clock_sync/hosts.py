"""The clock-syncs of several hosts on the graph: questions, answers, and what the reference makes of them."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

from sense4hri import qos, stamps
from sense4hri.beats import MAKES_ROOM_S
from sense4hri.health import realtime_minus_monotonic_ns
from sense4hri.host_clocks import APART_S, MOST_HOSTS, PROBES, TOPIC, sanitised, unmeasured
from sense4hri.service import Service
from sense4hri_msgs.msg import ClockProbe, HostClock, HostClockArray

from clock_sync.config import Config
from clock_sync.model import State
from clock_sync.round_trips import HostEstimator, HostOffset, RoundTrip

LOOK_EVERY_S, ASK_EVERY_S, TELL_EVERY_S = 0.5, 0.2, 1.0
STEP_EVERY_S = 10.0  # a line of clocks that are stepped
PENDING = 50  # questions that may still be answered, or answered by somebody else too
RIVAL_S = 10.0  # for so long after two clocks answered one question neither is believed: a question in 50 would do
TWO_ANSWER = "the clock of a host is not known: two machines answer under its name"
STEP_NS = 500_000  # this host's clock set by so much while a question was on its way: the answer tells nothing
NODE = "clock_sync"

SHOWN: tuple[tuple[str, str, Callable[[HostOffset], float]], ...] = (
    ("host_clock_offset_seconds", "This host's clock minus another's.", lambda found: found.offset_ns * 1e-9),
    ("host_clock_uncertainty_seconds", "95 % half width of that.", lambda found: found.uncertainty_s),
    ("host_clock_skew_ratio", "Rate of this host's clock over another's, minus 1.", lambda one: one.skew_ppm * 1e-6),
    ("host_clock_round_trip_seconds", "Smallest round trip of the window.", lambda found: found.round_trip_s),
    ("host_clock_state", "0 warm-up, 1 locked, 2 hold-over.", lambda found: float(found.state)),
)
"""Of each host: name of the metric, text, value."""


def node_name(host: str, reference: str) -> str:
    """Return the node's name on a host: `clock_sync` on the reference host, `clock_sync_<host>` elsewhere."""
    return NODE if host == reference else f"{NODE}_{host}"


class Answers:
    """Answers every probe that asks this host."""

    def __init__(self, service: Service[Config], host: str) -> None:
        self._host, self._service = host, service
        service.subscribe(ClockProbe, PROBES, self._hear, qos.CLOCK_PROBES, with_info=True)

    @cached_property
    def _publisher(self) -> Any:
        return self._service.publisher(ClockProbe, PROBES, qos.CLOCK_PROBES)

    def show(self) -> None:
        """Publish where probes are sent, which tells the reference that this host can be asked."""
        _ = self._publisher

    def ask(self, host: str, sequence: int) -> int:
        """Ask a host for its time; return this host's time of sending, ns."""
        probe = ClockProbe(from_host=self._host, to_host=host, sequence=sequence, t1_ns=time.time_ns())
        self._publisher.publish(probe)
        return int(probe.t1_ns)

    def _hear(self, probe: ClockProbe, info: dict[str, Any]) -> None:
        heard_ns = info["received_timestamp"] or time.time_ns()  # the middleware's is taken before any queue of ours
        if probe.from_host == self._host and probe.t2_ns:
            self.answered(probe, heard_ns)
        elif probe.to_host == self._host and probe.from_host != self._host and not probe.t2_ns:
            self.asked(probe.from_host)
            probe.t2_ns, probe.t3_ns = heard_ns, time.time_ns()
            self._publisher.publish(probe)

    def asked(self, host: str) -> None:
        """Another host has asked this one."""

    def answered(self, probe: ClockProbe, heard_ns: int) -> None:
        """A question of this host has been answered."""


class Question(NamedTuple):
    """A probe on its way. account_ns: this host's wall clock less its monotonic one, which a step of it changes."""

    sequence: int
    t1_ns: int
    account_ns: int


@dataclass
class Peer:
    """Another host as the reference knows it. pending: questions not yet answered; answered: the newest that are.

    rival_s: when two clocks answered one question last; apart_s: how far apart they were.
    """

    estimator: HostEstimator = field(default_factory=HostEstimator)
    pending: deque[Question] = field(default_factory=lambda: deque(maxlen=PENDING))
    answered: deque[tuple[Question, RoundTrip]] = field(default_factory=lambda: deque(maxlen=PENDING))
    heard_s: float = 0.0
    state: State | None = None
    apart: bool = False
    rival_s: float = -math.inf
    apart_s: float = 0.0

    @property
    def has_rival(self) -> bool:
        """Whether two machines answer under this host's name, so that no answer tells whose clock it is of."""
        return time.monotonic() - self.rival_s < RIVAL_S

    def question(self, sequence: int, t1_ns: int) -> Question | None:
        """Return the question that an answer belongs to, be it the first one to it or not; None: it was never asked."""
        asked = chain(self.pending, (question for question, _ in self.answered))
        return next((each for each in asked if each[:2] == (sequence, t1_ns)), None)

    def contradicted(self, question: Question, trip: RoundTrip) -> bool:
        """Take a further answer to a question; True where it is by another clock than the first one.

        A line that was not sure yet may be of either and is forgotten; a sure one is that of before.
        """
        first = next((earlier for asked, earlier in self.answered if asked == question), trip)
        if not (apart_s := trip.apart_s(first)):
            return False
        self.rival_s, self.apart_s = time.monotonic(), apart_s
        if self.estimator.known and self.estimator.offset().state is State.WARMUP:
            self.estimator = HostEstimator()
        return True


class Reference(Answers):
    """Measures every other host and tells `/study/host_clocks`; of a study on one host, nothing."""

    def __init__(self, service: Service[Config], host: str) -> None:
        super().__init__(service, host)
        self._sequence = 0
        self._peers: dict[str, Peer] = {}
        self._doubled: set[str] = set()  # hosts of which has been told that two machines answer
        self._probes = service.watch([PROBES], lambda topic: None)
        service.every(LOOK_EVERY_S, self._look)

    @cached_property
    def _array(self) -> Any:
        return self._service.publisher(HostClockArray, TOPIC, qos.HOST_CLOCKS)

    def asked(self, host: str) -> None:
        """Whoever asks can be asked."""
        self._meet(host)

    def answered(self, probe: ClockProbe, heard_ns: int) -> None:
        """Take a round trip in."""
        peer = self._peers.get(probe.to_host)
        asked = None if peer is None else peer.question(probe.sequence, probe.t1_ns)
        if peer is None or asked is None:
            return
        is_first = asked in peer.pending
        if is_first:
            peer.pending.remove(asked)
        trip = RoundTrip(probe.t1_ns, probe.t2_ns, probe.t3_ns, heard_ns)
        if not trip.usable or abs(realtime_minus_monotonic_ns() - asked.account_ns) > STEP_NS:
            return
        if is_first:
            self._measured(probe.to_host, peer, asked, trip)
        elif peer.contradicted(asked, trip) and probe.to_host not in self._doubled:
            self._tell()

    def _measured(self, host: str, peer: Peer, asked: Question, trip: RoundTrip) -> None:
        peer.answered.append((asked, trip))
        peer.heard_s = time.monotonic()
        if peer.has_rival:
            return
        if peer.estimator.add(trip):
            stepped = f"the clock of host {host}, or of this host {self._host}, was stepped"
            self._service.log.warning_at_times(stepped, STEP_EVERY_S)
            self._tell()
        elif peer.estimator.known and peer.estimator.offset().state is not peer.state:
            self._tell()

    def state(self, host: str) -> State | None:
        """Return how well another host's clock is known; None where it is not, or is this one."""
        peer = self._peers.get(sanitised(host))
        if peer is None:
            return None
        return State.WARMUP if peer.has_rival else peer.state

    def doubt(self, host: str) -> str:
        """Return why times of this host are not corrected; empty where they are, or need not be."""
        if sanitised(host) in self._doubled:
            return f"two machines answer under the name of host {host}"
        known = sanitised(host) == self._host or self.state(host) is not None
        return "" if known else unmeasured(host, self._host)

    def _look(self) -> None:
        """Meet whoever publishes probes; a node's name may come later than its publisher."""
        publishers = [publisher for topic in self._probes.topics.values() for publisher in topic.publishers]
        for publisher in publishers:
            if publisher.node_name.startswith(f"{NODE}_"):
                self._meet(publisher.node_name.removeprefix(f"{NODE}_"))

    def _meet(self, host: str) -> None:
        if host in self._peers or host == self._host or host != sanitised(host):
            return
        if len(self._peers) >= MOST_HOSTS and not self._forget_a_silent_one():
            self._service.refuse(PROBES, "ClockProbe", f"host {host!r} is one more than the {MOST_HOSTS} that can be")
            return
        if not self._peers:
            self._service.every(ASK_EVERY_S, self._ask)
            self._service.every(TELL_EVERY_S, self._tell)
        self._peers[host] = Peer()

    def _forget_a_silent_one(self) -> bool:
        """Forget a host: first one that never answered, asked longest, then one that has long been silent.

        False where all answer.
        """
        before_s = time.monotonic() - MAKES_ROOM_S
        mute = (host for host, peer in self._peers.items() if not peer.estimator.known)
        gone = (host for host, peer in self._peers.items() if peer.heard_s < before_s)
        silent = next(chain(mute, gone), None)
        if silent is not None and self._peers.pop(silent).state is not None:
            self._show(silent, None)
        return silent is not None

    def _ask(self) -> None:
        account_ns = realtime_minus_monotonic_ns()
        for host, peer in self._peers.items():
            self._sequence = (self._sequence + 1) % 2**32
            peer.pending.append(Question(self._sequence, self.ask(host, self._sequence), account_ns))

    def _tell(self) -> None:
        self._tell_rivals()
        known = {host: peer for host, peer in self._peers.items() if peer.estimator.known}
        if not known:
            return
        message = HostClockArray(clocks=[self._entry(host, peer) for host, peer in known.items()])
        stamps.set_time(message.header.stamp, time.time_ns())
        self._array.publish(message)

    def _tell_rivals(self) -> None:
        """Say, once when it begins and once when it ends, under whose name two machines answer."""
        apart_s = {host: peer.apart_s for host, peer in self._peers.items() if peer.has_rival}
        for host in sorted(apart_s.keys() - self._doubled):
            two = f"two machines answer under the name of host {host}, and their clocks are {apart_s[host]:.3f} s apart"
            self._service.log.warning(f"{two}: its clock is not known until each has a name of its own")
            if not self._peers[host].estimator.known:
                self._show(host, None)
        for host in sorted(self._doubled - apart_s.keys()):
            self._service.log.info(f"one machine answers under the name of host {host} again")
        if apart_s.keys() != self._doubled:
            self._doubled = set(apart_s)
            why = ", ".join(f"{host}, {apart:.3f} s apart" for host, apart in sorted(apart_s.items()))
            self._service.ready(not apart_s, TWO_ANSWER, why)

    def _entry(self, host: str, peer: Peer) -> HostClock:
        found = peer.estimator.offset(time.monotonic() - peer.heard_s)
        if peer.has_rival:
            found = found._replace(state=State.WARMUP, uncertainty_s=found.uncertainty_s + peer.apart_s)
        self._show(host, found)
        self._say(host, peer, found.state, found.offset_ns * 1e-9)
        entry = HostClock(host=host, reference=self._host, offset_ns=found.offset_ns, skew_ppm=found.skew_ppm)
        entry.uncertainty_s, entry.round_trip_s = found.uncertainty_s, found.round_trip_s
        stamps.set_time(entry.measured_at, found.measured_at_ns)
        entry.state = int(found.state)
        return entry

    def _show(self, host: str, found: HostOffset | None) -> None:
        """Show how a clock stands; None: no alert judges that of a host that is forgotten."""
        for name, text, of in SHOWN:
            self._service.metrics.gauge(name, text, field=host).set(math.nan if found is None else of(found))
        if found is None:
            self._service.metrics.gone(field=host)

    def _say(self, host: str, peer: Peer, state: State, offset_s: float) -> None:
        """Log what has changed: once when it comes, once when it goes."""
        log, before = self._service.log, peer.state
        if before is None:
            log.info(f"measures the clock of host {host} against that of this host, {self._host}")
        if state is State.HOLDOVER and before is not state:
            log.warning(f"host {host} no longer answers: its clock is taken to go on as it did")
        if before is State.HOLDOVER and state is not before:
            log.info(f"host {host} answers again")
        apart = abs(offset_s) > APART_S and state is not State.WARMUP
        if apart and not peer.apart:
            log.warning(
                f"the clock of host {host} is {abs(offset_s):.4f} s off that of {self._host}; times are corrected"
            )
        if peer.apart and not apart and state is State.LOCKED:
            log.info(f"the clock of host {host} is with that of {self._host} again")
        peer.state, peer.apart = state, apart
