"""One lead of an ECG: its heart beats of the last window."""

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Presence
from sense4hri.stamps import SECOND_NS

from interpreter_respiration.beats import SETTLED_S, Beat, Beats

PAUSE_S, PAUSE_BEATS = 2.5, 2.5  # without a beat, whichever is longer: what was before it says nothing any more

Floats = NDArray[np.float64]


class Lead:
    """Samples in, beats out. `restart`: a hole is between what came and what comes; `forget`: a new segment begins.

    blocks: of the window, so many.
    """

    def __init__(self, fs_hz: float, blocks: int) -> None:
        self._fs_hz, self._finder, self._presence = fs_hz, Beats(fs_hz), Presence(blocks)
        self.forget()

    def forget(self) -> None:
        """Everything begins anew."""
        self.beats: list[Beat] = []
        self._presence.restart()
        self.restart()

    def restart(self) -> None:
        """A hole is between what came and what comes."""
        self._finder.restart()
        self.silent_s = 0.0  # of samples since the last beat, or hole

    def take(self, samples: Floats, times_ns: NDArray[np.int64], start_ns: int) -> None:
        """Find the beats of a block, shape (n,), NaN where a sample is lost; beats up to start_ns are forgotten."""
        self._presence.add(samples[:, None])
        fresh = self._finder.push(samples, times_ns)
        self.beats = [beat for beat in self.beats + fresh if beat.time_ns > start_ns]
        after = times_ns > fresh[-1].time_ns if fresh else np.ones(len(samples), bool)
        self.silent_s = (0.0 if fresh else self.silent_s) + np.count_nonzero(after) / self._fs_hz

    def share(self) -> float:
        """Return the share of the window's samples that came."""
        return self._presence.share()

    def chained(self, end_ns: int) -> list[Beat]:
        """Beats up to end_ns since the last pause, the first of which has an interval before it."""
        times_ns = np.array([*(beat.time_ns for beat in self.beats), end_ns - round(SETTLED_S * SECOND_NS)])
        pauses = np.flatnonzero(np.diff(times_ns) > self._pause_s() * SECOND_NS)
        newest = self.beats[int(pauses[-1]) + 1 :] if len(pauses) else self.beats
        first = next((k for k, beat in enumerate(newest) if np.isfinite(beat.interval_s)), len(newest))
        return newest[first:]

    def _pause_s(self) -> float:
        intervals_s = [beat.interval_s for beat in self.beats if np.isfinite(beat.interval_s)]
        return max(PAUSE_S, PAUSE_BEATS * float(np.median(intervals_s))) if intervals_s else PAUSE_S
