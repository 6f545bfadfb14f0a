"""Counters that wrap: the count goes on, whatever the link does; a restart of the device is passed on."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.unwrap import Unwrap, ticks_ns

SEQUENCE = (8, 250)  # OpenBCI Cyton: goes round in 1.02 s
CLOCKS = [SEQUENCE, (16, 1000), (16, 32768), (24, 32768), (32, 1_000_000)]


class Counter:
    """A device's counter and the host's clock, both in the test's hands."""

    def __init__(self, bits: int, rate_hz: float, offset: int = 0) -> None:
        self._bits, self._rate_hz, self._offset, self._now_s = bits, rate_hz, offset, 100.0
        self.unwrap = Unwrap(bits, rate_hz, lambda: round(self._now_s * 1e9))

    def send(self, sent_s: float, delay_s: float = 0.0, true_rate: float = 1.0) -> tuple[int, int]:
        """A message sent at sent_s that comes after delay_s: (what it counts in truth, what unwrapping makes of it)."""
        truth = self._offset + round(sent_s * self._rate_hz * true_rate)
        self._now_s = max(self._now_s, 100.0 + sent_s + delay_s)
        return truth, self.unwrap(truth % (1 << self._bits))


@pytest.mark.parametrize(("bits", "rate_hz"), CLOCKS)
@pytest.mark.parametrize("true_rate", [0.985, 1.0, 1.015])
def test_a_wrap_is_counted_on(bits: int, rate_hz: float, true_rate: float) -> None:
    """Over three rounds no count is lost and none is won, though the device counts 1.5 % off."""
    period_s = (1 << bits) / rate_hz
    counter = Counter(bits, rate_hz)
    got = [counter.send(step * period_s / 40, true_rate=true_rate) for step in range(121)]
    assert all(truth == whole for truth, whole in got)
    assert counter.unwrap.restarts_total == 0


@pytest.mark.parametrize(("bits", "rate_hz"), CLOCKS)
def test_whole_rounds_missed_in_a_gap_are_made_up(bits: int, rate_hz: float) -> None:
    """A link that was away for 7.4 rounds of the counter comes back with the true count."""
    period_s = (1 << bits) / rate_hz
    counter = Counter(bits, rate_hz)
    counter.send(0.0)
    counter.send(0.1 * period_s)
    truth, whole = counter.send(7.5 * period_s)
    assert truth == whole


def test_a_burst_after_a_stall_is_no_round_more() -> None:
    """A host that stalls for 0.5 s of a counter's 1.02 s, and then gets everything at once, counts each sample once."""
    counter = Counter(*SEQUENCE)
    for step in range(2000):  # 8 s
        truth, whole = counter.send(step / 250)
        assert truth == whole
    for step in range(2000, 2125):
        truth, whole = counter.send(step / 250, delay_s=8.5 - step / 250)
        assert truth == whole
    for step in range(2125, 2500):
        truth, whole = counter.send(step / 250)
        assert truth == whole


def test_a_first_message_that_comes_late_is_no_reason_to_go_back() -> None:
    """What was held up before the first message comes in a burst; the count goes on, it does not go back a round."""
    counter = Counter(*SEQUENCE)
    got = [counter.send(step / 250, delay_s=max(0.0, 0.45 - step / 250)) for step in range(500)]
    assert all(truth == whole for truth, whole in got)


@pytest.mark.parametrize("count", [0, 5000, 2**23])
def test_a_restart_is_passed_on_as_it_is(count: int) -> None:
    """A clock of 512 s that suddenly shows another time has been restarted: its own time goes on from there."""
    counter = Counter(24, 32768, offset=12_000_000)
    for step in range(200):
        counter.send(step)
    after = counter.unwrap(count)
    assert after == count
    assert counter.unwrap.restarts_total == 1
    assert counter.unwrap(count + 100) == count + 100


def test_a_restart_after_wraps_goes_back_to_small_counts() -> None:
    """The rounds before the restart are forgotten: the time goes back, and whoever reads it sees a reset."""
    counter = Counter(16, 1000)
    for step in range(231):
        truth, whole = counter.send(step)
    assert whole == truth == 230_000
    assert counter.unwrap(17) == 17


def test_the_same_message_twice_counts_the_same() -> None:
    """A repeated message is not a round later, and one that overtook another goes back by what it is older."""
    counter = Counter(*SEQUENCE)
    wholes = [counter.send(step / 250)[1] for step in (250, 255, 255, 254, 256, 257)]
    assert wholes[0] == 250
    assert [whole - wholes[0] for whole in wholes] == [0, 5, 5, 4, 6, 7]


@given(
    st.lists(st.tuples(st.integers(1, 400), st.floats(0, 0.25)), min_size=2, max_size=60), st.sampled_from([1, 12, 25])
)
def test_whatever_is_lost_and_however_late(steps: list[tuple[int, float]], frame: int) -> None:
    """Losses of up to 40 rounds, delays below a quarter of a round: the count is the true one, never a round late.

    After a gap in which the device's 2 % make as much, a message may seem sooner than any before by its whole delay.
    """
    counter, sent = Counter(*SEQUENCE), 0
    rounds_before = frame - frame % 256  # the first message tells none
    for lost, delay_s in [(1, 0.0), *steps]:
        sent += lost * frame
        truth, whole = counter.send(sent / 250, delay_s)
        assert truth == whole + rounds_before


def test_a_count_that_cannot_be_is_refused() -> None:
    """A count with more bits than the counter is a mistake in the driver."""
    with pytest.raises(ValueError, match="count 256 of a counter that ends at 255"):
        Unwrap(8, 250)(256)
    with pytest.raises(ValueError, match="must be above 0"):
        Unwrap(8, 0)


def test_ticks_in_ns_stay_exact() -> None:
    """A year of ticks at 32768 Hz is right to the nanosecond, which a float is not."""
    year = 365 * 86400
    assert ticks_ns(year * 32768 + 1, 32768) == year * 10**9 + 30518
