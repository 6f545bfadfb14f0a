"""The greatest effort of each muscle, recorded after a marker `mvc`: what 100 % is."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

from interpreter_emg.features import PEAK_S, without_pops

KNOWN = 0.5  # share of them that is a signal
CUT = 0.01  # share of them at an end of the range from which an effort is greater than what is seen of it
LEAST_OVER_REST = 2.0  # times the amplitude of rest that an effort has

Floats = NDArray[np.float64]


@dataclass(eq=False)
class _Trial:
    """One effort of one channel, in the samples after begin_ns up to end_ns; None: in the first that come."""

    channel: int
    begin_ns: int | None
    end_ns: int = 2**62
    pieces: list[Floats] = field(default_factory=list)
    railed: int = 0

    def take(self, values: Floats, railed: NDArray[np.bool_], times_ns: NDArray[np.int64], trial_ns: int) -> None:
        if self.begin_ns is None:
            self.begin_ns = int(times_ns[0]) - 1
        self.end_ns = self.begin_ns + trial_ns
        first, end = np.searchsorted(times_ns, [self.begin_ns, self.end_ns], side="right")
        self.pieces.append(values[first:end, self.channel])
        self.railed += int(railed[first:end, self.channel].sum())


class Effort:
    """100 % of each channel. rms: shape (channels,), NaN without one; the greatest of several trials counts."""

    def __init__(self, fs_hz: float, names: tuple[str, ...], trial_s: float) -> None:
        self._fs_hz, self._names, self._trial_ns = fs_hz, names, round(trial_s * SECOND_NS)
        self._trials: list[_Trial] = []
        self.rms = np.full(len(names), np.nan)
        self.problems: dict[str, str] = {}  # why the last marker gave a channel no maximum

    def begin(self, name: str, newest_ns: int | None) -> None:
        """A marker came after the sample at newest_ns, or before any. name: the channel it is for; empty: all."""
        self.problems.clear()
        if name and name not in self._names:
            self.problems[name] = f"mvc: the marker's value is {name!r}, the stream has {', '.join(self._names)}"
        self._trials += [_Trial(i, newest_ns) for i, one in enumerate(self._names) if name in ("", one)]

    def push(self, values: Floats, railed: NDArray[np.bool_], times_ns: NDArray[np.int64], rest_rms: Floats) -> None:
        """Take cleaned samples, shape (n, channels), NaN where there is none, and which are at an end of the range.

        An effort is judged when it has ended and the level of rest, NaN until then, is known.
        """
        waiting = []
        for trial in self._trials:
            trial.take(values, railed, times_ns, self._trial_ns)
            if times_ns[-1] < trial.end_ns or not self._judge(trial, float(rest_rms[trial.channel])):
                waiting.append(trial)
        self._trials = waiting

    def end(self) -> None:
        """A new segment begins: a trial that has not been judged is none."""
        for trial in self._trials:
            self._refuse(trial.channel, "samples are missing after the marker")
        self._trials = []

    def _judge(self, trial: _Trial, rest_rms: float) -> bool:
        """Whether the effort could be judged."""
        channel = trial.channel
        values = np.concatenate(trial.pieces)
        best = greatest_rms(values, round(PEAK_S * self._fs_hz))
        if trial.railed > CUT * len(values):
            self._refuse(channel, "the range ends below the effort, which is greater than what is seen of it")
        elif np.isnan(best):
            self._refuse(channel, f"too little signal in the {self._trial_ns / SECOND_NS:g} s after the marker")
        elif np.isnan(rest_rms):
            self._refuse(channel, "not judged before the level of rest is known")
            return False
        elif best <= LEAST_OVER_REST * rest_rms:
            self._refuse(channel, f"no effort in the {self._trial_ns / SECOND_NS:g} s after the marker")
        else:
            self.problems.pop(self._names[channel], None)
            self.rms[channel] = np.fmax(self.rms[channel], best)
        return True

    def _refuse(self, channel: int, why: str) -> None:
        self.problems[self._names[channel]] = f"mvc of {self._names[channel]}: {why}"


def greatest_rms(values: Floats, size: int) -> float:
    """Return the greatest root mean square of `size` neighbours in values, shape (n,).

    Values that are NaN, or pops, are passed over; NaN where of no neighbours as many as KNOWN are numbers.
    """
    values = without_pops(values, size)
    known = np.isfinite(values)
    sums, counts = _running(np.where(known, values, 0.0) ** 2, size), _running(known.astype(float), size)
    enough = counts >= KNOWN * size
    return float(np.sqrt((sums[enough] / counts[enough]).max())) if enough.any() else np.nan


def _running(values: Floats, size: int) -> Floats:
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(sums[size:] - sums[:-size]) if len(sums) > size else np.empty(0)
