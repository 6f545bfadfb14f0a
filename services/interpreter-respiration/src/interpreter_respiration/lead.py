"""One lead of an ECG: its heart beats of the last window."""

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Presence
from sense4hri.slow import drawn_through, newest_run
from sense4hri.stamps import SECOND_NS

from interpreter_respiration.beats import Beat, Beats

BRIDGED_S = 0.1  # a shorter hole is drawn through: it hides one beat at most, whose interval is left out
PAUSE_S = 2.0  # without a beat: a breath may have come and gone unseen

Floats = NDArray[np.float64]


class Lead:
    """Samples in, beats out. `restart`: a hole is between what came and what comes; `forget`: a new segment begins.

    blocks: of the window, so many.
    """

    def __init__(self, fs_hz: float, blocks: int) -> None:
        self._finder, self._presence = Beats(fs_hz), Presence(blocks)
        self.forget()

    def forget(self) -> None:
        """Everything begins anew."""
        self._beats: list[Beat] = []
        self._presence.restart()
        self.restart()

    def restart(self) -> None:
        """A hole is between what came and what comes."""
        self._finder.restart()
        self._last, self._last_ns = np.empty(0), np.empty(0, np.int64)

    def take(self, samples: Floats, times_ns: NDArray[np.int64], start_ns: int) -> None:
        """Find the beats of a block, shape (n,); a sample that is no number breaks the chain of intervals.

        start_ns: beats up to then are forgotten.
        """
        self._presence.add(samples[:, None])
        raw, times_ns = np.append(self._last, samples), np.append(self._last_ns, times_ns)
        self._last, self._last_ns = raw[-1:], times_ns[-1:]
        ecg = drawn_through(raw, times_ns, BRIDGED_S)
        fresh = len(ecg) - len(samples)
        begin = max(fresh, newest_run(ecg))
        if begin > fresh:
            self._finder.restart()
        self._beats += self._finder.push(ecg[begin:], times_ns[begin:])
        self._beats = [beat for beat in self._beats if beat.time_ns > start_ns]

    def share(self) -> float:
        """Return the share of the window's samples that came."""
        return self._presence.share()

    def chained(self, end_ns: int) -> list[Beat]:
        """Beats with an interval before them, up to end_ns, since the last pause."""
        times_ns = np.array([*(beat.time_ns for beat in self._beats), end_ns])
        pauses = np.flatnonzero(np.diff(times_ns) > PAUSE_S * SECOND_NS)
        newest = self._beats[int(pauses[-1]) + 1 :] if len(pauses) else self._beats
        return [beat for beat in newest if np.isfinite(beat.interval_s)]
