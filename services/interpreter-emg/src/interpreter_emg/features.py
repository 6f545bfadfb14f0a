"""Numbers of an electromyogram from arrays: no state, no time, no ROS. Too little signal gives NaN."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

NOISE_HZ, MUSCLE_HZ = (250.0, 450.0), (40.0, 150.0)  # where hardly a muscle is, and where all are
DRIFT_HZ, STRONG_HZ = (20.0, 40.0), (60.0, 150.0)  # where a muscle is weaker than where it is strongest ...
FIRST_HZ, AFTER_HZ = (20.0, 30.0), (35.0, 48.0)  # ... and where even a tired one still rises
NOISE_FROM_HZ = 180.0  # where sampling shows less
LEAST_FS_HZ, FULL_FS_HZ = 500.0, 1000.0  # for a spectrum that begins to be, or is, a muscle's
MISSING = 0.2  # share of the window up to which there is a spectrum
WHITE = 0.5  # of the density in MUSCLE_HZ that NOISE_HZ has: no muscle. Measured ones have 0.05 to 0.2
RED = 4.5  # fall of the density from DRIFT_HZ to STRONG_HZ times that from FIRST_HZ to AFTER_HZ: no muscle
"""One tired to a median of 59 Hz has 2.1, now and then 3.2; 1/f^1.5 noise has 7."""
LOUD_RMS = 30.0  # uV, of a light contraction
NOISE_TO_SIZE, HUM_TO_SIZE, WANDER_TO_SIZE, HEART_TO_SIZE = 0.3, 2.0, 5.0, 0.3  # where each halves the quality
PEAK_S = 0.5  # the greatest mean over so long is an effort (SENIAM; Burden 2010)
USUAL, POP = 0.8, 8.0  # quantile of magnitudes, and times of it: 10 standard deviations of a muscle
POP_LASTS = 0.2  # share of PEAK_S in which the filter rings
LEAST_GAIN = 8.0  # of the likelihood (its logarithm) by a change; chance gives 5
WANDER_S = 0.05  # means over this have no muscle in them
HEART_PERIOD_S, HEART_REACH_S, HEART_LAG_S = (0.33, 1.7), 0.06, 0.03
HEART_LIKE, HEART_STANDS_OUT, HEART_FEWEST = 0.7, 4.0, 5
RECTIFIED_S, RECTIFIED_FEWEST, RECTIFIED = 0.05, 20, 0.2
"""In pieces so long, of so many samples at least, a rectified muscle comes this near zero, as a share of their mean: to
0.1 of it, one on an offset that keeps it above zero to 0.4."""
AT_REST, RESTED = 0.1, 0.1  # quantile of the levels of an envelope, of seconds with work, and how near zero it is
FINE_S = 0.005

Floats = NDArray[np.float64]


class Spectrum(NamedTuple):
    """mean_hz, median_hz of the power; NaN where unknown.

    white: density where no muscle is over that where all are. drift, strong, first, after: densities in DRIFT_HZ,
    STRONG_HZ, FIRST_HZ, AFTER_HZ, of no unit.
    """

    mean_hz: float
    median_hz: float
    white: float
    drift: float
    strong: float
    first: float
    after: float


NO_SPECTRUM = Spectrum(np.nan, np.nan, np.nan, *[0.0] * 4)


def spectrum(values: Floats, fs_hz: float, band_hz: tuple[float, float]) -> Spectrum:
    """Return mean and median frequency (Stulen & De Luca 1981) of values, shape (n,), with NaN where samples miss.

    The whole window under a Hann taper: no average over shorter ones is needed for sums over the band.
    """
    if fs_hz < LEAST_FS_HZ or not len(values) or np.isnan(values).mean() > MISSING:
        return NO_SPECTRUM
    power = np.abs(np.fft.rfft(np.nan_to_num(values) * np.hanning(len(values)))) ** 2
    at_hz = np.fft.rfftfreq(len(values), 1 / fs_hz)
    within = (at_hz >= band_hz[0]) & (at_hz <= band_hz[1])
    power, at_hz = power[within], at_hz[within]
    total = float(power.sum())
    if not total > 0:
        return NO_SPECTRUM
    median_hz = float(at_hz[np.searchsorted(np.cumsum(power), total / 2)])
    low_hz = NOISE_HZ[0] if at_hz[-1] > NOISE_HZ[0] + 50 else NOISE_FROM_HZ
    bands = ((low_hz, NOISE_HZ[1]), MUSCLE_HZ, DRIFT_HZ, STRONG_HZ, FIRST_HZ, AFTER_HZ)
    noise, muscle, drift, strong, first, after = (_density(power, at_hz, band) for band in bands)
    white = noise / muscle if muscle > 0 else np.nan
    return Spectrum(float(power @ at_hz) / total, median_hz, white, drift, strong, first, after)


def _density(power: NDArray[np.floating], at_hz: NDArray[np.floating], band_hz: tuple[float, float]) -> float:
    """A median, so that a line of hum does not count."""
    return float(np.median(power[(at_hz >= band_hz[0]) & (at_hz <= band_hz[1])]))


def is_drift(spectra: Iterable[Spectrum]) -> bool:
    """Whether what was seen of late falls from its lowest frequencies on, as no muscle does; the loudest counts."""
    drift, strong, first, after = np.sum([(s.drift, s.strong, s.first, s.after) for s in spectra], axis=0)
    return bool(drift * first > RED * strong * after)


def noise_rms(rms: float, white: float, rest_rms: float) -> float:
    """Return how much of a channel is noise: its rest, or less where muscles work in it; all that is white is noise."""
    of_white = rms * float(np.sqrt(min(white, 1.0))) if np.isfinite(white) else rms
    return of_white if white > WHITE else float(np.fmin(rest_rms, of_white))


def without_pops(values: Floats, size: int) -> Floats:
    """Return values, shape (n,), with NaN where one is POP times what is usual round it, and a while after that.

    No muscle stands out so far. Usual: a high quantile of the magnitudes in a stretch of `size`, or in one beside it
    where that is greater, so that work which begins or ends is whole. Where half of all would go, nothing does: what
    comes so often, as a stimulator's pulses, is no pop.
    """
    n, count = len(values), -(-len(values) // size)
    stretches = np.full(count * size, np.nan)
    stretches[:n] = np.abs(values)
    ordered = np.sort(stretches.reshape(count, size), axis=1)
    at = (USUAL * np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0)).astype(int)
    usual = np.pad(ordered[np.arange(count), at], 1, constant_values=np.nan)
    most = POP * np.fmax(np.fmax(usual[:-2], usual[1:-1]), usual[2:])
    number = np.arange(n)
    newest = np.maximum.accumulate(np.where(stretches[:n] > np.repeat(most, size)[:n], number, -size))
    popped, known = number - newest <= POP_LASTS * size, np.isfinite(values)
    return values if 2 * (popped & known).sum() > known.sum() else np.where(popped, np.nan, values)


def change(squares: Floats, rising: bool) -> int:
    """Return where the variance of a signal changes: the most likely point (Staude & Wolf 1999).

    squares: shape (n,), n at least 1, of a signal of mean 0. rising: it is higher afterwards. Without a
    change, where there is nothing before or after it, the first or the last.
    """
    squares = np.maximum(squares, 1e-30)
    n = len(squares)
    if n < 3:
        return n - 1
    sums = np.cumsum(squares)
    counts = np.arange(1, n)
    before, after = sums[:-1] / counts, np.maximum(sums[-1] - sums[:-1], 1e-30) / (n - counts)
    cost = counts * np.log(before) + (n - counts) * np.log(after)
    right = (after > before) == rising
    best = int(np.argmin(np.where(right, cost, np.inf)))
    if n * np.log(sums[-1] / n) - cost[best] < LEAST_GAIN or not right.any():
        return 0 if rising else n - 1
    return best + 1


def is_rectified(raw: Floats, fs_hz: float) -> bool:
    """Return whether samples, shape (n,), are magnitudes: never below zero, and near it always, or at rest.

    An envelope is at rest near zero, against the work that was seen. A muscle on an offset swings round that.
    """
    known = raw[np.isfinite(raw)]
    size = max(RECTIFIED_FEWEST, round(RECTIFIED_S * fs_hz))
    if len(known) < size or known.min() < 0:
        return False
    pieces = known[: len(known) // size * size].reshape(-1, size)
    means = pieces.mean(axis=1)
    rests = float(np.quantile(means, AT_REST)) < RESTED * float(means.max())
    return rests or float(np.median(pieces.min(axis=1) - RECTIFIED * means)) < 0


def wander(raw: Floats, fs_hz: float) -> Floats:
    """Return how far the level moves: deviation of short means of raw samples, shape (n, channels)."""
    size = max(1, round(WANDER_S * fs_hz))
    n = len(raw) // size
    if n < 2:
        return np.zeros(raw.shape[1])
    means = raw[: n * size].reshape(n, size, -1).mean(axis=1)
    known = np.isfinite(means)
    count = np.maximum(known.sum(axis=0), 1)
    off = np.where(known, means - np.where(known, means, 0.0).sum(axis=0) / count, 0.0)
    return np.asarray(np.sqrt((off**2).sum(axis=0) / count))


class Heart(NamedTuple):
    """rms of what is the heart's, 0 where it is not seen; rate_bpm NaN then."""

    rms: float
    rate_bpm: float


NO_HEART = Heart(0.0, np.nan)


def heart(values: Floats, fs_hz: float) -> Heart:
    """Return what the heart has in values, shape (n,), of some 10 s.

    Peaks that stand out, as far apart as beats, and with one shape: bursts of a muscle never repeat theirs.
    """
    values = np.nan_to_num(values)
    fine = max(1, round(FINE_S * fs_hz))
    if len(values) < fine:
        return NO_HEART
    energy = (values[: len(values) // fine * fine].reshape(-1, fine) ** 2).mean(axis=1)
    energy = np.convolve(energy, np.ones(7) / 7, "same")
    hop_s = fine / fs_hz
    peaks, _ = find_peaks(energy, distance=max(1, round(HEART_PERIOD_S[0] / hop_s)))
    peaks = peaks[energy[peaks] > HEART_STANDS_OUT * np.median(energy)]
    if len(peaks) < HEART_FEWEST:
        return NO_HEART
    peaks = peaks[energy[peaks] > 0.25 * np.quantile(energy[peaks], 0.75)]
    apart_s = float(np.median(np.diff(peaks))) * hop_s if len(peaks) >= HEART_FEWEST else np.inf
    if apart_s > HEART_PERIOD_S[1]:
        return NO_HEART
    energy_sum, likeness = _repeated(values, peaks * fine + fine // 2, fs_hz)
    if likeness < HEART_LIKE:
        return NO_HEART
    return Heart(float(np.sqrt(likeness * energy_sum / len(values))), 60 / apart_s)


def _repeated(values: Floats, at: NDArray[np.int64], fs_hz: float) -> tuple[float, float]:
    """The energy round these places, and the mean correlation with the strongest of them, shifted by HEART_LAG_S."""
    reach, lag = round(HEART_REACH_S * fs_hz), round(HEART_LAG_S * fs_hz)
    at = at[(at >= reach + lag) & (at < len(values) - reach - lag)]
    if len(at) < HEART_FEWEST:
        return 0.0, 0.0
    pieces = np.array([values[i - reach : i + reach + 1] for i in at])
    energies = (pieces**2).sum(axis=1)
    order = np.argsort(energies)
    template = pieces[order[len(order) * 3 // 4]]
    template = template / np.sqrt(template @ template)
    likes = []
    for i in at:
        around = values[i - reach - lag : i + reach + lag + 1]
        power = np.convolve(around**2, np.ones(2 * reach + 1), "valid")
        likes.append(float((np.correlate(around, template, "valid") / np.sqrt(np.maximum(power, 1e-30))).max()))
    return float(energies.sum()), float(np.median(likes))


def quality(noise: float, hum: float, drift: float, heart_rms: float, size: float, filled: float) -> float:
    """Return the quality 0..1 of a channel, a product of terms that are each 1 for a clean one.

    noise, hum, drift, heart_rms: in the unit of size, the rms of the channel where it is loudest; filled: share of the
    samples that are a signal.
    """
    size = max(size, 1e-12)
    clean = filled
    for amplitude, halves in (
        (noise, NOISE_TO_SIZE),
        (hum, HUM_TO_SIZE),
        (drift, WANDER_TO_SIZE),
        (heart_rms, HEART_TO_SIZE),
    ):
        clean /= 1 + (amplitude / (halves * size)) ** 2
    return float(np.clip(clean, 0.0, 1.0))
