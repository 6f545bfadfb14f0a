"""Sample times of devices without a clock of their own: by when their messages come, and how many samples came."""

import numpy as np
import pytest
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import SampleClock

FS_HZ, FRAME = 100.0, 10
BEGUN_S = 1_000_000.0


def placed(came_s: np.ndarray) -> tuple[np.ndarray, list[Break | None]]:
    """Times in s of the last sample of each message, and the breaks, of messages that came at these times."""
    clock = SampleClock(FS_HZ)
    chunks = [Chunk(("a",), np.zeros((FRAME, 1)), None, round((BEGUN_S + at_s) * 1e9)) for at_s in came_s.tolist()]
    timed = [clock.place(chunk) for chunk in chunks]
    return np.array([each.times_ns[-1] / 1e9 - BEGUN_S for each in timed]), [each.break_ for each in timed]


def link(sent_s: np.ndarray, held_s: np.ndarray | float = 0.0) -> np.ndarray:
    """When messages come that were sent then, in order, over a link that takes 10 ms on average."""
    late_s = np.random.default_rng(1).exponential(0.01, len(sent_s))
    return np.maximum.accumulate(sent_s + held_s + late_s) + np.arange(len(sent_s)) * 1e-6


@pytest.mark.parametrize("lost_s", [0.4, 0.8])
def test_what_was_lost_costs_times_for_a_second(lost_s: float) -> None:
    """Less than a second is missing: it is told as a gap, and the times after that are right."""
    sent_s = np.arange(1, 901) * FRAME / FS_HZ
    sent_s = sent_s[(sent_s <= 30) | (sent_s > 30 + lost_s)]
    times_s, breaks = placed(link(sent_s))
    after = sent_s > 30 + lost_s + 1.3
    assert np.abs(times_s - sent_s)[after].max() < 0.05
    assert breaks.count(Break.GAP) == 1


@pytest.mark.parametrize("catching_up", [0.0, 0.3])
def test_what_was_held_up_is_no_gap(catching_up: float) -> None:
    """A link that stands for 0.8 s now and then and delivers at once, or at three times the pace, has lost nothing."""
    sent_s = np.arange(1, 3001) * FRAME / FS_HZ
    into_s = sent_s % 13.0
    held_s = np.where(into_s < 0.8, 0.8 - into_s * (1 - catching_up), 0.0)
    times_s, breaks = placed(link(sent_s, held_s))
    assert breaks.count(None) == len(breaks) - 1
    assert np.abs(times_s - sent_s)[100:].max() < 0.15


@pytest.mark.parametrize("back_s", [0.2, 0.5, 0.9])
def test_a_clock_that_is_set_back_costs_times_for_a_second(back_s: float) -> None:
    """It is told as a reset within 1.3 s, and the times after that are those of the clock as it is now."""
    sent_s = np.arange(1, 3001) * FRAME / FS_HZ
    true_s = np.where(sent_s > 120, sent_s - back_s, sent_s)
    late_s = np.random.default_rng(1).exponential(0.005, len(sent_s))
    times_s, breaks = placed(true_s + late_s)
    assert np.abs(times_s - true_s)[(sent_s < 120) | (sent_s > 121.3)].max() < 0.03
    assert [each for each in breaks if each] == [Break.FIRST, Break.RESET]


@pytest.mark.parametrize("every_s", [1.9, 2.5, 5.0])
def test_what_a_link_that_often_stands_does_not_hold_up_is_no_reset(every_s: float) -> None:
    """Messages that come at once are early beside the many that do not, and the clock is what it was."""
    sent_s = np.arange(1, 6001) * FRAME / FS_HZ
    begun_s = np.cumsum(np.random.default_rng(2).exponential(every_s, 1000))
    last_s = begun_s[np.maximum(np.searchsorted(begun_s, sent_s) - 1, 0)]
    held_s = np.where((sent_s >= last_s) & (sent_s < last_s + 0.8), last_s + 0.8 - sent_s, 0.0)
    _, breaks = placed(link(sent_s, held_s))
    assert Break.RESET not in breaks
