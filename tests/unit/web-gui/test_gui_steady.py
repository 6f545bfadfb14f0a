"""What is judged by time where the host's clock is set: an hour back, as when the network's time comes late, or on."""

import numpy as np
import pytest
from sense4hri.beats import Beat
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.recorder_status import RecorderStatus
from web_gui.model import Study
from web_gui.page import Page
from web_gui.snapshot import study_message
from web_gui.steady import Steady
from web_gui.stream import Info

S = 1_000_000_000
BEGUN = 1_700_000_000 * S
HOUR = 3600 * S
ECG = StreamName("p1", "ecg", "h10_1")
BREATH = StreamName("p1", "respiration", "h10_1_ecg")
HEALTH = {"state": 2, "reasons": [], "measured_rate_hz": 90.0, "nominal_rate_hz": 130.0}


class Host:
    """A study on a host whose clock a test sets. aged: what arrives was stamped so long ago, as in a replay."""

    def __init__(self, aged_ns=0):
        self.of_day_ns, self.since_boot_ns, self.aged_ns = BEGUN, 20 * S, aged_ns
        self.study = Study(clock=Steady(lambda: self.of_day_ns, lambda: self.since_boot_ns))
        self.page = Page(self.study, [])
        self.now_ns = self.study.clock.now_ns

    def set(self, by_ns):
        """Set the clock."""
        self.of_day_ns += by_ns

    def run(self, seconds, lives=True, health=HEALTH):
        """Let so many seconds pass, with or without anybody who says anything."""
        for _ in range(seconds):
            self.of_day_ns, self.since_boot_ns = self.of_day_ns + S, self.since_boot_ns + S
            if lives:
                self._hear(health)
            self.page.tick()

    def _hear(self, health):
        study, now_ns, stamp_ns = self.study, self.now_ns(), self.of_day_ns - self.aged_ns
        stream = study.stream(ECG, now_ns)
        stream.learn(Info(130.0, "uV", {}))
        study.axis.saw(stamp_ns, now_ns)
        stream.raw(Chunk(("ecg",), np.zeros((130, 1)), None, stamp_ns), now_ns)
        stream.take_health(health, now_ns)
        stream.take_features({"signal_quality": 0.9, "reasons": []}, now_ns)
        study.services.take(Beat("fusion_affect", "1"), now_ns)
        study.session.recorder.take(RecorderStatus("recorder", recording=True, messages=self.since_boot_ns), now_ns)

    def told(self):
        """What the page says is wrong, as (alert, for how many s)."""
        message = study_message(self.study, self.page.log, self.now_ns())
        return {one["alert"]: (message["wall_ms"] - one["since_ms"]) / 1000 for one in message["problems"]}


@pytest.mark.parametrize("by_ns", [-HOUR, HOUR])
def test_who_dies_after_the_clock_was_set_is_told_as_soon_as_ever(by_ns):
    """A stream, a service and the recorder; and nobody is who lives."""
    host = Host()
    host.study.session.take_state({"phase": 2, "session_id": "s1"})
    host.run(20, health={"state": 2, "reasons": []})
    host.set(by_ns)
    host.run(20, health={"state": 2, "reasons": []})
    assert (host.told(), host.page.log.ended()) == ({}, [])
    host.run(6, lives=False)
    assert host.told().keys() == {"StreamSilent", "ServiceDown", "RecorderCannotRecord"}
    assert host.study.session.recorder.unrecorded_s == 6


@pytest.mark.parametrize("by_ns", [-HOUR, HOUR])
def test_a_problem_lasts_as_long_as_it_lasts(by_ns):
    """It becomes due after its wait, and since when it lasts is told by the clock as it is set."""
    host = Host()
    host.run(12, health={"state": 2, "reasons": []})
    host.run(3)
    host.set(by_ns)
    host.run(2)
    assert host.told() == {}
    host.run(1)
    assert host.told() == {"RateLow": 5.0}
    host.run(3, health={"state": 2, "reasons": []})
    (over,) = study_message(host.study, host.page.log, host.now_ns())["log"]
    assert (over["ended_ms"] - over["since_ms"], over["ended_ms"]) == (6000, (host.of_day_ns - 2 * S) / 1e6)


@pytest.mark.parametrize("by_ns", [-HOUR, -20 * S, 20 * S, HOUR])
def test_a_live_stream_is_neither_replayed_nor_late_after_the_clock_was_set(by_ns):
    """Its stamps follow the clock: so do the right edge and what its delays are measured by."""
    host = Host()
    host.run(5)
    host.set(by_ns)
    for _ in range(40):
        host.run(1)
        now_ns = host.now_ns()
        assert not host.study.axis.replaying(now_ns)
        assert host.study.axis.now_ns(now_ns) == host.of_day_ns
        assert host.study.streams[ECG].delays.p99_s(now_ns) == 0.0


@pytest.mark.parametrize("by_ns", [20 * S, HOUR])
def test_what_was_on_its_way_while_the_clock_was_set_is_not_late(by_ns):
    """It was stamped by the clock as it stood before; what is late later on is told."""
    host = Host()
    host.run(5)
    stream, stamped_ns = host.study.streams[ECG], host.of_day_ns
    host.set(by_ns)
    stream.raw(Chunk(("ecg",), np.zeros((1, 1)), None, stamped_ns), host.now_ns())
    assert stream.delays.p99_s(host.now_ns()) == 0.0
    host.run(3)
    stream.raw(Chunk(("ecg",), np.zeros((1, 1)), None, host.of_day_ns - S // 2), host.now_ns())
    assert stream.delays.p99_s(host.now_ns()) == 0.5


@pytest.mark.parametrize("by_ns", [-HOUR, HOUR])
def test_a_session_has_lasted_as_long_as_it_has(by_ns):
    """Nor is it told to begin in an hour; whatever the coordinator says again of it, it began once."""
    host = Host()
    state = {"phase": 2, "session_id": "s1", "start_at": host.of_day_ns + 3 * S}
    host.study.session.take_state(state)
    host.run(5)
    host.set(by_ns)
    host.study.session.take_state(state)
    host.run(5)
    message = study_message(host.study, host.page.log, host.now_ns())
    assert message["wall_ms"] - message["session"]["start_ms"] == 7000


@pytest.mark.parametrize("by_ns", [-HOUR, HOUR])
def test_a_replay_plays_on_where_the_clock_is_set(by_ns):
    """Its edge is the time of what is played, and it is over when it is."""
    host = Host(aged_ns=86_400 * S)
    host.run(5)
    host.set(by_ns)
    host.aged_ns += by_ns
    host.run(5)
    assert host.study.axis.replaying(host.now_ns())
    assert host.study.axis.now_ns(host.now_ns()) == BEGUN + 10 * S - 86_400 * S
    host.run(31, lives=False)
    assert not host.study.axis.replaying(host.now_ns())


def test_what_has_no_stamp_has_the_time_of_day():
    """A marker, and the number that is drawn of a stream without samples."""
    host = Host()
    host.set(-HOUR)
    host.study.take_marker({"stamp_ns": 0, "name": "sync"}, host.now_ns())
    stream = host.study.stream(BREATH, host.now_ns())
    stream.take_features({"breaths_per_min": 14.0}, host.now_ns())
    assert [host.study.markers[0].at_ns, stream.history.newest_ns] == [host.of_day_ns] * 2


def test_the_time_of_day_at_a_moment_changes_only_where_the_clock_is_set():
    """A process that is kept waiting between two looks at two clocks moves nothing."""
    ms, back = 1_000_000, -HOUR
    first, second = (0, 50, 5 * ms, 5 * ms + 1, 5 * ms + 2), (300 * ms, 300 * ms + 50 + back, 302 * ms)
    third, fourth = (400 * ms, 500 * ms + back, 600 * ms), (700 * ms, 700 * ms + 5 + back, 702 * ms)
    looks = iter([*first, *second, *third, *fourth])
    clock = Steady(lambda: BEGUN + next(looks), lambda: next(looks))
    assert [clock.wall_ns(BEGUN) - BEGUN for _ in range(4)] == [0, *3 * [back]]
