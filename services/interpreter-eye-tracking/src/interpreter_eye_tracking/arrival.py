"""Which samples hold gaze: not lost, not doubted by the tracker, not frozen; and what is missing between them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.living import frozen
from sense4hri.stamps import SECOND_NS
from sense4hri.stream_info import StreamInfo

from interpreter_eye_tracking.features import SHORTEST_LOSS_S

FROZEN_S = 2.0  # no eye is still for so long to the last digit
HELD_S, LOOK_S = 0.1, 10.0  # nor for so long where the tracker showed its noise in the last LOOK_S
ABSENT = 2.5  # sample periods between two samples beyond which one is missing for certain
IRREGULAR = 0.5  # share of the period by which an interval is off
FAR = 10.0  # spans of the range that no gaze lies beyond it; trackers mark what is lost with such numbers
FARTHEST = {"px": 32766.0, "deg": 180.0, "1": 100.0}  # where no range is known; EyeLink writes -32768 for what is lost
ZEROS = 3  # samples in a row of exactly (0, 0) deg, which no eye holds; trackers say so of nothing

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


class Arrived(NamedTuple):
    """Samples, and a point of NaN for each hole between them. gaze: shape (n, 2), NaN where lost; holes: shape (n,).

    Gaze that is frozen or held is a hole as well: nothing is known of the eye. stuck: shape (2,), of x and y: in how
    many samples it is frozen while the other is not. since_ns: since when all is frozen or held that came before; None
    where it is not.
    """

    times_ns: Times
    gaze: Floats
    holes: NDArray[np.bool_]
    samples: int
    valid: int
    missing: int
    irregular: int
    stuck: Floats
    since_ns: int | None


class Arrival:
    """Looks at one stream's samples. Raises ValueError where a channel is missing."""

    def __init__(self, info: StreamInfo, least_confidence: float) -> None:
        names = info.channel_names
        if not {"gaze_x", "gaze_y"} <= set(names):
            raise ValueError(f"channels are {', '.join(names) or 'unknown'}, gaze_x and gaze_y are needed")
        self._columns = [names.index("gaze_x"), names.index("gaze_y")]
        self._confidence = names.index("confidence") if "confidence" in names else None
        self._least_confidence = least_confidence
        self._least_zeros = ZEROS if info.unit == "deg" else 1  # (0, 0) is a corner of the screen where not in deg
        self._no_minus_one = info.unit in ("1", "px")
        self._bounds = bounds_of(info)
        self.restart()

    def restart(self) -> None:
        """What comes next does not follow what came before."""
        self._last_ns: int | None = None
        self.interrupted()

    def interrupted(self) -> None:
        """Samples are missing before the next one: they count, and nothing goes on across them."""
        self._last = np.full(2, np.nan)
        self._same_ns = 0  # since when gaze has been the same
        self._axes_ns = np.zeros(2, np.int64)  # since when x and y have been
        self.frozen = False  # the newest sample is
        self._zeros = 0  # how many of the newest samples are (0, 0)
        self._recent, self._recent_ns = np.empty((0, 2)), np.empty(0, np.int64)  # gaze of the last LOOK_S

    def take(self, samples: Floats, times_ns: Times, period_s: float) -> Arrived:
        """Take the next samples, shape (n, channels), n > 0, of a stream with this time between two of them."""
        gaze = self._seen(samples)
        stuck = self._stuck(gaze, times_ns)
        dead, since_ns = self._still(gaze, times_ns, self._held(gaze, times_ns, period_s))
        gaze[dead] = np.nan
        valid = int(np.isfinite(gaze[:, 0]).sum())
        before_ns = self._last_ns if self._last_ns is not None else times_ns[0] - round(period_s * SECOND_NS)
        intervals = np.diff(times_ns, prepend=before_ns) / SECOND_NS / period_s
        self._last_ns = int(times_ns[-1])
        irregular = int((np.abs(intervals - 1) > IRREGULAR).sum())
        missing = int(np.maximum(np.rint(intervals) - 1, 0).sum())
        at = np.flatnonzero((intervals > ABSENT) & (intervals * period_s > SHORTEST_LOSS_S))
        hole_ns = np.concatenate([[before_ns], times_ns])[at] + round(period_s * SECOND_NS)
        return Arrived(
            np.insert(times_ns, at, hole_ns),
            np.insert(gaze, at, np.nan, axis=0),
            np.insert(dead, at, True),
            len(samples),
            valid,
            missing,
            irregular,
            stuck,
            since_ns,
        )

    def _seen(self, samples: Floats) -> Floats:
        """Gaze, NaN where the tracker has none."""
        gaze = samples[:, self._columns]
        within = np.isfinite(gaze) & (gaze >= self._bounds[0]) & (gaze <= self._bounds[1])
        lost: NDArray[np.bool_] = np.asarray(~within.all(axis=1))
        lost |= self._zeroed(gaze)
        if self._no_minus_one:
            lost |= (gaze == -1).all(axis=1)
        if self._confidence is not None:
            lost |= ~(samples[:, self._confidence] >= self._least_confidence)
        return np.where(lost[:, None], np.nan, gaze)

    def _zeroed(self, gaze: Floats) -> NDArray[np.bool_]:
        """Return which samples are (0, 0), as many in a row as mean that gaze is lost."""
        zero = (gaze == 0).all(axis=1)
        run = np.cumsum(~zero)
        lengths = np.bincount(run, weights=zero)
        lengths[0] += self._zeros
        self._zeros = int(lengths[run[-1]])
        return np.asarray(zero & (lengths[run] >= self._least_zeros))

    def _stuck(self, gaze: Floats, times_ns: Times) -> Floats:
        """In how many samples x, and y, has not changed for FROZEN_S while the other has."""
        moved = gaze != np.concatenate([self._last[None], gaze[:-1]])
        since_ns = np.maximum.accumulate(np.where(moved, times_ns[:, None], self._axes_ns), axis=0)
        still = times_ns[:, None] - since_ns >= FROZEN_S * SECOND_NS
        self._axes_ns = since_ns[-1]
        return np.asarray((still & ~still[:, ::-1]).sum(axis=0), float)

    def _held(self, gaze: Floats, times_ns: Times, period_s: float) -> NDArray[np.bool_]:
        """Return which gaze is the same for more than HELD_S, of a tracker that shows its noise otherwise."""
        kept = slice(int(np.searchsorted(self._recent_ns, times_ns[-1] - round(LOOK_S * SECOND_NS))), None)
        self._recent = np.concatenate([self._recent[kept], gaze])
        self._recent_ns = np.concatenate([self._recent_ns[kept], times_ns])
        return frozen(self._recent, max(2, round(HELD_S / period_s)))[-len(gaze) :]

    def _still(self, gaze: Floats, times_ns: Times, held: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int | None]:
        """Return which gaze is held or has not changed for FROZEN_S, and since when, where what came before goes on so.

        The latter is None where it does not.
        """
        moved = np.asarray((gaze != np.concatenate([self._last[None], gaze[:-1]])).any(axis=1))  # NaN differs from NaN
        starts = np.flatnonzero(moved)
        first = np.concatenate([[0] if len(starts) == 0 or starts[0] else [], starts]).astype(int)
        begin_ns = np.where(moved[first], times_ns[first], self._same_ns)
        ends = np.append(first[1:], len(gaze))
        long = times_ns[ends - 1] - begin_ns >= FROZEN_S * SECOND_NS
        self._last, self._same_ns, self.frozen = gaze[-1].copy(), int(begin_ns[-1]), bool(long[-1])
        dead = held | np.repeat(long, ends - first)
        return dead, int(begin_ns[0]) if dead[0] and not moved[0] else None


def bounds_of(info: StreamInfo) -> tuple[float, float]:
    """Return the least and the largest number that can be gaze, in the stream's unit."""
    span = info.range_max - info.range_min
    if span > 0:
        return info.range_min - FAR * span, info.range_max + FAR * span
    farthest = FARTHEST.get(info.unit, np.inf)
    return -farthest, farthest
