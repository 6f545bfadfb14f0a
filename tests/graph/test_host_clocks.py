"""Clocks of several hosts: clock-syncs as processes, one of them on a clock that a test can set."""

import signal
import time
from collections.abc import Callable
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from clock_sync import hosts
from clock_sync.config import Config
from clock_sync.hosts import RIVAL_S, STEP_EVERY_S, Reference
from clock_sync.model import State
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ears import Ears
from processes import Process, poll
from sense4hri import diagnostics, qos
from sense4hri.beats import MAKES_ROOM_S
from sense4hri.host_clocks import MOST_HOSTS, PROBES, TOPIC, HostClocks
from sense4hri.recorder_status import NAME
from sense4hri_msgs.msg import ClockProbe, HostClock, HostClockArray
from std_msgs.msg import Header
from wall_clock import WallClock

RIGHT_NS = (
    3_000_000  # a busy machine keeps the exchange itself from no more; tests/graph/test_three_hosts has the number
)


@pytest.fixture
def clock(tmp_path) -> WallClock:
    """The wall clock of the host lab_b, 1.5 s ahead."""
    clock = WallClock(tmp_path)
    clock.step(1.5)
    return clock


@pytest.fixture
def ears(opened: Callable[[Ears], Ears]) -> Ears:
    return opened(Ears())


def test_another_hosts_clock_is_measured_stepped_and_missed(start, clock, ears):
    """Offset with sign and name, a step told with a new entry, HOLDOVER where the host is silent; metrics and log."""
    arrays = ears.hear(HostClockArray, TOPIC, qos.HOST_CLOCKS)
    reference = start("clock_sync", host="Lab-A", reference_host="lab_a")
    other = start("clock_sync", host="lab-b", reference_host="lab_a", env=clock.env)

    def entry(ahead_s: float, state: int) -> HostClock | None:
        found = arrays[-1].clocks[0] if arrays and arrays[-1].clocks else None
        right = found is not None and abs(found.offset_ns + ahead_s * 1e9) < RIGHT_NS and found.state == state
        return found if right else None

    found = ears.until(lambda: entry(1.5, HostClock.LOCKED), lambda: f"lab_b is 1.5 s ahead in {arrays[-1:]}")
    assert (found.host, found.reference) == ("lab_b", "lab_a")
    assert 0 < found.round_trip_s / 2 <= found.uncertainty_s
    ears.until(lambda: {"clock_sync", "clock_sync_lab_b"} <= set(ears.node.get_node_names()), "both by their names")
    clocks = HostClocks()
    clocks.take(arrays[-1], 0.0)
    assert abs(clocks.reference_ns("lab-b", clock.now_ns()) - time.time_ns()) < 2 * RIGHT_NS
    metric = 'sense4hri_host_clock_offset_seconds{field="lab_b",service="clock_sync"} -1.5'
    alternative = metric.replace("-1.5", "-1.49")
    poll(lambda: any(one in reference.get("/metrics")[1] for one in (metric, alternative)), "the offset in the metrics")
    reference.until("the clock of host lab_b is 1.5")
    clock.step(-2.0)
    ears.until(lambda: entry(-0.5, HostClock.WARMUP), lambda: f"a new entry in {arrays[-1:]}")
    reference.until("was stepped")
    ears.until(lambda: entry(-0.5, HostClock.LOCKED), lambda: f"lab_b is 0.5 s behind in {arrays[-1:]}")
    other.kill()
    ears.until(lambda: entry(-0.5, HostClock.HOLDOVER), lambda: f"hold-over in {arrays[-1:]}")
    assert reference.stop() == 0, reference.log()


def test_two_machines_of_one_name_are_told_and_their_clocks_are_not_mixed(start, clock, ears):
    """Two answer as lab_b, 1.5 s apart: named on /diagnostics, not ready, never LOCKED; measured once one has gone."""
    arrays = ears.hear(HostClockArray, TOPIC, qos.HOST_CLOCKS)
    beats = ears.hear(DiagnosticArray, diagnostics.TOPIC, qos.HEALTH)
    reference = start("clock_sync", host="lab_a", reference_host="lab_a")
    ahead = start("clock_sync", host="lab_b", reference_host="lab_a", env=clock.env)
    start("clock_sync", host="lab_b", reference_host="lab_a")
    sentence = "two machines answer under the name of host lab_b, and their clocks are 1."
    reference.until(sentence)
    told = "the clock of a host is not known: two machines answer under its name: lab_b, 1."
    ears.until(lambda: any(told in str(beat) for beat in beats), lambda: f"the sentence in {beats[-3:]}")
    status, body = reference.get("/readyz")
    assert status == 503
    assert "lab_b" not in body
    entries = [entry for array in arrays for entry in array.clocks]
    assert all(entry.state == HostClock.WARMUP or entry.uncertainty_s > 1.0 for entry in entries), entries
    ahead.kill()
    told_before = len(arrays)

    def locked() -> bool:
        entries = arrays[-1].clocks if len(arrays) > told_before else []
        return any(entry.state == HostClock.LOCKED for entry in entries)

    ears.until(locked, lambda: f"the other one measured in {arrays[-1:]}")
    assert abs(arrays[-1].clocks[0].offset_ns) < RIGHT_NS
    reference.until("one machine answers under the name of host lab_b again")
    poll(lambda: reference.get("/readyz")[0] == 200, "ready again")


class Asked:
    """A reference that asks lab_b every 0.2 s, and what answers there: clocks that are so many s ahead of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 1_700_000_000 * 10**9
        told = SimpleNamespace(time_ns=lambda: self.now_ns, monotonic=lambda: self.now_ns * 1e-9)
        monkeypatch.setattr(hosts, "time", told)
        monkeypatch.setattr(hosts, "realtime_minus_monotonic_ns", lambda: 0)
        self.service = MagicMock(config=Config())
        self.reference = Reference(self.service, "lab_a")
        self.reference._meet("lab_b")

    def answers(self, *ahead_s: float, seconds: float = 0.2) -> HostClock | None:
        """Return the entry of lab_b after so long; None where it has none."""
        for _ in range(round(seconds / 0.2)):
            self.now_ns += 200_000_000
            self.reference._ask()
            question = self.reference._peers["lab_b"].pending[-1]
            for way_ns, each_s in enumerate(ahead_s):
                at_ns = question.t1_ns + 100_000 + round(each_s * 1e9)
                probe = ClockProbe(from_host="lab_a", to_host="lab_b", sequence=question.sequence)
                probe.t1_ns, probe.t2_ns, probe.t3_ns = question.t1_ns, at_ns, at_ns
                self.reference._hear(probe, {"received_timestamp": question.t1_ns + 200_000 + way_ns * 100_000})
        self.reference._array.publish.reset_mock()
        self.reference._tell()
        told = self.reference._array.publish.call_args
        return told.args[0].clocks[0] if told and told.args[0].clocks else None

    @property
    def ready(self) -> bool:
        """Whether clock-sync has said last that it is."""
        told = self.service.ready.call_args
        return told is None or told.args[0]


def test_a_clock_that_was_known_is_held_while_another_answers_under_its_name(monkeypatch):
    """Whichever of the two is the quicker: the line is that of before, as wide as they are apart, and not LOCKED."""
    lab_b = Asked(monkeypatch)
    assert lab_b.answers(0.25, seconds=60).state == HostClock.LOCKED
    for order in ((0.25, 2.25), (2.25, 0.25)) * 10:
        entry = lab_b.answers(*order)
        assert entry.offset_ns == pytest.approx(-250_000_000, abs=500_000)
        assert entry.uncertainty_s >= 2.0
        assert (entry.state, lab_b.ready) == (HostClock.WARMUP, False)
    assert lab_b.reference.state("lab_b") is State.WARMUP
    assert lab_b.answers(0.25, seconds=RIVAL_S - 1).state == HostClock.WARMUP
    assert lab_b.answers(0.25, seconds=2).state == HostClock.LOCKED
    assert lab_b.ready


def test_a_clock_that_never_was_known_has_no_entry_while_two_answer(monkeypatch):
    """Not a mixture, and no session begins upon it."""
    lab_b = Asked(monkeypatch)
    assert [lab_b.answers(*((0.0, 2.0) if number % 3 else (2.0, 0.0))) for number in range(50)] == [None] * 50
    assert lab_b.reference.state("lab_b") is State.WARMUP
    assert lab_b.answers(2.0, seconds=RIVAL_S + 6).state == HostClock.LOCKED


def test_two_that_answer_by_one_clock_are_no_contradiction(monkeypatch):
    """As two clock-syncs that were started on one machine by mistake: either may be believed."""
    lab_b = Asked(monkeypatch)
    assert lab_b.answers(0.25, 0.25, seconds=60).state == HostClock.LOCKED
    assert lab_b.ready


def test_an_answer_is_the_same_probe_with_both_times(start, ears):
    """Whoever asks in the contract's way is answered; what asks another host, or is an answer, is not."""
    heard = ears.hear(ClockProbe, PROBES, qos.CLOCK_PROBES)
    start("clock_sync", host="lab_b", reference_host="lab_a")
    asker = ears.node.create_publisher(ClockProbe, PROBES, qos.CLOCK_PROBES)

    def answered() -> ClockProbe | None:
        asker.publish(ClockProbe(from_host="stranger", to_host="lab_c", sequence=8, t1_ns=4))
        asker.publish(ClockProbe(from_host="stranger", to_host="lab_b", sequence=7, t1_ns=time.time_ns()))
        return next((probe for probe in heard if probe.t2_ns), None)

    answer = ears.until(answered, "an answer")
    assert (answer.from_host, answer.to_host, answer.sequence) == ("stranger", "lab_b", 7)
    assert answer.t1_ns <= answer.t2_ns <= answer.t3_ns <= time.time_ns()
    assert not any(probe.t2_ns for probe in heard if probe.to_host == "lab_c")


def test_a_clock_that_is_stepped_for_ever_is_a_line_at_times(start, ears):
    """Somebody answers for lab_b as if its clock leapt all the time: each leap is a new entry, few are lines."""
    arrays = ears.hear(HostClockArray, TOPIC, qos.HOST_CLOCKS)
    questions = ears.hear(ClockProbe, PROBES, qos.CLOCK_PROBES)
    reference = start("clock_sync", host="lab_a", reference_host="lab_a")
    stranger = ears.node.create_publisher(ClockProbe, PROBES, qos.CLOCK_PROBES)
    begun_s, answers = time.monotonic(), 0

    def leaps() -> int:
        nonlocal answers
        stranger.publish(ClockProbe(from_host="lab_b", to_host="lab_a", sequence=1, t1_ns=1))
        for probe in [probe for probe in questions if probe.from_host == "lab_a" and not probe.t2_ns]:
            probe.t2_ns = probe.t3_ns = time.time_ns() + (answers := answers + 1) // 4 * 1_000_000_000
            stranger.publish(probe)
        questions.clear()
        return len({entry.offset_ns // 100_000_000 for array in arrays for entry in array.clocks})

    ears.until(lambda: leaps() > 4, lambda: f"four leaps in {arrays[-1:]}")
    assert 1 <= reference.log().count("was stepped") <= 1 + (time.monotonic() - begun_s) / STEP_EVERY_S


@pytest.mark.parametrize("stepped_ns", [-90_000_000, 90_000_000])
def test_a_question_on_its_way_while_this_clock_is_stepped_tells_nothing(monkeypatch, stepped_ns):
    """A step back looks like the shortest way of all, which would decide for a minute; the next answer counts."""
    account_ns = 7 * stepped_ns
    monkeypatch.setattr(hosts, "realtime_minus_monotonic_ns", lambda: account_ns)
    reference = Reference(MagicMock(config=Config()), "lab_a")
    reference._meet("lab_b")
    for on_its_way_ns, known in ((stepped_ns, False), (0, True)):
        reference._ask()
        account_ns += on_its_way_ns
        number, asked_ns, _ = reference._peers["lab_b"].pending[-1]
        answer = ClockProbe(from_host="lab_a", to_host="lab_b", sequence=number, t1_ns=asked_ns, t2_ns=5, t3_ns=6)
        reference._hear(answer, {"received_timestamp": asked_ns + 100_000_000 + on_its_way_ns})
        assert reference._peers["lab_b"].estimator.known is known
    assert not reference._peers["lab_b"].pending


@pytest.mark.parametrize(("t2_ns", "t3_ns", "heard"), [(5, 6, True), (6, 5, False), (5, 10**10, False)])
def test_a_host_whose_answers_cannot_be_is_silent(t2_ns, t3_ns, heard):
    """Its clock has not been measured since: it is held over, and ever less sure, as if it did not answer."""
    reference = Reference(MagicMock(config=Config()), "lab_a")
    reference._meet("lab_b")
    peer = reference._peers["lab_b"]
    reference._ask()
    number, asked_ns, _ = peer.pending[-1]
    answer = ClockProbe(from_host="lab_a", to_host="lab_b", sequence=number, t1_ns=asked_ns, t2_ns=t2_ns, t3_ns=t3_ns)
    reference._hear(answer, {"received_timestamp": asked_ns + 1000})
    assert (peer.heard_s > 0) is heard
    assert not peer.pending


def test_a_host_finds_room_among_names_that_nobody_has():
    """Who has asked under a hundred names and answered under none keeps no host out; one that has answered stays."""
    service = MagicMock(config=Config())
    reference = Reference(service, "lab_a")

    def asks(host: str) -> None:
        reference._hear(ClockProbe(from_host=host, to_host="lab_a", sequence=1, t1_ns=1), {"received_timestamp": 2})

    asks("lab_b")
    reference._ask()
    ((number, asked_ns, _),) = reference._peers["lab_b"].pending
    answer = ClockProbe(from_host="lab_a", to_host="lab_b", sequence=number, t1_ns=asked_ns, t2_ns=5, t3_ns=6)
    reference._hear(answer, {"received_timestamp": asked_ns + 1000})
    for name in range(MOST_HOSTS):
        asks(f"x_{name}")
    asks("lab_c")
    assert len(reference._peers) == MOST_HOSTS
    assert {"lab_b", "lab_c"} <= reference._peers.keys()
    service.refuse.assert_not_called()


def test_a_host_finds_room_among_names_that_have_long_been_silent(monkeypatch):
    """Who has answered under a hundred names, and does no more, keeps a host out for ten minutes, not for ever."""
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    reference = Reference(service := MagicMock(config=Config()), "lab_a")

    def answers(*names: str) -> None:
        reference._ask()
        for name in names:
            number, asked_ns, _ = reference._peers[name].pending[-1]
            told = ClockProbe(from_host="lab_a", to_host=name, sequence=number, t1_ns=asked_ns, t2_ns=5, t3_ns=6)
            reference._hear(told, {"received_timestamp": asked_ns + 1000})

    names = [f"x_{number}" for number in range(MOST_HOSTS)]
    for name in names:
        reference._meet(name)
    answers(*names)
    reference._meet("lab_b")
    service.refuse.assert_called_once()
    now_s += MAKES_ROOM_S + 1.0
    answers(names[0])
    reference._meet("lab_b")
    assert len(reference._peers) == MOST_HOSTS
    assert {"lab_b", names[0]} <= reference._peers.keys()


def test_the_recorders_host_is_the_reference(start: Callable[..., Process], tmp_path, ears):
    arrays = ears.hear(HostClockArray, TOPIC, qos.HOST_CLOCKS)
    here = start("clock_sync", host="lab_a")
    there = start("clock_sync", host="lab_b")
    start("recorder", directory=str(tmp_path / "recordings"), env={"SENSE4HRI_HOST": "lab-a"})
    there.until("clock_sync_lab_b (process")
    found = ears.until(lambda: next((one for one in arrays if one.clocks), None), "an entry").clocks[0]
    assert (found.host, found.reference) == ("lab_b", "lab_a")
    assert there.stop() == 0
    assert here.stop() == 0


def test_a_stop_counts_while_another_role_is_taken(start: Callable[..., Process], ears):
    """SIGTERM in the moment in which the recorder's host turns out to be another one ends the process all the same."""
    there = start("clock_sync", host="lab_b")
    recorder = ears.node.create_publisher(DiagnosticArray, diagnostics.TOPIC, qos.HEALTH)
    status = DiagnosticStatus(name=NAME, values=[KeyValue(key="host", value="lab_a")])

    def followed() -> bool:
        now = ears.node.get_clock().now().to_msg()
        recorder.publish(DiagnosticArray(header=Header(stamp=now), status=[status]))
        return "the recorder runs on host lab_a" in there.log()

    poll(followed, there.log)
    assert there.stop_within() in (0, -signal.SIGTERM), there.log()
