"""A stream at a constant rate, for formats that know no other: cubic splines on the corrected timeline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from sense4hri.intake import LARGEST
from sense4hri.stream_info import FASTEST_HZ

from sense4hri_session.blocks import Block
from sense4hri_session.session import Session
from sense4hri_session.stream import GAP_PERIODS, Stream

Floats = NDArray[np.floating[Any]]
SECOND_NS = 1_000_000_000
BATCH = 4096  # samples for one spline
CONTEXT = 16  # samples before and after; a spline forgets those beyond (0.27 to the power of 16)
MARGIN_S = 3600  # beyond the receipt of the first and last message; host clocks differ
LONG_S, MOST_EMPTY = 24 * 3600, 10  # no study is longer than a day and for nine tenths empty
CROWDED_PERIODS = 0.25  # closer samples, where a clock was set, are of two splines


class Span(NamedTuple):
    """Where a sample's time can lie: that of the recording and a margin, ns."""

    from_ns: int
    to_ns: int


def span_of(session: Session) -> Span:
    """The time of a recording, by receipt of its messages."""
    return Span(session.start_ns - MARGIN_S * SECOND_NS, session.end_ns + MARGIN_S * SECOND_NS)


def session_start_ns(session: Session) -> int:
    """The whole second at or before the first sample of all streams: every EDF file begins there."""
    span = span_of(session)
    first = [int(block.time_ns[0]) for s in session.streams.values() for block in [next(s.blocks(), None)] if block]
    inside = [at_ns for at_ns in first if span.from_ns <= at_ns <= span.to_ns]
    return min([*inside, session.start_ns]) // SECOND_NS * SECOND_NS


def why_no_grid(session: Session, stream: Stream) -> str:
    """Why a stream has no place on a grid of constant rate, as the rest of a sentence; empty where it has."""
    rate_hz, seconds = whole_rate_hz(stream), (session.end_ns - session.start_ns) / SECOND_NS
    if not stream.seen.samples:
        return "has no samples"
    if not rate_hz:
        return "is irregular"
    if rate_hz > FASTEST_HZ:
        return f"is of {rate_hz} Hz, more than {FASTEST_HZ:.0f} Hz"
    filled = stream.seen.samples / rate_hz
    if seconds > LONG_S and seconds > MOST_EMPTY * filled:
        return f"fills {filled / 3600:.1f} h of the {seconds / 3600:.0f} h that the recording's stamps span"
    return ""


@dataclass
class ConstantRate:
    """`pieces()` gives samples k at start_ns + k / rate_hz; afterwards `gaps` lists what was missing.

    Samples in a gap are NaN. gaps: (onset, duration) in s from start_ns. absent: (onset, duration, channel) where one
    channel had no values and others had. backwards: samples left out because the corrected time went back, the host's
    clock having been set back. outside: samples left out because their times lie outside of `span`, the recording.
    """

    stream: Stream
    start_ns: int
    rate_hz: float
    span: Span
    gaps: list[tuple[float, float]] = field(default_factory=list)
    absent: list[tuple[float, float, str]] = field(default_factory=list)
    backwards: int = 0
    outside: int = 0
    samples: int = 0

    def left_out(self) -> Iterator[str]:
        """A few words for each kind of samples that are not on the grid."""
        if self.backwards:
            yield f"{self.backwards} left out: host clock back"
        if self.outside:
            yield f"{self.outside} left out: time outside"

    def pieces(self) -> Iterator[Floats]:
        """Consecutive samples (n, channels) a few thousand at a time, however long the stream and its gaps are."""
        self.gaps, self.absent, self.backwards, self.outside, self.samples = [], [], 0, 0, 0
        since: dict[str, float] = {}  # channels without values now
        at, values = np.empty(0), np.empty((0, len(self.stream.channels)))
        for times, samples in self._batches():
            if not len(at) and times[0] > 0.5 / self.rate_hz:
                self.gaps.append((0.0, float(times[0])))
            edges = np.concatenate([at[-1:], times])
            holes = np.flatnonzero(np.diff(edges) > self._allowed_s())
            self.gaps += [(float(edges[i]), float(edges[i + 1] - edges[i])) for i in holes]
            self._note_absent(since, float(at[-1]) if len(at) else float(times[0]), times, samples)
            at, values = np.concatenate([at, times]), np.concatenate([values, samples])
            if len(at) > 2 * CONTEXT:
                yield from self._fill(at, values, float(at[-CONTEXT - 1]))
                at, values = at[-2 * CONTEXT :], values[-2 * CONTEXT :]
        if len(at):
            yield from self._fill(at, values, float(at[-1]))
            self.absent += [(onset, float(at[-1]) - onset, name) for name, onset in since.items()]

    def _note_absent(self, since: dict[str, float], before_s: float, times: Floats, samples: Floats) -> None:
        """Keep account of channels without values, from the last value before to the first one after."""
        missing = np.isnan(samples)
        if not since and not missing.any():
            return
        for name, none in zip(self.stream.channels, missing.T, strict=True):
            for i in np.flatnonzero(np.diff(none, prepend=name in since)).tolist():
                if none[i]:
                    since[name] = float(times[i - 1]) if i else before_s
                else:
                    onset = since.pop(name)
                    self.absent.append((onset, float(times[i]) - onset, name))

    def _batches(self) -> Iterator[tuple[Floats, Floats]]:
        """Times in s from start_ns, each later than the one before, and samples (n, channels).

        NaN where none came, or one beyond all that any unit has.
        """
        channels = self.stream.channels
        times: list[Floats] = []
        samples: list[Floats] = []
        last_s, waiting = -math.inf, 0
        for block in map(_in_order, self.stream.blocks()):
            at = (block.time_ns - self.start_ns) * 1e-9
            values = np.where(np.abs(block.samples) < LARGEST, block.samples, np.nan)  # no curve reaches further
            if block.channels != channels:
                some, values = values, np.full((len(at), len(channels)), np.nan)
                values[:, [channels.index(name) for name in block.channels]] = some
            inside = (block.time_ns >= self.span.from_ns) & (block.time_ns <= self.span.to_ns)
            self.outside += int(np.sum(~inside))
            at, values = at[inside], values[inside]
            keep = at > np.maximum.accumulate(np.concatenate([[last_s], at[:-1]])) if len(at) else inside[:0]
            self.backwards += int(np.sum(~keep))
            if not keep.any():
                continue
            times.append(at[keep])
            samples.append(values[keep])
            last_s, waiting = float(times[-1][-1]), waiting + len(times[-1])
            if waiting >= BATCH:
                yield from _cut(np.concatenate(times), np.concatenate(samples))
                times, samples, waiting = [], [], 0
        if waiting:
            yield np.concatenate(times), np.concatenate(samples)

    def _allowed_s(self) -> float:
        return GAP_PERIODS / min(self.stream.true_rate_hz, self.rate_hz)

    def _fill(self, at: Floats, values: Floats, until_s: float) -> Iterator[Floats]:
        """The grid points up to a time, from these samples."""
        steps = np.diff(at)
        crowded = steps < CROWDED_PERIODS / self.stream.true_rate_hz
        cuts = [0, *(np.flatnonzero((steps > self._allowed_s()) | crowded) + 1).tolist(), len(at)]
        curves = [_curve(at[low:high], values[low:high]) for low, high in pairwise(cuts)]
        joints = [_curve(at[i : i + 2], values[i : i + 2]) for i in np.flatnonzero(crowded).tolist()]
        stop = math.floor(until_s * self.rate_hz + 1e-6) + 1
        while self.samples < stop:
            grid = (self.samples + np.arange(min(stop - self.samples, BATCH))) / self.rate_hz
            piece = np.full((len(grid), values.shape[1]), np.nan)
            for first, last, curve in (*joints, *curves):
                low, high = np.searchsorted(grid, [first - 1e-6 / self.rate_hz, last + 1e-6 / self.rate_hz])
                if low < high:
                    piece[low:high] = curve(np.clip(grid[low:high], first, last))
            self.samples += len(grid)
            yield piece


def _in_order(block: Block) -> Block:
    """The samples in the order in which the device took them; a message may come after newer ones."""
    if block.device_time_ns is None or np.all(np.diff(block.device_time_ns) >= 0):
        return block
    order = np.argsort(block.device_time_ns, kind="stable")
    return block._replace(time_ns=block.time_ns[order], samples=block.samples[order])


def _cut(times: Floats, samples: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Some of them at a time, so that a curve is not drawn through more than is looked at."""
    for low in range(0, len(times), BATCH):
        yield times[low : low + BATCH], samples[low : low + BATCH]


def _curve(at: Floats, values: Floats) -> tuple[float, float, Callable[[Floats], Floats]]:
    """Begin, end, and a curve through samples: a cubic spline; straight lines where a channel lacks samples."""
    whole = np.isfinite(values).all(axis=0) & (len(at) >= 4)
    spline = CubicSpline(at, values[:, whole]) if whole.any() else None

    def curve(grid: Floats) -> Floats:
        found = np.empty((len(grid), values.shape[1]))
        if spline is not None:
            found[:, whole] = spline(grid)
        for i in np.flatnonzero(~whole):
            found[:, i] = np.interp(grid, at, values[:, i])
        return found

    return float(at[0]), float(at[-1]), curve


def whole_rate_hz(stream: Stream) -> int:
    """The whole number of samples per second that loses nothing of a stream; 0 for an irregular one."""
    rate = stream.true_rate_hz
    return 0 if not rate > 0 else max(1, math.ceil(rate - 1e-6))
