"""The last seconds of one stream's pupils, cleaned anew at each update; each sample is settled once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.living import LONGEST_HELD_S, held
from sense4hri.stamps import SECOND_NS

from interpreter_pupillometry.features import Pupils, together, valid_sizes

LOOK_S = 10.0  # of the past from which limits come
DELAY_S = 0.1  # by which sizes are late: what follows may show that a blink begins
OFFSET_S = 60.0  # over which the difference between the eyes is learned

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


class Settled(NamedTuple):
    """Samples that will not change any more, shape (n,): sizes drawn through short gaps, NaN in long ones.

    gaps_ns: (last pupil before, first after) of every gap that was drawn through.
    """

    times_ns: Times
    sizes: Floats
    valid: NDArray[np.bool_]
    gaps_ns: list[tuple[int, int]]


class Cleaning:
    """mm: sizes are in mm, so that their range is known. kept_s: at least so much of the past can be seen."""

    def __init__(self, mm: bool, longest_gap_s: float, kept_s: float) -> None:
        self._mm, self._longest_ns = mm, round(longest_gap_s * SECOND_NS)
        self._kept_ns = round(max(LOOK_S, kept_s + 1) * SECOND_NS)
        self._offset = np.zeros(2)  # samples with both eyes, and the sum of their differences
        self.restart()

    def restart(self) -> None:
        """Samples are missing: nothing is drawn through from before; what is usual between the eyes holds."""
        self.times_ns = np.empty(0, np.int64)
        self._eyes = np.empty((0, 2))
        self._settled_ns = self._told_ns = -(2**62)
        nothing = np.empty(0)
        self.pupils = Pupils(nothing, nothing, nothing, np.empty(0, bool))

    def push(self, times_ns: Times, eyes: Floats, whole: bool) -> Settled:
        """Take the next samples, shape (n, 2), n > 0: left, right; return what is settled. whole: nothing follows."""
        self._eyes = np.concatenate([self._eyes, eyes])
        self.times_ns = np.concatenate([self.times_ns, times_ns])
        first = int(np.searchsorted(self.times_ns, self.times_ns[-1] - self._kept_ns))
        self._eyes, self.times_ns = self._eyes[first:], self.times_ns[first:]
        left, right = (self._cleaned(self._eyes[:, k]) for k in (0, 1))
        self._learn_offset((left - right)[-len(times_ns) :], times_ns)
        n, total = self._offset
        size = together(left, right, total / n if n else np.nan)
        self.pupils = Pupils(left, right, size, np.isfinite(size))
        return self._settle(whole)

    def end(self) -> Settled:
        """Return what is left: nothing follows the samples that came."""
        return self._settle(whole=True)

    def void(self, eye: int, since_ns: int) -> None:
        """What this column holds from then on is no pupil."""
        self._eyes[self.times_ns >= since_ns, eye] = np.nan

    def _cleaned(self, sizes: Floats) -> Floats:
        sizes = np.where(self._held(sizes), np.nan, sizes)
        return np.where(valid_sizes(sizes, self.times_ns, self._mm), sizes, np.nan)

    def _held(self, sizes: Floats) -> NDArray[np.bool_]:
        """Which samples repeat one size for longer than a pupil that the tracker sees; zeros, of a lost eye, do not."""
        span_s = (self.times_ns[-1] - self.times_ns[0]) / SECOND_NS
        longest = LONGEST_HELD_S * (len(sizes) - 1) / span_s if span_s > 0 else np.inf
        return held(np.where(sizes > 0, sizes, np.nan)[:, None], longest)[:, 0]

    def _learn_offset(self, differences: Floats, times_ns: Times) -> None:
        known = differences[np.isfinite(differences)]
        keep = max(0.0, 1 - (times_ns[-1] - times_ns[0]) / (OFFSET_S * SECOND_NS))
        self._offset = keep * self._offset + np.array([len(known), known.sum()])

    def _settle(self, whole: bool) -> Settled:
        times_ns, valid = self.times_ns, self.pupils.valid
        until_ns = self._until_ns(0 if whole else round(DELAY_S * SECOND_NS))
        here = (times_ns > self._settled_ns) & (times_ns <= until_ns)
        sizes, gaps_ns = self._drawn_through(until_ns)
        settled = Settled(times_ns[here], sizes[here], valid[here], gaps_ns)
        self._settled_ns = max(self._settled_ns, until_ns)
        return settled

    def _until_ns(self, delay_ns: int) -> int:
        """Up to where nothing can change: the last pupil before a gap that is still open, unless it is long by now."""
        latest_ns = int(self.times_ns[-1]) - delay_ns
        seen = self.times_ns[self.pupils.valid & (self.times_ns <= latest_ns)]
        if len(seen) and latest_ns - seen[-1] <= self._longest_ns:
            return int(seen[-1])
        return latest_ns

    def _drawn_through(self, until_ns: int) -> tuple[Floats, list[tuple[int, int]]]:
        """Sizes with lines through short gaps, and the gaps that closed up to then and were not told."""
        sizes, gaps_ns = self.pupils.size.copy(), []
        seen = np.flatnonzero(self.pupils.valid)
        for k in np.flatnonzero(np.diff(seen) > 1).tolist():
            before, after = int(seen[k]), int(seen[k + 1])
            begin_ns, end_ns = int(self.times_ns[before]), int(self.times_ns[after])
            if end_ns - begin_ns > self._longest_ns:
                continue
            inside = slice(before + 1, after)
            sizes[inside] = np.interp(self.times_ns[inside], [begin_ns, end_ns], sizes[[before, after]])
            if self._told_ns < end_ns <= until_ns and end_ns > self._settled_ns:
                gaps_ns.append((max(begin_ns, self._told_ns), end_ns))
                self._told_ns = end_ns
        return sizes, gaps_ns
