"""The resting size that changes refer to: of the time between two markers, else the median of the last minute."""

from collections import deque

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

NEEDS_S = 10.0  # of signal before there is a rolling one
LEAST_SHARE = 0.5  # of the samples that should come between two markers that hold a pupil
NEVER, ALWAYS = 2**62, -(2**62)


class Baseline:
    """Of one stream. span_s: of the rolling one."""

    def __init__(self, span_s: float) -> None:
        self._span_ns = round(span_s * SECOND_NS)
        self._rolling: deque[tuple[int, float]] = deque()  # means of what came between two updates
        self._marked = np.nan
        self._open: tuple[int, int] | None = None  # the time between the markers; it ends NEVER before the second one
        self._sum, self._n, self._all = 0.0, 0, 0
        self._start_ns, self._due = 0, 0.0  # stamp of the first marker; how many samples should come up to the second
        self.failed = ""
        """Why the newest time between markers has set none; empty where it has."""

    @property
    def marked(self) -> bool:
        """True where markers have set it."""
        return bool(np.isfinite(self._marked))

    def start(self, newest_ns: int | None, marker_ns: int) -> None:
        """`baseline_start`, after the sample of this time. marker_ns: the stamp of the marker itself."""
        self._open = (ALWAYS if newest_ns is None else newest_ns, NEVER)
        self._sum, self._n, self._all = 0.0, 0, 0
        self._start_ns, self._due = marker_ns, 0.0

    def end(self, newest_ns: int | None, marker_ns: int, fs_hz: float) -> None:
        """`baseline_end`, after the sample of this time; without a start before it there is nothing to end."""
        self._due = fs_hz * (marker_ns - self._start_ns) / SECOND_NS
        if self._open is not None and newest_ns is not None:
            self._open = (self._open[0], newest_ns)
        elif self._open is not None:
            self._close()

    def restart_clock(self) -> None:
        """Times that come cannot be compared with those before: a time between markers goes on from here, or ends."""
        if self._open is not None and self._open[1] != NEVER:
            self._close()
        elif self._open is not None:
            self._open = (ALWAYS, NEVER)
        self._rolling.clear()

    def take(
        self, times_ns: NDArray[np.int64], sizes: NDArray[np.float64], valid: NDArray[np.bool_], end_ns: int
    ) -> None:
        """Take samples, shape (n,), that were settled at an update; end_ns: the newest sample by then."""
        if valid.any():
            self._rolling.append((end_ns, float(sizes[valid].mean())))
        while self._rolling and self._rolling[0][0] <= end_ns - self._span_ns:
            self._rolling.popleft()
        if self._open is None:
            return
        begin_ns, until_ns = self._open
        between = (times_ns > begin_ns) & (times_ns <= until_ns)
        known = sizes[between & valid]
        self._sum, self._n, self._all = self._sum + float(known.sum()), self._n + len(known), self._all + between.sum()
        if end_ns - SECOND_NS >= until_ns or (len(times_ns) and times_ns[-1] > until_ns):
            self._close()

    def _close(self) -> None:
        share, self._open = self._n / max(1.0, self._all, self._due), None
        if share >= LEAST_SHARE:
            self._marked, self.failed = self._sum / self._n, ""
            return
        stays = "the one marked before stays" if self.marked else "the rolling one stays"
        self.failed = (
            f"baseline: {100 * share:.0f} % of the samples between baseline_start and baseline_end "
            f"hold a pupil, {100 * LEAST_SHARE:.0f} % are needed; {stays}"
        )

    def value(self, since_s: float) -> float:
        """Return the baseline now; NaN where there is none yet. since_s: of signal."""
        if self.marked:
            return self._marked
        return float(np.median([size for _, size in self._rolling])) if since_s >= NEEDS_S and self._rolling else np.nan
