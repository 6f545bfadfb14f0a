"""sense4hri.motion: what an accelerometer says of an update of another stream of its device."""

import numpy as np
import pytest
from sense4hri.chunk import Chunk
from sense4hri.feed import Beside, Feed
from sense4hri.motion import Motion
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

FS_HZ, SECOND_NS = 52.0, 10**9
XYZ = ("x", "y", "z")
INFO = StreamInfo(StreamName("p1", "accelerometer", "s1"), FS_HZ, "m/s^2", XYZ)


def motion_of(acceleration, info=INFO):
    """Everything taken, a second at a time; the last sample of each is received on the second."""
    motion, clock = Motion(), SampleClock(FS_HZ)
    for i in range(0, len(acceleration), round(FS_HZ)):
        part = acceleration[i : i + round(FS_HZ)]
        stamp_ns = (i + len(part)) * SECOND_NS // round(FS_HZ)
        motion.take(info, clock.place(Chunk(XYZ, part, stamp_ns, stamp_ns)))
    return motion


def steps(hz, seconds=20, strength=3.0):
    """Gravity, and a sine on another axis."""
    t_s = np.arange(round(seconds * FS_HZ)) / FS_HZ
    return np.stack([strength * np.sin(2 * np.pi * hz * t_s), 0 * t_s, 0 * t_s + 9.81], axis=1)


def test_gravity_is_no_motion():
    """A device at rest, breathing and beating by 0.1 m/s^2, does not move, whatever its pulse."""
    still = motion_of(steps(1.2, strength=0.1)).at(20 * SECOND_NS, 10.0)
    assert (still.strength, still.rhythm(1.2)) == (0.0, 0.0)


def test_another_posture_moves_for_as_long_as_it_is_taken():
    """Somebody leans back by half of gravity: he moves in those 10 s, and not for a minute as much as one who walks."""
    upright, back = (np.tile(each, (round(30 * FS_HZ), 1)) for each in ((0.0, 0.0, 9.81), (4.9, 0.0, 8.5)))
    motion = motion_of(np.concatenate([upright, upright[: round(5 * FS_HZ)], back])[: round(60 * FS_HZ)])
    assert motion.at(41 * SECOND_NS, 10.0).strength == 1.0
    assert 0.3 < motion.at(61 * SECOND_NS, 60.0).strength < 0.6


@pytest.mark.parametrize("hz", [1.0, 1.9, 2.5])
def test_steps_have_their_rhythm(hz):
    """Nearly all power is at the rate of the steps, none at half of it or a third beside."""
    moved = motion_of(steps(hz)).at(20 * SECOND_NS, 10.0)
    assert moved.rms_m_s2 == pytest.approx(3 / np.sqrt(2), rel=0.05)
    assert moved.strength == 1.0
    assert moved.rhythm(hz) > 0.9
    assert max(moved.rhythm(hz / 2), moved.rhythm(1.35 * hz)) < 0.1


def test_a_rhythm_takes_four_seconds_to_tell():
    """Of a device that moves the rhythm is not known before, NaN and not 0; one at rest has none."""
    assert np.isnan(motion_of(steps(2.0, 3)).at(5 * SECOND_NS, 10.0).rhythm(2.0))
    assert motion_of(steps(2.0, 5)).at(7 * SECOND_NS, 10.0).rhythm(2.0) > 0.5
    assert motion_of(steps(2.0, 3, strength=0.1)).at(5 * SECOND_NS, 10.0).rhythm(2.0) == 0.0


def test_only_what_every_replay_has_by_then():
    """What was received less than a second before the update, or before its window, is not looked at."""
    acceleration = np.concatenate([steps(2.0, 10), steps(2.0, 10, strength=0.0)])
    motion = motion_of(acceleration)
    assert motion.at(round(10.9 * SECOND_NS), 4.0).strength == 1.0
    assert motion.at(round(15.5 * SECOND_NS), 4.0).strength == 0.0
    assert motion.at(round(10.9 * SECOND_NS), 0.5).strength == 0.0, "the chunk of 10 s came 0.9 s before"


def test_what_is_no_acceleration_says_nothing():
    """Another unit, no sample, one sample, NaN: no motion."""
    raw = StreamInfo(INFO.name, FS_HZ, "a.u.", XYZ)
    for motion in (motion_of(steps(2.0), raw), Motion(), motion_of(steps(2.0)[:1]), motion_of(np.nan * steps(2.0))):
        moved = motion.at(20 * SECOND_NS, 30.0)
        assert (moved.rms_m_s2, moved.strength, moved.rhythm(2.0)) == (0.0, 0.0, 0.0)


class Witness:
    """A step that takes evidence."""

    def __init__(self, info):
        self.pushed, self.seen = [], []

    def push(self, timed):
        self.pushed.append(timed)
        return [(len(self.pushed), len(self.seen))]

    def evidence(self, info, timed):
        self.seen.append((info, timed))


def test_nothing_waits_for_evidence():
    """A raw message is used at once; each chunk beside it is told once, with sample times of its own."""
    feed = Feed(Witness, 1.0)
    feed.know(StreamInfo(StreamName("p1", "ppg", "s1"), 55.0, "counts", ("ppg_0",)))
    chunk = Chunk(XYZ, steps(2.0, 1), SECOND_NS, SECOND_NS)
    raw = [Chunk(("ppg_0",), np.zeros((55, 1)), n * SECOND_NS, n * SECOND_NS) for n in (1, 2)]
    assert feed.put(raw[0]) == [(1, 0)]
    for _ in range(2):
        assert feed.put(Beside(SECOND_NS, INFO, chunk)) == []
    assert feed.put(raw[1]) == [(2, 1)]
