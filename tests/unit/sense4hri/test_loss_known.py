"""Whether a driver can know what is missing: where it cannot, health says -1 and never 0."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from sense4hri.chunk import Chunk
from sense4hri.device import Feature, Reported, Samples, Stream
from sense4hri.health import Link, State, health_message
from sense4hri.outlet import Outlet


def told(rate_hz, *items):
    """What health says of lost samples once these have been published; rate_hz: None where there is no raw."""
    outlet = outlet_of(rate_hz)
    for item in items:
        (outlet.report if isinstance(item, Reported) else outlet.publish)(item)
    return health_message("box_1", State.STREAMING, outlet.nominal_hz, Link(), outlet.counts).lost_samples_total


def outlet_of(rate_hz):
    """An outlet of one channel, open."""
    made = Outlet(
        SimpleNamespace(metrics=MagicMock(), publisher=MagicMock()),
        "eda",
        "box_1",
        None if rate_hz is None else Stream(rate_hz, "uS", 0.0, 100.0, 16, ("eda",)),
    )
    made.open("p1")
    return made


def samples(device_ns, **given):
    return Samples("eda", Chunk(("eda",), np.zeros((1, 1)), device_ns, 10**18), **given)


@pytest.mark.parametrize(
    ("rate_hz", "items", "lost"),
    [
        (None, [Reported("eda", 10**18, None, (Feature("heart_rate", "1/min", (61.0,)),))], -1),
        (4.0, [], -1),
        (4.0, [samples(None)], -1),
        (0.0, [samples(10**9)], -1),
        (4.0, [samples(10**9)], 0),
        (4.0, [samples(10**9), samples(10**9 + 750_000_000)], 2),
        (4.0, [samples(None, lost=0), samples(None, lost=3)], 3),
        (0.0, [samples(10**9, lost=1)], 1),
        (4.0, [samples(2**63 - 1)], -1),
    ],
)
def test_a_loss_is_known_by_a_count_or_by_device_time_at_a_rate(rate_hz, items, lost):
    """Reports alone, no samples yet, no device time or no rate tell of no loss, unless the device counts."""
    assert told(rate_hz, *items) == lost


def counted(frames, n=10):
    """What is lost, and gaps, of frames of n at 100 Hz: (device time in s, receipt in s, lost by the count)."""
    made = outlet_of(100.0)
    for device_s, received_s, lost in frames:
        chunk = Chunk(("eda",), np.zeros((n, 1)), round(device_s * 1e9), 10**18 + round(received_s * 1e9))
        made.publish(Samples("eda", chunk, lost=lost))
    return made.counts.lost_samples_total, made.counts.gaps_total


@pytest.mark.parametrize("jitter", [0.0, 0.1, 0.3, 0.6])
def test_what_count_and_clock_both_tell_is_counted_once(jitter):
    """A clock that jitters tells of a lost frame some frames after the count has told; it is the same frame."""
    rng = np.random.default_rng(1)
    kept = np.flatnonzero((rng.random(2000) > 0.01) | (np.arange(2000) < 100))
    times_s = 1 + (kept + rng.uniform(0, jitter, len(kept))) / 10
    missing = np.diff(kept, prepend=-1) - 1
    frames = zip(times_s, times_s, (10 * missing).tolist(), strict=True)
    assert counted(frames) == (10 * missing.sum(), np.count_nonzero(missing))


def test_what_the_clock_tells_beyond_the_count_is_counted():
    """A round of 256 frames and four are missing, of which a count of 8 bits tells four; later 100 that it does not."""
    times_s = np.concatenate([np.arange(20), np.arange(280, 300), np.arange(400, 420)]) / 10
    lost = [0] * 20 + [40] + [0] * 39
    assert counted(zip(times_s, times_s, lost, strict=True)) == (3600, 2)


def test_a_frame_cut_at_a_hole_is_missed_once():
    """Each sample has its time, and the device counts: three are missing in the middle of a frame, and no more."""
    made = outlet_of(100.0)
    times_ns = np.concatenate([np.arange(1, 21), np.arange(24, 54)]) * 10_000_000
    for at in range(0, 50, 25):
        chunk = Chunk(("eda",), np.zeros((25, 1)), int(times_ns[at + 24]), 10**18 + at)
        made.publish(Samples("eda", chunk, times_ns[at : at + 25], lost=0 if at else 3))
    assert (made.counts.lost_samples_total, made.counts.gaps_total) == (3, 1)
