"""Spectra of EEG and what they say. Stateless; arrays are (..., channels).

Power spectral density by Welch 1967: Hann windows, means over segments, a straight line taken out of each. Band powers
are sums over the bins from the lower edge on and below the upper one, so that the bands add up to the whole; tools that
integrate by Simpson's rule differ by a few percent.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

BANDS = ("delta", "theta", "alpha", "beta", "gamma")
HIGHEST_HZ = 101.0  # spectra are kept up to here
EEG_HZ = (1.0, 45.0)  # where an electrode measures the brain
BRAIN_HZ = (4.0, 30.0)  # what other things are compared with
SLOW_HZ, FAST_HZ = (2.0, 12.0), (20.0, 45.0)  # EEG has far more below than above; white noise and muscle have not
PEAK_HZ, AROUND_HZ, WIDE_HZ = (7.0, 13.0), (2.0, 30.0), (6.0, 14.0)  # alpha peak, what its background is, but for
STANDS_OUT = 2.0  # times the background that the alpha peak is high
WHITE, HUM, SLOW = 0.25, 10.0, 10.0  # where the terms of quality are a half
LINE_HZ = ((1.5, 6.0), (14.0, 45.0))  # where a line is looked for
LINE_BESIDE = 3  # bins to what is beside it: Hann's lobe
LINE, LINE_LEAVES = 60.0, 0.5  # times what is beside it that a line halves the quality; no line lowers it further

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Spectrum(NamedTuple):
    """psd: power spectral density, unit^2/Hz, shape (bins, channels), at multiples of step_hz."""

    psd: Floats
    step_hz: float

    @property
    def hz(self) -> Floats:
        """The frequency of each bin."""
        return np.arange(len(self.psd), dtype=np.float64) * self.step_hz

    def within(self, low_hz: float, high_hz: float) -> Floats:
        """Return the bins from low_hz on and below high_hz."""
        first, end = (round(np.ceil(hz / self.step_hz - 1e-6)) for hz in (low_hz, high_hz))
        return self.psd[first:end]

    def power(self, low_hz: float, high_hz: float) -> Floats:
        """Return the power of a band, unit^2, shape (channels,); NaN where the spectrum ends before it."""
        if high_hz > self.hz[-1] + self.step_hz / 2:
            return np.full(self.psd.shape[1], np.nan)
        return np.asarray(self.within(low_hz, high_hz).sum(axis=0) * self.step_hz)


def without_line(segment: Floats) -> tuple[Floats, Floats]:
    """Return the segment without its straight line, and the line's rise over it, shape (channels,)."""
    count = len(segment)
    ramp = np.arange(count) / (count - 1) - 0.5
    rise = (ramp[:, None] * segment).sum(axis=0) / (ramp**2).sum()
    return segment - segment.mean(axis=0) - ramp[:, None] * rise, rise


def spectrum(segment: Floats, fs_hz: float) -> Spectrum:
    """Return the spectrum of one segment, shape (n, channels), whose straight line is taken out."""
    count = len(segment)
    taper = np.hanning(count + 1)[:-1]
    power = np.abs(np.fft.rfft(segment * taper[:, None], axis=0)) ** 2 * (2 / (fs_hz * (taper**2).sum()))
    step_hz = fs_hz / count
    kept = min(int(HIGHEST_HZ / step_hz), (count - 1) // 2)
    return Spectrum(power[: kept + 1], step_hz)


def mended(found: Spectrum, removed: Spectrum) -> Spectrum:
    """Return the spectrum with bins of which more was removed than is left drawn through from those beside them.

    What is fitted as mains holds what the brain has at that frequency (Leske & Dalal 2019 do the same by the spectrum).
    """
    psd = found.psd.copy()
    bins = np.arange(len(psd))
    for column in np.flatnonzero(removed.psd.any(axis=0)):
        good = removed.psd[:, column] <= psd[:, column]
        if good.any():
            psd[:, column] = np.interp(bins, bins[good], psd[good, column])
    return Spectrum(psd, found.step_hz)


def relative(powers: Floats) -> Floats:
    """Return each band's share of all bands that there are; powers: shape (bands, channels)."""
    total = np.nansum(powers, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0, powers / total, np.nan)


def fast_density(found: Spectrum) -> Floats:
    """Return the usual density in FAST_HZ, or what the sampling rate shows of it, shape (channels,).

    The median, so that a rhythm in it is not taken for noise.
    """
    return np.asarray(np.median(found.within(FAST_HZ[0], min(FAST_HZ[1], 0.9 * found.hz[-1])), axis=0))


def whiteness(found: Spectrum) -> Floats:
    """Return the density of fast over slow frequencies, shape (channels,): 1 of white noise, usually < 0.1 of EEG."""
    slow = found.within(*SLOW_HZ).mean(axis=0)
    return np.asarray(fast_density(found) / np.maximum(slow, 1e-30))


def lines(found: Spectrum) -> tuple[Floats, Floats]:
    """Return how often the density of the clearest line is that on either side of it, and its Hz, shapes (channels,).

    A rhythm of the brain is broader than a bin; what walks, pumps or flickers is not. Alpha is left out, which in some
    people is as narrow.
    """
    psd, hz = found.psd, found.hz[LINE_BESIDE:-LINE_BESIDE]
    beside = np.maximum(psd[: -2 * LINE_BESIDE], psd[2 * LINE_BESIDE :])
    inside = np.any([(hz >= low) & (hz < high) for low, high in LINE_HZ], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.nan_to_num(psd[LINE_BESIDE:-LINE_BESIDE] / beside)[inside]
    return ratio.max(axis=0), hz[inside][ratio.argmax(axis=0)]


def rms(found: Spectrum) -> Floats:
    """Return the root mean square in EEG_HZ, or what the sampling rate shows of it, in the unit, shape (channels,)."""
    return np.asarray(np.sqrt(found.within(*EEG_HZ).sum(axis=0) * found.step_hz))


def alpha_peak_hz(psd: Floats, step_hz: float) -> float:
    """Return the frequency of the alpha peak of one spectrum, shape (bins,), NaN where none stands out.

    The background is a straight line through log power over log frequency (Corcoran et al. 2018); the top is that of
    the parabola through the highest three bins.
    """
    hz = np.arange(len(psd)) * step_hz
    around = (hz >= AROUND_HZ[0]) & (hz <= AROUND_HZ[1])
    beside = around & ~((hz > WIDE_HZ[0]) & (hz < WIDE_HZ[1]))
    if not np.isfinite(psd).all() or beside.sum() < 4 or not (psd[around] > 0).all():
        return np.nan
    line = np.polynomial.Polynomial.fit(np.log(hz[beside]), np.log(psd[beside]), 1)
    above = np.full(len(psd), -np.inf)
    above[around] = np.log(psd[around]) - line(np.log(hz[around]))
    inside = np.flatnonzero((hz >= PEAK_HZ[0]) & (hz <= PEAK_HZ[1]))
    top = int(inside[np.argmax(above[inside])])
    before, here, after = above[top - 1 : top + 2]
    if here < np.log(STANDS_OUT) or here < before or here < after:
        return np.nan
    return float(step_hz * (top + 0.5 * (before - after) / (before - 2 * here + after)))


def quality_terms(found: Spectrum, hum: Floats, drift: Floats) -> dict[str, Floats]:
    """Return the terms of quality, each 0..1 and shape (channels,), by what lowers them.

    found: mean spectrum. hum, drift: rms of the mains and of what is slower than EEG, in the spectrum's unit. All three
    are measured against the power of theta, alpha and beta, so no scale is needed.
    """
    brain = np.sqrt(found.power(*BRAIN_HZ))
    slow = np.sqrt(drift**2 + found.power(1.0, 4.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            "no spectrum of EEG: noise or muscle": 1 / (1 + (whiteness(found) / WHITE) ** 2),
            "mains": 1 / (1 + (hum / (HUM * brain)) ** 2),
            "drift or motion": 1 / (1 + (slow / (SLOW * brain)) ** 2),
        }
