"""Numbers of acceleration from arrays: no state, no time, no ROS. Too little signal gives NaN."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks

GRAVITY = 9.80665  # m/s^2
FAST_S, SLOW_S = 0.06, 0.4  # Gaussians between which a step is left: about 0.6 to 3.5 Hz
FINE_HZ = 40.0  # fewer samples per s are drawn through, so that the distance of two steps is not one of a few numbers
PERIOD_S = (0.2, 1.3)  # of steps: from a sprint to a stroll
FEWEST_STEPS, EVEN = 6, 0.25  # in a row, each interval within this share of the one before
SLOW_PERIOD_S = (1.3, 2.6)  # of steps too slow to be told from a sway
APART = 0.3  # alikeness between two of them at most
AROUND_S, ALIKE = 2.5, 0.7  # so far round a step the signal repeats itself, by its autocorrelation
NOISE_SHARE, NOISE_HALVES = 0.25, 1.0  # of the variance that is no noise yet; m/s^2 of noise that halves the quality
GRAVITY_HALVES = 2.0  # m/s^2 by which gravity may be wrong
UPRIGHT_DEG, LYING_DEG = 30.0, 60.0
OFFSET_DEG = 17.0  # from equal axes: how far gravity tilts an offset of twice its size, that of a range of 2 g

Floats = NDArray[np.float64]


def steps(magnitude: Floats, fs_hz: float, least: float) -> NDArray[np.int64]:
    """Return where steps are in the magnitude of acceleration, shape (n,), m/s^2, without NaN.

    Peaks of the band of steps (as Brajdic & Harle 2013, windowed peak detection) that come at even intervals, at least
    FEWEST_STEPS in a row, where the signal repeats itself: noise and gestures have peaks, but no rhythm.
    """
    between = max(1, round(FINE_HZ / fs_hz))
    if between > 1 and len(magnitude) > 1:
        at = np.arange((len(magnitude) - 1) * between + 1)
        magnitude = CubicSpline(np.arange(len(magnitude)) * between, magnitude)(at)
    return np.unique(np.round(_steps(magnitude, fs_hz * between, least) / between).astype(np.int64))


def _steps(magnitude: Floats, fs_hz: float, least: float) -> NDArray[np.int64]:
    """Where steps are in a magnitude sampled finely."""
    band = _smoothed(magnitude, FAST_S, fs_hz) - _smoothed(magnitude, SLOW_S, fs_hz)
    peaks, _ = find_peaks(band, distance=max(1, int(PERIOD_S[0] * fs_hz)), prominence=least)
    even = peaks[_in_rows(np.diff(peaks) / fs_hz)] if len(peaks) >= FEWEST_STEPS else peaks[:0]
    reach = round(AROUND_S * fs_hz)
    rhythmic = [at for at in even.tolist() if _alike(band[max(0, at - reach) : at + reach], fs_hz) >= ALIKE]
    return np.array(rhythmic, np.int64)


def _smoothed(values: Floats, width_s: float, fs_hz: float) -> Floats:
    """A symmetric Gaussian; at both ends the last value goes on."""
    reach = int(np.ceil(4 * width_s * fs_hz))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (width_s * fs_hz)) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), kernel / kernel.sum(), mode="valid")


def _in_rows(intervals_s: Floats) -> NDArray[np.bool_]:
    """Which of the peaks between which these intervals are belong to a row of even ones."""
    inside = np.zeros(len(intervals_s) + 1, bool)
    even = np.zeros(len(intervals_s), bool)
    longer = np.maximum(intervals_s[1:], intervals_s[:-1])
    even[1:] = np.abs(np.diff(intervals_s)) <= EVEN * longer
    begin = 0
    for i in range(1, len(intervals_s) + 1):
        if i == len(intervals_s) or not even[i] or intervals_s[i] > PERIOD_S[1]:
            if i - begin >= FEWEST_STEPS - 1 and intervals_s[begin] <= PERIOD_S[1]:
                inside[begin : i + 1] = True
            begin = i
    return inside


def _alike(band: Floats, fs_hz: float) -> float:
    """The greatest correlation of a signal with itself a step later."""
    lags = range(int(PERIOD_S[0] * fs_hz), min(int(PERIOD_S[1] * fs_hz), len(band) // 2) + 1)
    return max((_alike_after(band, lag) for lag in lags), default=0.0)


def _alike_after(band: Floats, lag: int) -> float:
    """The correlation of a signal with itself so many samples later, 0 at least."""
    one, other = band[lag:], band[:-lag]
    size = float(np.sqrt((one @ one) * (other @ other)))
    return max(0.0, float(one @ other) / size) if size > 0 else 0.0


def sways(magnitude: Floats, fs_hz: float, least: float) -> bool:
    """Return whether the magnitude of acceleration, shape (n,), m/s^2, repeats itself more slowly than steps are told.

    least: rise of a step. Slow steps do so, and a rocking chair: neither the one nor the other is certain.
    """
    level = _smoothed(magnitude, FAST_S, fs_hz)
    level = level - level.mean()
    if len(level) < 2 * SLOW_PERIOD_S[1] * fs_hz or 2 * np.sqrt(2) * level.std() < least:
        return False
    lags = np.arange(max(1, int(PERIOD_S[0] * fs_hz)), int(SLOW_PERIOD_S[1] * fs_hz) + 1)
    alike = np.array([_alike_after(level, lag) for lag in lags.tolist()])
    apart = np.flatnonzero(alike <= APART)
    again = np.flatnonzero(alike >= ALIKE)
    again = again[again > apart[0]] if len(apart) else again[:0]
    if not len(again):
        return False
    first = again[: int(np.argmax(np.diff(again, append=len(lags) + 2) > 1)) + 1]  # the first stretch of lags
    return bool(lags[first[alike[first].argmax()]] >= SLOW_PERIOD_S[0] * fs_hz)


def tilt_deg(one: Floats, other: Floats) -> float:
    """Return the angle between two directions, shape (3,); NaN where one has none."""
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(np.clip(one @ other / size, -1, 1)))) if size > 0 else np.nan


def has_offset(samples: Floats) -> bool:
    """Return whether the mean of samples, shape (n, 3), is nearly the same on all axes, and positive.

    Gravity alone is so in one of fifty positions of a sensor; on the zero of a converter without a sign it is in all.
    """
    return tilt_deg(samples.mean(axis=0), np.ones(3)) <= OFFSET_DEG


def posture(tilted_deg: float) -> str:
    """Return what the trunk does that is tilted by this angle from upright; NaN: unknown."""
    if not np.isfinite(tilted_deg):
        return "unknown"
    return "upright" if tilted_deg <= UPRIGHT_DEG else "lying" if tilted_deg >= LYING_DEG else "leaning"


def noise_rms(acceleration: Floats) -> float:
    """Return the noise of samples, shape (n, axes), m/s^2: what differs from its neighbours as no motion does."""
    if len(acceleration) < 3:
        return 0.0
    bent = np.diff(acceleration, n=2, axis=0)
    power = (bent**2).mean(axis=0) / 6 - NOISE_SHARE * acceleration.var(axis=0)
    return float(np.sqrt(np.maximum(power, 0.0).sum()))


def quality(noise: float, gravity_off: float, filled: float, clipped: float) -> float:
    """Return the quality 0..1, a product of terms that are each 1 for a sound sensor.

    noise, gravity_off: m/s^2; filled, clipped: share of the samples that are there, that are at an end of the range.
    """
    clean = 1 / (1 + (noise / NOISE_HALVES) ** 2) / (1 + (gravity_off / GRAVITY_HALVES) ** 2)
    return float(np.clip(clean * filled * (1 - clipped) ** 2, 0.0, 1.0))
