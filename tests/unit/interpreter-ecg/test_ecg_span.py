"""What is kept of the beats of the span of variability: the same as counting all of them anew each time."""

import math
from itertools import pairwise

import numpy as np
import pytest
from interpreter_ecg.morphology import Label
from interpreter_ecg.span import LONGEST_DOUBT_S, Doubt, Jitters, Labels
from sense4hri.stamps import SECOND_NS

MOST, SPAN_NS = 20, 30


@pytest.mark.parametrize("seed", range(5))
def test_counts_are_those_of_the_beats_that_are_kept(seed):
    """Beats come, the oldest go with time and where they are too many: the share is that of the ones still there."""
    random, labels, kept = np.random.default_rng(seed), Labels(MOST), []
    times_ns = np.cumsum(random.integers(1, 4, 300)).tolist()
    for time_ns, next_ns in pairwise(times_ns):
        label = list(Label)[random.integers(3)]
        labels.add(time_ns, label)
        kept = [*kept, (time_ns, label)][-MOST:]
        if random.random() < 0.3:
            start_ns, early = next_ns - SPAN_NS, int(random.integers(3))
            kept = [one for one in kept if one[0] > start_ns]
            told = [one for _, one in kept if one is not Label.UNCERTAIN]
            expected = 100 * (told.count(Label.ECTOPIC) + early) / len(told) if told else math.nan
            assert labels.ectopic_percent(start_ns, early) == pytest.approx(expected, nan_ok=True)


def test_without_a_beat_nothing_is_told():
    """No label, or only uncertain ones: not 0 %, but unknown."""
    labels = Labels(MOST)
    assert math.isnan(labels.ectopic_percent(0, 0))
    labels.add(1, Label.UNCERTAIN)
    assert math.isnan(labels.ectopic_percent(0, 0))


def test_jitters_are_those_of_the_newest_beats():
    """Older ones are forgotten, and of too many the oldest."""
    jitters = Jitters(MOST)
    for n in range(50):
        jitters.add(n, n / 10)
    assert jitters.after(45).tolist() == [4.6, 4.7, 4.8, 4.9]
    assert len(jitters.after(49)) == 0


@pytest.mark.parametrize(("doubtful_s", "longer_s"), [(1, 1), (5, 5), (200, LONGEST_DOUBT_S)])
def test_a_doubt_lasts_as_long_again(doubtful_s, longer_s):
    """After so many seconds in doubt, one look each, so many more, at most 20; without a look it stays."""
    doubt, at_s = Doubt(0), 0

    def lasts(doubtful):
        nonlocal at_s
        at_s += 1
        return doubt.lasts(doubtful, at_s * SECOND_NS)

    assert not lasts(False)
    assert all(lasts(True) for _ in range(doubtful_s))
    assert all(lasts(None) for _ in range(30))
    assert sum(lasts(False) for _ in range(60)) == longer_s - 1
