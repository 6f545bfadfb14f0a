"""The greatest effort of each muscle, recorded after a marker `mvc`: what 100 % is."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

PEAK_S = 0.5  # the greatest mean over so long counts (SENIAM; Burden 2010)
LEAST_OVER_REST = 2.0  # times the amplitude of rest that an effort has

Floats = NDArray[np.float64]


@dataclass(eq=False)
class _Trial:
    """One effort: of these channels, shape (k,), in the samples after begin_ns up to end_ns."""

    channels: NDArray[np.int64]
    begin_ns: int
    end_ns: int
    pieces: list[Floats] = field(default_factory=list)


class Effort:
    """100 % of each channel. rms: shape (channels,), NaN without one; the greatest of several trials counts."""

    def __init__(self, fs_hz: float, names: tuple[str, ...], trial_s: float) -> None:
        self._fs_hz, self._names, self._trial_ns = fs_hz, names, round(trial_s * SECOND_NS)
        self._trials: list[_Trial] = []
        self.rms = np.full(len(names), np.nan)
        self.problems: dict[str, str] = {}  # why the last marker gave a channel no maximum

    def begin(self, name: str, newest_ns: int) -> None:
        """A marker came after the sample at newest_ns. name: the channel it is for; empty: all."""
        self.problems.clear()
        if name and name not in self._names:
            self.problems[name] = f"mvc: the marker's value is {name!r}, the stream has {', '.join(self._names)}"
            return
        channels = np.array([i for i, one in enumerate(self._names) if name in ("", one)])
        self._trials.append(_Trial(channels, newest_ns, newest_ns + self._trial_ns))

    def push(self, values: Floats, times_ns: NDArray[np.int64], rest_rms: Floats) -> None:
        """Take cleaned samples, shape (n, channels), NaN where there is none."""
        for trial in self._trials:
            first, end = np.searchsorted(times_ns, [trial.begin_ns, trial.end_ns], side="right")
            trial.pieces.append(values[first:end, trial.channels])
        done = [trial for trial in self._trials if len(times_ns) and times_ns[-1] >= trial.end_ns]
        self._trials = [trial for trial in self._trials if trial not in done]
        for trial in done:
            self._judge(trial.channels, np.concatenate(trial.pieces), rest_rms[trial.channels])

    def end(self) -> None:
        """Samples are missing from here on: a trial that has not ended is none."""
        for trial in self._trials:
            self._refuse(trial.channels, "samples are missing after the marker")
        self._trials = []

    def _judge(self, channels: NDArray[np.int64], values: Floats, rest_rms: Floats) -> None:
        best = greatest_rms(values, round(PEAK_S * self._fs_hz))
        good = best > LEAST_OVER_REST * np.nan_to_num(rest_rms)
        self._refuse(channels[~good], f"no effort in the {self._trial_ns / SECOND_NS:g} s after the marker")
        self.rms[channels[good]] = np.fmax(self.rms[channels[good]], best[good])

    def _refuse(self, channels: NDArray[np.int64], why: str) -> None:
        for channel in channels.tolist():
            self.problems[self._names[channel]] = f"mvc of {self._names[channel]}: {why}"


def greatest_rms(values: Floats, size: int) -> Floats:
    """Return the greatest root mean square of `size` neighbours, shape (channels,); NaN where none are complete."""
    known = np.isfinite(values)
    sums = _running(np.where(known, values, 0.0) ** 2, size)
    whole = _running(known.astype(float), size) > size - 0.5
    best = np.where(whole, sums, -1.0).max(axis=0, initial=-1.0)
    return np.sqrt(np.where(best >= 0, best, np.nan) / size)


def _running(values: Floats, size: int) -> Floats:
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(sums[size:] - sums[:-size]) if len(sums) > size else np.empty((0, values.shape[1]))
