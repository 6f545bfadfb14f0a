"""ECG arithmetic: arrays in, numbers out. Everything here is free of scale; amplitudes keep the unit they come in."""

from collections.abc import Sequence
from functools import lru_cache
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

QRS_HZ, QRS_SIGMA_S = 14.0, 0.03  # of the wavelet: here a QRS has its energy; P and T waves, wander, mains have not
SHARP_HZ, SHARP_SIGMA_S = 24.0, 0.024  # here a tall P wave has none either
PEAK_REACH_S = 0.1  # the R peak is looked for this far around the middle of the QRS energy
SINC_REACH_S = 0.06
BAND_HZ, BAND_SHARE = 65.0, 0.45  # pass band of the interpolation: at most that, and this share of the sampling rate
SLOW_S = 0.12  # what is slower than this is no part of the peak when the largest deflection is chosen
FINE_S = 0.001  # grid of the interpolation, refined by a parabola
NOISE_EVERY_S, MEDIAN_OF_NORMAL = 0.02, 0.6745  # where slopes are looked at for noise; their median over their rms
CUT_OFF_S, CUT_OFF_SAMPLES = 0.005, 3  # equal samples at the top of a beat, from which it is cut off by a limit ...
CORNER = 0.03  # ... if it falls by this share of its height within two samples on both sides: coarse steps do not
BELL = 8 * np.log(2)  # curvature of a bell at its top, in its height over the square of its width at half of that
MOST_JITTER_S = 0.01  # noise moves a peak no further, it makes another one
FLIP = 0.7  # log of the ratio by which the other polarity must be larger than the usual one to be taken ...
ONE_COMPLEX_S = 0.1  # ... unless the two are further apart: of a beat that wide the larger one is taken
SHAPE_S, SHAPE_HZ = (-0.15, 0.25), 100.0  # the part of a beat that is compared with other beats
SMOOTH_S = 0.01  # Gaussian before that: 50 and 60 Hz are gone, so hum is not taken for a beat
SIGNAL_PER_ENERGY = 3.0  # a beat has at most this rms per QRS energy; 0.7 is usual, 2 is seen in paced ones
NOISE_AT_HALF = 0.4  # noise over signal (rms) at which a beat is half noise
CONTRAST = (0.15, 0.4)  # share of a beat's energy between beats: a heart has less, what swings to and fro more
WAVE_S, WAVE_REACH = 0.05, 3.5  # of the wavelet that sees T waves and wide beats; how many of these it reaches
TOP_S, OWN_T_WAVE_S = 0.06, (0.22, 0.36)  # a wave's top is so near its QRS energy; so long after it comes its T wave
WAVES_FS_HZ = 100.0  # at which they are looked for
MEAN_S = 0.1  # of the baseline
AS_AFTER = 2.0  # times the mean square of the steps after a beat: hum that is there in any case swings by so much
NEWEST_BEATS = 4  # are judged by themselves too, so noise that sets in counts before it fills the window
BY_CHANCE = 0.2  # what pure noise scores because some of its peaks resemble each other


SHAPE_OFFSETS_S = np.arange(round((SHAPE_S[1] - SHAPE_S[0]) * SHAPE_HZ) + 1) / SHAPE_HZ + SHAPE_S[0]
_RAMP = np.arange(len(SHAPE_OFFSETS_S)) - (len(SHAPE_OFFSETS_S) - 1) / 2
_RAMP_POWER = float(_RAMP @ _RAMP)


class Peak(NamedTuple):
    """The R peak of one beat."""

    offset_s: float  # after the sample it was looked for around
    height: float  # above the median of its surroundings, negative for a downward peak
    upness: float  # log ratio of the largest upward to the largest downward deflection
    width_s: float  # at half the height
    bend: float  # curvature there, unit of ecg per s^2, not negative


def qrs_wavelet(fs_hz: float) -> NDArray[np.complex128]:
    """The wavelet of the QRS energy, shape (2 n + 1,)."""
    return _gabor(fs_hz, QRS_HZ, QRS_SIGMA_S)


def sharp_wavelet(fs_hz: float) -> NDArray[np.complex128]:
    """The wavelet that tells a QRS complex from a P wave, shape (2 n + 1,)."""
    return _gabor(fs_hz, min(SHARP_HZ, 0.3 * fs_hz), SHARP_SIGMA_S)


def _gabor(fs_hz: float, hz: float, sigma_s: float) -> NDArray[np.complex128]:
    """A complex Gabor wavelet of zero mean and unit gain at its centre, shape (2 n + 1,)."""
    n = int(np.ceil(3 * sigma_s * fs_hz))
    t_s = np.arange(-n, n + 1) / fs_hz
    window = np.exp(-0.5 * (t_s / sigma_s) ** 2)
    carrier = np.exp(2j * np.pi * hz * t_s)
    wavelet = window * carrier
    wavelet -= window * (wavelet.sum() / window.sum())
    return np.asarray(wavelet / abs(np.sum(wavelet * carrier.conj())))


def qrs_energy(ecg: Floats, wavelet: NDArray[np.complex128]) -> Floats:
    """Amplitude of the wavelet in ecg, shape (len(ecg) - len(wavelet) + 1,), in the unit of ecg; no lag.

    Being the modulus of a complex wavelet it has one smooth hump per QRS complex, whatever the polarity.
    """
    return np.hypot(np.convolve(ecg, wavelet.real, "valid"), np.convolve(ecg, wavelet.imag, "valid"))


class PeakFinder:
    """Finds the R peak near the middle of a QRS complex to a fraction of a sample.

    Band-limited (windowed sinc) interpolation to 1 ms, then a parabola: on 130 Hz recordings 0.1-0.3 ms from the
    extremum at 360 Hz. The interpolation is linear in phase, so the peak is where the raw signal has it.
    """

    def __init__(self, fs_hz: float) -> None:
        self.reach = int(np.ceil((PEAK_REACH_S + SINC_REACH_S) * fs_hz))
        steps = round(PEAK_REACH_S / FINE_S)
        self._fine_s = np.arange(-steps, steps + 1) * FINE_S
        lag_s = self._fine_s[:, None] - np.arange(-self.reach, self.reach + 1) / fs_hz
        cutoff_hz = min(BAND_HZ, BAND_SHARE * fs_hz)
        taper = np.where(np.abs(lag_s) < SINC_REACH_S, np.cos(np.pi * lag_s / 2 / SINC_REACH_S) ** 2, 0.0)
        self.sharpest_s = 1.207 / (2 * cutoff_hz)  # width at half its height of a single sample
        kernel = np.sinc(2 * cutoff_hz * lag_s) * taper
        self._kernel = kernel / kernel.sum(axis=1, keepdims=True)
        slow = np.abs(lag_s) <= SLOW_S / 2
        self._sharp_kernel = self._kernel - slow / slow.sum(axis=1, keepdims=True)
        near = np.abs(lag_s[steps]) <= SINC_REACH_S
        self._slope_kernel = ((self._kernel[steps + 1] - self._kernel[steps - 1]) / (2 * FINE_S))[near]
        self._every = max(round(NOISE_EVERY_S * fs_hz), 1)

    def find(self, ecg: Floats, usual_sign: float) -> Peak:
        """The largest deflection in ecg, shape (2 reach + 1,).

        Of the usual sign, unless the other is twice as large, or larger in a beat that is wider than usual ones are.
        """
        sharp, fine = self._sharp_kernel @ ecg, self._kernel @ ecg
        highest, lowest = int(sharp.argmax()), int(sharp.argmin())
        up, down = max(sharp[highest], 0.0), max(-sharp[lowest], 0.0)
        upness = float(np.log((up + 1e-12) / (down + 1e-12)))
        top, bottom = summit(fine, highest, 1.0), summit(fine, lowest, -1.0)
        if abs(top - bottom) * FINE_S > ONE_COMPLEX_S:
            usual_sign = 0.0
        sign, i = (1.0, top) if upness + FLIP * usual_sign >= 0 else (-1.0, bottom)
        values: list[float] = (sign * fine).tolist()
        level = median(ecg.tolist())
        width = width_s(values, i, sign * level)
        offset = bend = 0.0
        if 0 < i < len(values) - 1:
            before, at, after = values[i - 1 : i + 2]
            offset, bend = parabolic_offset(before, at, after), ((at - before) - (after - at)) / FINE_S**2
        bend = min(bend, BELL * (values[i] - sign * level) / width**2)
        return Peak(float(self._fine_s[i] + offset * FINE_S), sign * values[i] - level, upness, width, bend)

    def jitter_s(self, ecg: Floats, peak: Peak) -> float:
        """Return the standard deviation in s that the noise of ecg, some seconds round a peak, gives its time.

        At the peak the slope is 0 and falls at the rate of the bend: noise in the one over the other. Half of the time
        a heart has hardly a slope, so the median slope of ecg is that of the noise, whatever its spectrum.
        """
        if len(ecg) < len(self._slope_kernel) or not peak.bend > 0:
            return MOST_JITTER_S
        width = len(self._slope_kernel)
        looks = np.arange(0, len(ecg) - width + 1, self._every)[:, None] + np.arange(width)
        slopes = np.abs(np.einsum("an,n->a", ecg.take(looks), self._slope_kernel))
        return min(median(slopes.tolist()) / MEDIAN_OF_NORMAL / peak.bend, MOST_JITTER_S)


def middle_of_cut(ecg: Floats, at: float, height: float, fs_hz: float) -> float:
    """Return the middle of the top that a limit of the amplifier has cut off at the fractional index `at`; NaN without.

    Interpolation finds a peak at either end of such a top, now here, now there. Its ends are where the slopes beside it
    would reach the limit. height: of the peak, negative for a downward one.
    """
    top = first = last = min(max(round(at), 0), len(ecg) - 1)
    while first > 0 and ecg[first - 1] == ecg[top]:
        first -= 1
    while last < len(ecg) - 1 and ecg[last + 1] == ecg[top]:
        last += 1
    if last - first < max(CUT_OFF_SAMPLES - 1, CUT_OFF_S * fs_hz) or first < 2 or last > len(ecg) - 3:
        return np.nan
    before, after = ecg[first - 2 : first + 1].tolist(), ecg[last : last + 3][::-1].tolist()
    if any(not (limit - outer) * height > CORNER * height**2 for outer, _, limit in (before, after)):
        return np.nan
    return (first + last + _reached(*after) - _reached(*before)) / 2


def _reached(before: float, beside: float, limit: float) -> float:
    """How many steps before the limit, 0 to 1, a line through the two samples beside it reaches it."""
    slope = beside - before
    return 1 - min(max((limit - beside) / slope, 0.0), 1.0) if slope else 0.0


def summit(values: Floats, i: int, sign: float) -> int:
    """Where one arrives going uphill from index i; downhill where the sign is -1."""
    while 0 < i < len(values) - 1:
        before, at, after = (sign * values[i - 1 : i + 2]).tolist()
        if at >= max(before, after):
            break
        i += 1 if after > before else -1
    return i


def width_s(fine: Sequence[float], top: int, level: float) -> float:
    """Width in s at half the height over level of the peak at index top, on the grid of FINE_S."""
    half, before, after = (fine[top] + level) / 2, top - 1, top + 1
    while before >= 0 and fine[before] >= half:
        before -= 1
    while after < len(fine) and fine[after] >= half:
        after += 1
    return FINE_S * (after - before - 1)


def parabolic_offset(before: float, at: float, after: float) -> float:
    """Where, in steps from the middle one, the parabola through three equally spaced values has its vertex."""
    curvature = before - 2 * at + after
    return 0.5 * (before - after) / curvature if curvature else 0.0


def beat_shape(ecg: Floats, at: float, fs_hz: float) -> Floats:
    """The beat round the fractional index `at` at 100 Hz, without hum and linear trend; shape (41,)."""
    smooth = _smoothing(fs_hz)
    reach = len(smooth) // 2
    first, last = int(at + SHAPE_S[0] * fs_hz) - 1, int(at + SHAPE_S[1] * fs_hz) + 2
    around = ecg.take(np.arange(first - reach, last + reach + 1), mode="clip")
    smoothed = np.convolve(around, smooth, "valid")
    values = np.interp(at + SHAPE_OFFSETS_S * fs_hz, np.arange(first, last + 1), smoothed)
    return np.asarray(values - values.sum() / len(values) - _RAMP * (values @ _RAMP) / _RAMP_POWER)


@lru_cache(maxsize=8)
def _smoothing(fs_hz: float) -> Floats:
    """The Gaussian of SMOOTH_S, shape (2 n + 1,)."""
    reach = int(np.ceil(3 * SMOOTH_S * fs_hz))
    smooth = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (SMOOTH_S * fs_hz)) ** 2)
    return np.asarray(smooth / smooth.sum())


def likeness_to_spike(shape: Floats) -> float:
    """Correlation of a beat_shape with that of a single sample."""
    spike = np.exp(-0.5 * (SHAPE_OFFSETS_S / SMOOTH_S) ** 2)
    spike -= spike.mean()
    power = float(shape @ shape) * float(spike @ spike)
    return abs(float(spike @ shape)) / np.sqrt(power) if power > 0 else 0.0


def edge(ecg: Floats) -> float:
    """The smaller of the largest rise and the largest fall from one sample to the next, as a share of the range of ecg.

    ecg: the samples of one beat, shape (n,). 1 for what comes and goes within a sample each, however long it stays.
    """
    steps, height = ecg[1:] - ecg[:-1], float(ecg.max() - ecg.min())
    return float(min(steps.max(), -steps.min())) / height if height > 0 else 0.0


def unrest(between: Floats, beat: Floats, after: Floats) -> float:
    """Mean square of the steps from sample to sample before a beat, as a share of that in the beat; 0 for nothing.

    Steady mains has no QRS energy, yet is as steep as a beat. Up to AS_AFTER times what goes on after the beat, a
    median, it does not count.
    """
    if min(len(between), len(beat)) < 2 or beat.max() == beat.min():
        return 0.0
    before, within, later = (_squared_steps(ecg) for ecg in (between, beat, after))
    usual = median(later.tolist()) if len(later) else 0.0
    return float((before.sum() / len(before) - AS_AFTER * usual) / (within.sum() / len(within)))


def baseline(ecg: Floats, fs_hz: float) -> Floats:
    """Means over 0.1 s of ecg, shape (n,); a zero where it is shorter than that."""
    width = round(MEAN_S * fs_hz)
    return np.convolve(ecg, np.full(width, 1 / width), "valid") if len(ecg) >= width else np.zeros(1)


def _squared_steps(ecg: Floats) -> Floats:
    """From each sample to the next, shape (n - 1,)."""
    return np.asarray((ecg[1:] - ecg[:-1]) ** 2)


def slow_wave(ecg: Floats, middle: int, fs_hz: float, until_s: float) -> tuple[float, float, float]:
    """Where the wave round index `middle` has its top, in s after it, and its own T wave as a share of it.

    A wide ventricular beat has a T wave of its own, against its QRS complex, a narrow one mostly in its direction (the
    third value); a T wave has none. until_s: after the middle, where the next beat's P wave may begin; 0 where that
    leaves nothing to look at. All as a wavelet (Ricker's) has them, so wander does not count. A broad wave has a side
    lobe then, which only falls so long after it.
    """
    wavelet = _slow_wavelet(fs_hz)
    grid_s = np.arange(round((2 * TOP_S + OWN_T_WAVE_S[1]) * WAVES_FS_HZ) + 1) / WAVES_FS_HZ - TOP_S
    first = np.rint(middle + grid_s * fs_hz).astype(int) - len(wavelet) // 2
    waves = ecg.take(first[:, None] + np.arange(len(wavelet)), mode="clip") @ wavelet
    top = int(np.abs(waves[: round(2 * TOP_S * WAVES_FS_HZ) + 1]).argmax())
    after_s = grid_s - grid_s[top]
    window = (after_s >= OWN_T_WAVE_S[0]) & (after_s <= OWN_T_WAVE_S[1]) & (grid_s <= until_s)
    answers = -waves / (waves[top] or np.inf)
    return float(grid_s[top]), _highest_rising(answers, window), _highest_rising(-answers, window)


def _highest_rising(values: Floats, window: NDArray[np.bool_]) -> float:
    """The largest in the window that is larger than the one before it; 0 without one above that."""
    rising = window[1:] & (values[1:] > values[:-1])
    return float(values[1:][rising].max(initial=0.0))


@lru_cache(maxsize=8)
def _slow_wavelet(fs_hz: float) -> Floats:
    """Ricker's wavelet of WAVE_S, of zero mean, shape (2 n + 1,)."""
    reach = int(np.ceil(WAVE_REACH * WAVE_S * fs_hz))
    t = np.arange(-reach, reach + 1) / fs_hz / WAVE_S
    wavelet = (1 - t**2) * np.exp(-0.5 * t**2)
    return np.asarray(wavelet - wavelet.mean())


def contrast(valleys: Sequence[float]) -> float:
    """How clearly beats stand out of what is between them, 0..1; valleys: Beat.valley.

    At 240 beats a minute a tenth of a beat's energy is between beats; a sine has the same everywhere, a tremor half.
    """
    return float(np.interp(median(valleys), CONTRAST, (1.0, 0.0)))


def signal_quality(shapes: Floats, energies: Sequence[float]) -> tuple[float, float]:
    """Quality 0..1 of a stretch of ECG from the shapes of its beats, shape (beats, points), and of its newest beats.

    NaN with fewer than three.

    Every beat is compared with the one most like it, so ectopic beats and bundle branch blocks count as signal as soon
    as there are two alike; half of the squared distance is noise. With r = noise / signal (rms, median over the beats)
    the score is 1 / (1 + (r / 0.4)^2), less what noise scores by chance: 0.97 on a clean strap, below 0.7 where beats
    get lost or invented, 0 for noise. What is far larger than the QRS energy of the beats, energies, is no
    signal: hum is all alike but no heartbeat. In the spirit of Orphanidou et al. (2015), IEEE JBHI 19:832, who
    correlate with a mean.
    """
    if len(shapes) < 3:
        return np.nan, np.nan
    power = np.einsum("ij,ij->i", shapes, shapes)
    distance = np.maximum(power[:, None] + power - 2 * shapes @ shapes.T, 0.0)
    np.fill_diagonal(distance, np.inf)
    nearest = (distance.min(axis=1) / 2).tolist()
    within = shapes.shape[1] * (SIGNAL_PER_ENERGY * median(energies)) ** 2
    strength = min(median(power.tolist()), within)
    return _score(median(nearest), strength), _score(median(nearest[-NEWEST_BEATS:]), strength)


def _score(noise: float, power: float) -> float:
    """Quality of beats of that power, the noise in it included."""
    if power <= noise:
        return 0.0
    quality = 1 / (1 + noise / (power - noise) / NOISE_AT_HALF**2)
    return max(0.0, (quality - BY_CHANCE) / (1 - BY_CHANCE))
