"""What in one segment is not of the brain: electrodes that jump or hang loose, blinks. Stateless.

Segments are of shape (n, channels), evenly spaced at fs_hz. `floor` is the least size in the signal's unit that counts,
0 where its scale is not known; besides, everything must stand out of the channel's own noise.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from interpreter_eeg.montage import BEHIND, FOREHEAD, Montage

FLAT_UV = 0.5  # peak to peak, in a segment: less is no EEG
LARGE_UV = 1000.0  # rms of the bands, in a segment: more is no EEG, and of a whole window it is another unit
GREATEST = 1e12  # in whatever unit; more is no measurement, and its square would be no number
AT_OWN_END = 0.1  # likewise where no range is known: fewer hardly change a power
PILED = 3  # times as many samples as at the value beside it
AT_RAIL = 0.02  # share of the samples at an end of the range
MISSING, LONGEST_MISSING_S = 0.1, 0.15  # share of a segment, and length, up to which missing samples are drawn through
JUMP_S, AROUND_S, JUMP, JUMP_NOISES, JUMP_SPREADS, JUMP_UV = 0.016, 0.1, 0.6, 10.0, 3.0, 40.0
SMOOTH_S, BLINK_NOISES, BLINK_S = 0.06, 5.0, (0.04, 0.6)  # width at half height
BOTH_SIDES = 0.3  # of the other side's height that a blink has at least
SHARE_BEHIND = 0.4  # of a blink's height that electrodes behind the forehead show
# Of a blink: how far round its peak, and from which share of its height or of a channel's noise a segment is spoilt.
NEAR_S, SPREADS, STANDS_OUT = 0.1, 0.3, 2.5
ROBUST = 1.4826

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Blinks(NamedTuple):
    """peaks: indices of greatest closure. spoilt: shape (channels,), which channels show one of them."""

    peaks: list[int]
    spoilt: Bools


def known(samples: Floats) -> Bools:
    """Return which samples are numbers that a sensor can have measured."""
    return np.asarray(np.abs(samples) <= GREATEST)


def drawn_through(segment: Floats, fs_hz: float) -> tuple[Floats, Bools]:
    """Return the segment with short holes (NaN) drawn through, and which channels have too many of them."""
    bad = ~known(segment)
    if not bad.any():
        return segment, np.zeros(segment.shape[1], bool)
    out, missing = segment.copy(), np.zeros(segment.shape[1], bool)
    for column in np.flatnonzero(bad.any(axis=0)):
        good = np.flatnonzero(~bad[:, column])
        longest = np.diff(good, prepend=-1, append=len(bad)).max() - 1
        missing[column] = len(good) < (1 - MISSING) * len(bad) or longest > LONGEST_MISSING_S * fs_hz
        out[:, column] = 0.0 if missing[column] else np.interp(np.arange(len(bad)), good, segment[good, column])
    return out, missing


def flat(segment: Floats, floor: float | Floats) -> Bools:
    """Return which channels do not move."""
    return np.asarray(np.ptp(segment, axis=0) <= floor)


def saturated(segment: Floats, low: float, high: float) -> Bools:
    """Return which channels lie at an end of the range; where it is not known, at values of their own that cut them."""
    ends = np.array([low, high]) if low < high else np.array([segment.min(axis=0), segment.max(axis=0)])
    least = AT_RAIL if low < high else AT_OWN_END
    railed = np.asarray(((segment <= ends[0]) | (segment >= ends[1])).mean(axis=0) > least)
    if not low < high:
        for column in np.flatnonzero(railed):
            railed[column] = _is_cut(segment[:, column])
    return railed


def _is_cut(values: Floats) -> bool:
    """Whether values pile up at the least or the greatest of them; those of a coarse converter grow rarer there."""
    counts = np.unique(values, return_counts=True)[1]
    return len(counts) > 2 and bool(counts[0] > PILED * counts[1] or counts[-1] > PILED * counts[-2])


def pops(segment: Floats, fs_hz: float, floor: float) -> list[Floats]:
    """Return, per channel, where (index) an electrode pops: a jump that most of the change around it happens in."""
    lag, around = max(1, round(JUMP_S * fs_hz)), max(3, round(AROUND_S * fs_hz))
    step = segment[lag:] - segment[:-lag]
    noise = np.maximum(JUMP_NOISES * ROBUST * np.median(np.abs(step), axis=0), JUMP_SPREADS * step.std(axis=0))
    least = np.maximum(floor, noise)
    found = [np.empty(0) for _ in least]
    for column in np.flatnonzero((np.abs(step) > least).any(axis=0)):
        high = np.flatnonzero(np.abs(step[:, column]) > least[column])
        runs = np.split(high, 1 + np.flatnonzero(np.diff(high) > around))
        tops = [run[np.argmax(np.abs(step[run, column]))] for run in runs]
        found[column] = np.array([top for top in tops if _is_jump(segment[:, column], int(top), lag, around)], float)
    return found


def _is_jump(values: Floats, top: int, lag: int, around: int) -> bool:
    """Whether the values round the change span hardly more than the change itself: a blink rises more slowly."""
    beyond = (around - lag) // 2
    near = values[max(0, top - beyond) : top + lag + beyond + 1]
    return bool(abs(values[top + lag] - values[top]) >= JUMP * np.ptp(near))


def smoothed(segment: Floats, fs_hz: float) -> Floats:
    """Return means over SMOOTH_S round each sample; at both ends over what there is."""
    reach = max(1, round(SMOOTH_S * fs_hz / 2))
    total = np.cumsum(np.pad(segment, ((reach + 1, reach), (0, 0)), mode="edge"), axis=0)
    return np.asarray((total[2 * reach + 1 :] - total[: -2 * reach - 1]) / (2 * reach + 1))


def blinks(segment: Floats, fs_hz: float, montage: Montage, usable: Bools, floor: float) -> Blinks:
    """Return the blinks that the usable electrodes of the forehead see: on both sides, where both are there.

    Without any of them those behind it have to do: what stands out there spoils channels, but is counted as no blink.
    """
    sides = [[column for column in montage.present(side) if usable[column]] for side in FOREHEAD]
    level = smoothed(segment, fs_hz)
    level -= np.median(level, axis=0)
    if not any(sides):
        return Blinks([], _behind(level, fs_hz, montage, usable, floor))
    left, right = (level[:, side].mean(axis=1) if side else None for side in sides[:2])
    forehead = _levelled(level[:, [column for side in sides for column in side]].mean(axis=1))
    peaks = [peak for peak in _bumps(forehead, fs_hz, floor) if _on_both_sides(left, right, peak)]
    return Blinks(peaks, _spoilt(level, forehead, peaks, fs_hz))


def _behind(level: Floats, fs_hz: float, montage: Montage, usable: Bools, floor: float) -> Bools:
    """Return which channels show what would be a blink by the usable electrodes behind the forehead.

    Without any of them each electrode of the scalp tells of itself: of those without a name one may be at the forehead.
    """
    columns = [column for column in montage.present(BEHIND) if usable[column]]
    least = SHARE_BEHIND * floor
    if columns:
        nearest = _levelled(level[:, columns].mean(axis=1))
        return _spoilt(level, nearest, _bumps(nearest, fs_hz, least), fs_hz)
    alone = montage.scalp & usable
    return np.array([bool(alone[k]) and bool(_bumps(_levelled(level[:, k]), fs_hz, least)) for k in range(len(alone))])


def _spoilt(level: Floats, seen: Floats, peaks: list[int], fs_hz: float) -> Bools:
    """Return which channels show one of the blinks that were seen with these peaks."""
    reach = [_reached(level, seen, peak, max(1, round(NEAR_S * fs_hz))) for peak in peaks]
    return np.asarray(np.any(reach, axis=0)) if reach else np.zeros(level.shape[1], bool)


def _levelled(level: Floats) -> Floats:
    """Without the line from the usual value of the first half to that of the second: a blink near an end tilts none."""
    half = len(level) // 2
    first, second = float(np.median(level[:half])), float(np.median(level[half:]))
    return level - (first + second) / 2 - 2 * (second - first) * (np.arange(len(level)) / len(level) - 0.5)


def _reached(level: Floats, forehead: Floats, peak: int, reach: int) -> Bools:
    """Which channels a blink has come to: what they share with it, from `reach` samples before its peak to behind."""
    near = slice(max(0, peak - reach), peak + reach + 1)
    blink, noise = forehead[near], STANDS_OUT * ROBUST * np.median(np.abs(level), axis=0)
    return np.asarray(np.abs(blink @ level[near]) > np.minimum(SPREADS * (blink @ blink), noise * np.abs(blink).sum()))


def _bumps(level: Floats, fs_hz: float, floor: float) -> list[int]:
    least = max(floor, BLINK_NOISES * ROBUST * float(np.median(np.abs(level))))
    high = np.flatnonzero(np.abs(level) > least)
    runs = np.split(high, 1 + np.flatnonzero(np.diff(high) > 1)) if len(high) else []
    tops = [int(run[np.argmax(np.abs(level[run]))]) for run in runs]
    return [top for top in tops if BLINK_S[0] <= _width(level, top) / fs_hz <= BLINK_S[1]]


def _width(level: Floats, top: int) -> int:
    """The samples round the top that are at least half as high."""
    low = np.flatnonzero(level * np.sign(level[top]) < abs(level[top]) / 2)
    at = int(np.searchsorted(low, top))
    first = int(low[at - 1]) if at else -1
    last = int(low[at]) if at < len(low) else len(level)
    return last - first - 1


def _on_both_sides(left: Floats | None, right: Floats | None, peak: int) -> bool:
    if left is None or right is None:
        return True
    small, great = sorted((float(left[peak]), float(right[peak])), key=abs)
    return small * great > 0 and abs(small) >= BOTH_SIDES * abs(great)
