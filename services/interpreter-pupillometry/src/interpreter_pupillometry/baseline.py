"""The resting size that changes refer to: of the time between two markers, else the median of the last minute."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

NEEDS_S = 10.0  # of signal before there is a rolling one
LEAST_SHARE = 0.5  # of the samples that should come between two markers that hold a pupil
NEVER, ALWAYS = 2**62, -(2**62)


@dataclass(eq=False)
class _Span:
    """The time between two markers: after begin_ns up to until_ns, NEVER before the second one.

    start_ns: stamp of the first marker; due: how many samples should come; total: sum of n pupils among all that came.
    """

    begin_ns: int
    start_ns: int
    until_ns: int = NEVER
    due: float = 0.0
    total: float = 0.0
    n: int = 0
    all: int = 0


class Baseline:
    """Of one stream. span_s: of the rolling one."""

    def __init__(self, span_s: float) -> None:
        self._span_ns = round(span_s * SECOND_NS)
        self._rolling: deque[tuple[int, float]] = deque()  # means of what came between two updates
        self._marked = np.nan
        self._spans: list[_Span] = []  # those that have ended wait for their last samples; the last may be open
        self.failed = ""
        """Why the newest `baseline_end` has set none; empty where it has."""

    @property
    def marked(self) -> bool:
        """True where markers have set it."""
        return bool(np.isfinite(self._marked))

    def start(self, newest_ns: int | None, marker_ns: int) -> None:
        """`baseline_start`, after the sample of this time. marker_ns: the stamp of the marker itself."""
        ended = [span for span in self._spans if span.until_ns != NEVER]
        self._spans = [*ended, _Span(ALWAYS if newest_ns is None else newest_ns, marker_ns)]

    def end(self, newest_ns: int | None, marker_ns: int, fs_hz: float) -> None:
        """`baseline_end`, after the sample of this time; without a start before it there is nothing to end."""
        if not self._spans or self._spans[-1].until_ns != NEVER:
            self.failed = f"baseline: baseline_end came without a baseline_start; {self._stays}"
            return
        span = self._spans[-1]
        span.due = fs_hz * (marker_ns - span.start_ns) / SECOND_NS
        if newest_ns is None:
            self._close(span)
        else:
            span.until_ns = newest_ns

    def restart_clock(self) -> None:
        """Times that come cannot be compared with those before: a time between markers goes on from here, or ends."""
        for span in self._spans.copy():
            if span.until_ns != NEVER:
                self._close(span)
            else:
                span.begin_ns = ALWAYS
        self._rolling.clear()

    def take(
        self, times_ns: NDArray[np.int64], sizes: NDArray[np.float64], valid: NDArray[np.bool_], end_ns: int
    ) -> None:
        """Take samples, shape (n,), that were settled at an update; end_ns: the newest sample by then."""
        if valid.any():
            self._rolling.append((end_ns, float(sizes[valid].mean())))
        while self._rolling and self._rolling[0][0] <= end_ns - self._span_ns:
            self._rolling.popleft()
        for span in self._spans.copy():
            between = (times_ns > span.begin_ns) & (times_ns <= span.until_ns)
            known = sizes[between & valid]
            span.total += float(known.sum())
            span.n, span.all = span.n + len(known), span.all + int(between.sum())
            if end_ns - SECOND_NS >= span.until_ns or (len(times_ns) and times_ns[-1] > span.until_ns):
                self._close(span)

    def _close(self, span: _Span) -> None:
        self._spans.remove(span)
        share = span.n / max(1.0, span.all, span.due)
        if share >= LEAST_SHARE:
            self._marked, self.failed = span.total / span.n, ""
            return
        self.failed = (
            f"baseline: {100 * share:.0f} % of the samples between baseline_start and baseline_end "
            f"hold a pupil, {100 * LEAST_SHARE:.0f} % are needed; {self._stays}"
        )

    @property
    def _stays(self) -> str:
        return "the one marked before stays" if self.marked else "the rolling one stays"

    def value(self, since_s: float) -> float:
        """Return the baseline now; NaN where there is none yet. since_s: of signal."""
        if self.marked:
            return self._marked
        return float(np.median([size for _, size in self._rolling])) if since_s >= NEEDS_S and self._rolling else np.nan
