"""A real recording, and the blinks told in it by eye (blinks_by_hand.csv; blinks_by_hand.png shows them).

The list was made from plots, in which the marks of NeuroKit2's four methods were shown too, and fixed before the
interpreter was first run on it.
"""

from pathlib import Path

import numpy as np
import pytest
from interpreter_eog.config import Config
from interpreter_eog.stream import EogStream
from slow_signals import event_times_s, play

HAND = np.genfromtxt(Path(__file__).with_name("blinks_by_hand.csv"), delimiter=",", names=True)
NEAR_S = 0.15
TIMES_S = np.arange(12_000) / 100.0


@pytest.fixture(scope="module")
def veog(shared_data):
    """Two minutes in uV at 100 Hz."""
    return 1e6 * np.genfromtxt(shared_data / "eog" / "neurokit" / "eog_100hz.csv", skip_header=1)


def score(samples, unit="uV"):
    """(sensitivity, precision) against the clear blinks; who finds a doubtful one is neither right nor wrong."""
    updates = play(lambda info: EogStream(Config(), info), samples, 100.0, "eog", unit, names=("veog",))
    found = event_times_s(updates, "blink_timestamps")
    clear, doubtful = (HAND["time_s"][HAND["clear"] == kind] for kind in (1, 0))
    apart_s = np.abs(found[:, None] - clear)
    right, open_ = (apart_s < NEAR_S).any(axis=1), (np.abs(found[:, None] - doubtful) < NEAR_S).any(axis=1)
    return (apart_s < NEAR_S).any(axis=0).mean(), right.sum() / (~open_).sum()


@pytest.mark.parametrize(
    ("change", "unit"),
    [
        (lambda x: x, "uV"),
        (lambda x: -x, "uV"),
        (lambda x: x + 200 * np.sin(2 * np.pi * TIMES_S / 60) + 3 * TIMES_S, "uV"),
        (lambda x: 2048 + 3.7 * x, "counts"),
    ],
    ids=["as it is", "swapped", "drift", "counts"],
)
def test_nine_of_ten_blinks_are_found_and_nine_of_ten_are_blinks(veog, change, unit):
    """As recorded, with swapped electrodes, on a drift of 200 uV, and without a scale."""
    sensitivity, precision = score(change(veog), unit)
    assert sensitivity >= 0.9
    assert precision >= 0.9


def test_no_blink_of_the_recording_is_doubted(veog):
    """An eye is never taken for noise that wanders, and its quality is good."""
    updates = play(lambda info: EogStream(Config(), info), veog, 100.0, "eog", "uV", names=("veog",))
    assert not [reason for update in updates for reason in update.reasons if "veog wanders" in reason]
    assert np.median([update.signal_quality for update in updates]) > 0.8
