"""From raw samples to what muscles can have made of them: band-passed, without mains, NaN where there is no signal."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi
from sense4hri.harmonics import lines_at, lines_seen
from sense4hri.living import LONGEST_HELD_S, held
from sense4hri.resolution import least_step

BAND_HZ = (20.0, 450.0)  # SENIAM (Hermens et al. 2000): below is movement, above hardly anything
BELOW_NYQUIST = 0.9
HUM_S = 2.0  # of the past by which the mains are fitted
STANDS_OUT = 4.0  # times the amplitude beside it: a line as strong as 12 Hz of muscle
HELD_S = 0.03  # exactly the same for longer is no signal
HUM_LEFT, CHANGE_LEFT, CHANGE_S = 0.05, 0.5, 0.1  # of the mains, of their change; in which they are one strength
REMEMBERED_S = 10.0  # a line of the mains stays, also where a muscle hides it
SETTLE_S = 0.1  # of the filter, after a hole
RESTS, SPAN = 0.01, 20.0  # share of samples on its extremes, and least steps between these, of a signal that is cut

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Clean(NamedTuple):
    """values: shape (n, channels), NaN where there is no signal.

    hum_rms: shape (channels,), of what was taken away; hum_left_rms: of what of it may be in values still.
    railed: shape (n, channels), what is at an end of the range.
    """

    values: Floats
    railed: Bools
    hum_rms: Floats
    hum_left_rms: Floats


def band_hz(fs_hz: float) -> tuple[float, float]:
    """What is looked at of a signal sampled at fs_hz."""
    return BAND_HZ[0], min(BAND_HZ[1], BELOW_NYQUIST * fs_hz / 2)


class Cleaner:
    """One stream; `restart` forgets what came before, as after a hole. Causal, so nothing is revised."""

    def __init__(self, fs_hz: float, channels: int, rails: tuple[float, float]) -> None:
        self._fs_hz, self._channels, self._rails = fs_hz, channels, rails
        self._sos = butter(2, band_hz(fs_hz), "bandpass", fs=fs_hz, output="sos")
        self.restart()

    def restart(self) -> None:
        """The next sample begins anew."""
        self._state: Floats | None = None
        self._seen = 0  # samples
        self._last = np.full(self._channels, np.nan)
        self._changed = np.zeros(self._channels, np.int64)  # the number of the sample since which it is the same
        self._bad = np.zeros(self._channels, np.int64)  # the number of the last sample that is no signal
        self._past = np.empty((0, self._channels))
        self._lines: list[dict[float, int]] = [{} for _ in range(self._channels)]  # Hz: the sample where it was seen

    def push(self, raw: Floats) -> Clean:
        """Take the next samples, shape (n, channels)."""
        filled = self._filled(raw)
        railed = at_rails(raw, *self._rails)
        good = self._good(raw, filled, railed)
        if self._state is None:
            self._state = sosfilt_zi(self._sos)[:, :, None] * filled[0]
        band, self._state = sosfilt(self._sos, filled, axis=0, zi=self._state)
        self._past = np.concatenate([self._past, np.where(good, band, 0.0)])
        self._past = self._past[-max(len(raw), round(HUM_S * self._fs_hz)) :]
        hum = self._hum(self._past)[-len(raw) :]
        hum_rms = np.sqrt(np.mean(hum**2, axis=0))
        left = np.maximum(HUM_LEFT * hum_rms, CHANGE_LEFT * changed_rms(hum, self._fs_hz))
        return Clean(np.where(good, band - hum, np.nan), railed, hum_rms, left)

    def _hum(self, past: Floats) -> Floats:
        """The mains in the past of each channel, by the lines that were seen there of late."""
        alike: dict[tuple[float, ...], list[int]] = {}
        for i, lines in enumerate(self._lines):
            lines |= dict.fromkeys(lines_seen(past[:, i], self._fs_hz, STANDS_OUT), self._seen)
            here = (hz for hz, seen in lines.items() if self._seen - seen <= REMEMBERED_S * self._fs_hz)
            alike.setdefault(tuple(sorted(here)), []).append(i)
        hum = np.zeros(past.shape)
        for lines_hz, channels in alike.items():
            hum[:, channels] = lines_at(past[:, channels], self._fs_hz, lines_hz)
        return hum

    def _filled(self, raw: Floats) -> Floats:
        """What is no number is held at the last one."""
        known = np.isfinite(raw)
        at = np.maximum.accumulate(np.where(known, np.arange(len(raw))[:, None], -1), axis=0)
        before = np.where(np.isfinite(self._last), self._last, 0.0)
        return np.where(at >= 0, np.take_along_axis(raw, np.maximum(at, 0), axis=0), before)

    def _good(self, raw: Floats, filled: Floats, railed: Bools) -> Bools:
        """Where the samples are a signal: numbers, not held, not at a rail, and not just after such."""
        number = self._seen + np.arange(len(raw))[:, None]
        changed = np.diff(filled, axis=0, prepend=self._last[None]) != 0
        since = np.maximum(np.maximum.accumulate(np.where(changed, number, -1), axis=0), self._changed)
        same = held(raw, HELD_S * self._fs_hz) | (number - since > LONGEST_HELD_S * self._fs_hz)
        bad = ~np.isfinite(raw) | railed | same
        last_bad = np.maximum(np.maximum.accumulate(np.where(bad, number, -1), axis=0), self._bad)
        self._seen, self._last = self._seen + len(raw), filled[-1]
        self._changed, self._bad = since[-1], last_bad[-1]
        return np.asarray(number - last_bad > SETTLE_S * self._fs_hz)


def at_rails(raw: Floats, low: float, high: float) -> Bools:
    """Return which samples, shape (n, channels), are at an end of the range.

    Of an unknown one: that rest on the extremes of all, where a signal is cut at both: there and hardly anywhere else
    neighbours are equal. In few steps of a converter that happens to a whole signal too.
    """
    if low < high:
        return np.asarray((raw <= low) | (raw >= high))
    bottom, top = (end.reduce(raw, axis=0) for end in (np.fmin, np.fmax))
    same = np.zeros(raw.shape, bool)
    same[1:] = raw[1:] == raw[:-1]
    same[:-1] |= same[1:]
    lowest, highest = raw == bottom, raw == top
    rests = same & (lowest | highest)
    cut = (same & lowest).any(axis=0) & (same & highest).any(axis=0) & (rests.mean(axis=0) > RESTS)
    cut &= (2 * rests.sum(axis=0) > same.sum(axis=0)) & (top - bottom > SPAN * least_step(raw))
    return np.asarray((lowest | highest) & cut)


def changed_rms(hum: Floats, fs_hz: float) -> Floats:
    """Return by how much the strength of hum, shape (n, channels), differs within it."""
    size = max(1, round(CHANGE_S * fs_hz))
    whole = hum[: len(hum) // size * size].reshape(-1, size, hum.shape[1])
    return np.ptp(np.sqrt(np.mean(whole**2, axis=1)), axis=0) if len(whole) else np.zeros(hum.shape[1])
