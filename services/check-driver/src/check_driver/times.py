"""Stamps, rates and losses of the raw messages of one stream (contract, section 3). Pure: frames in, findings out."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS

from check_driver.findings import Findings
from check_driver.heard import COPIED, SAME_NS, WENT_BACK, Frame

OFF = 0.1
"""Share by which a rate may differ from the declared one."""
CLOCK_OFF = 0.02
"""Share by which a device's clock may run faster or slower than the host's, as short as we listen."""
LEAST_S, LEAST_FRAMES = 5.0, 10
REORDERED_S = 0.5
"""A driver that puts late samples in order by their device times passes on when each of them came."""


def check(frames: list[Frame], rate_hz: float, topic: str, findings: Findings) -> bool:
    """Find what is wrong with the stamps of a stream; True where nothing is, so that losses can be counted by them.

    rate_hz: as declared; 0 = irregular, NaN = not said.
    """
    found = len(findings.departures())
    stamps, device = [frame.stamp_ns for frame in frames], [frame.device_ns for frame in frames]
    for before, after in pairwise(stamps):
        if after < before and all(device) and before - after < REORDERED_S * SECOND_NS:
            findings.remark(topic, f"header.stamp goes back, by less than {REORDERED_S:g} s: samples put in order?")
        elif after < before:
            findings.wrong(3, topic, "header.stamp goes back")
    if 0 in device and any(device):
        findings.wrong(3, topic, "device_timestamp is sometimes zero, sometimes not")
    elif any(device):
        _device_times(frames, topic, findings)
    if rate_hz == 0:
        _irregular(frames, topic, findings)
    if rate_hz > 0 and len(frames) >= LEAST_FRAMES:
        _rates(frames, rate_hz, topic, findings)
        if len(findings.departures()) == found:
            _whose_stamp(frames, rate_hz, topic, findings)
    return len(findings.departures()) == found


def _device_times(frames: list[Frame], topic: str, findings: Findings) -> None:
    for before, after in pairwise(frames):
        if after.device_ns == before.device_ns:
            findings.wrong(3, topic, "device_timestamp stands still: two messages have the same")
        elif after.device_ns < before.device_ns:
            findings.wrong(3, topic, WENT_BACK)
    near = sum(abs(frame.device_ns - frame.stamp_ns) < SAME_NS for frame in frames)
    if near > len(frames) / 2:
        findings.wrong(3, topic, COPIED)


def long_enough(frames: list[Frame]) -> bool:
    """Whether they tell a rate: in fewer seconds a stall of a busy machine is most of the time."""
    return len(frames) >= LEAST_FRAMES and frames[-1].stamp_ns - frames[0].stamp_ns >= LEAST_S * SECOND_NS


def paces(frames: list[Frame], clock: str = "stamp_ns") -> NDArray[np.float64]:
    """Return samples in a second between all pairs of frames with half of the frames between them.

    clock: by whose time, `stamp_ns` of the host or `device_ns`. Their median is the rate: a stall, and the burst after
    it, does not matter. Of a few seconds it matters all the same, but shows in how far they lie apart.
    """
    stamps = np.array([getattr(frame, clock) for frame in frames], dtype=np.int64)
    counts, half = np.cumsum([frame.n for frame in frames]), len(frames) // 2
    seconds = np.maximum(stamps[half:] - stamps[:-half], 1) / SECOND_NS
    return np.asarray((counts[half:] - counts[:-half]) / seconds)


def gained_s(frames: list[Frame]) -> float:
    """Return the seconds of the device in a second of the host; NaN without a device's clock.

    From the frame that was under way for the shortest time in the first fifth to that of the third, and from there to
    that of the last. Of the two what is nearer to 1, and 1 between them: a clock is off all the time, and in one
    direction; a machine that falls behind or catches up is so for a while.
    """
    if not all(frame.device_ns for frame in frames):
        return math.nan
    fifth = max(len(frames) // 5, 1)
    parts = [frames[:fifth], frames[2 * fifth : 3 * fifth], frames[-fifth:]]
    soonest = [min(part, key=lambda frame: frame.stamp_ns - frame.device_ns) for part in parts]
    halves = [
        (after.device_ns - before.device_ns) / max(after.stamp_ns - before.stamp_ns, 1)
        for before, after in pairwise(soonest)
    ]
    return float(np.median([*halves, 1.0]))


def _rates(frames: list[Frame], rate_hz: float, topic: str, findings: Findings) -> None:
    """Samples per second by each clock, against the declared rate and each other.

    A rate is wrong by both: a machine that falls behind is no driver's fault, and a clock in a wrong unit its own one.
    """
    if not long_enough(frames):
        return
    clocks = ("stamp_ns", "device_ns") if all(frame.device_ns for frame in frames) else ("stamp_ns",)
    by_clock = [float(np.median(paces(frames, clock))) for clock in clocks]
    came_hz = min(by_clock, key=lambda hz: abs(hz / rate_hz - 1))
    if abs(came_hz / rate_hz - 1) > OFF:
        findings.wrong(6, topic, f"{came_hz:.4g} samples/s came, {rate_hz:g} Hz are declared")
    _pace(gained_s(frames), CLOCK_OFF, topic, findings)


def _irregular(frames: list[Frame], topic: str, findings: Findings) -> None:
    """Of few events, some of them passed on late, only another unit of time shows in the pace of the device's clock."""
    if any(frame.n > 1 for frame in frames):
        findings.wrong(3, topic, "the rate is 0 (irregular) and a message holds more than one sample")
    if long_enough(frames):
        _pace(gained_s(frames), OFF, topic, findings)


def _pace(gained: float, off: float, topic: str, findings: Findings) -> None:
    if abs(gained - 1) > off:
        findings.wrong(3, topic, f"device_timestamp gains {gained:.4g} s in a second of the host")


def _whose_stamp(frames: list[Frame], rate_hz: float, topic: str, findings: Findings) -> None:
    """Tell stamps of the last sample from those of the first, where messages hold now more, now fewer samples."""
    n = np.array([frame.n for frame in frames])
    if np.ptp(n) == 0:
        return
    clock = "device_timestamp" if all(frame.device_ns for frame in frames) else "header.stamp"
    stamps = [frame.device_ns if clock == "device_timestamp" else frame.stamp_ns for frame in frames]
    steps = np.diff(np.array(stamps, dtype=np.int64)) / SECOND_NS * rate_hz
    changing = n[1:] != n[:-1]
    if changing.sum() < LEAST_FRAMES // 2:
        return
    of_last, of_first = (float(np.median(np.abs(steps - counts)[changing])) for counts in (n[1:], n[:-1]))
    if of_first < of_last / 2:
        findings.wrong(3, topic, f"{clock} follows the number of samples before it: stamps must be of the last sample")


def lost(frames: list[Frame], rate_hz: float) -> list[tuple[float, int]] | None:
    """Return when samples were found missing by device time, and how many; None where it cannot be told."""
    if not rate_hz > 0 or not frames or not all(frame.device_ns for frame in frames):
        return None
    clock, found = SampleClock(rate_hz), list[tuple[float, int]]()
    for frame in frames:
        timed = clock.place(Chunk(("x",), np.zeros((frame.n, 1)), frame.device_ns, frame.stamp_ns))
        if timed.break_ is Break.GAP:
            found.append((frame.heard_s, timed.lost))
    return found
