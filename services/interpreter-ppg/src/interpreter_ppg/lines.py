"""Lines in the spectrum of a PPG: mains and flicker of lamps, which are taken away; a rhythm below the one told."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from sense4hri.hum import MAINS_HZ, folded_hz
from sense4hri.medians import median

from interpreter_ppg import features

Floats = NDArray[np.float64]

MAINS_WANDER_HZ = 0.2
HUM_HZ = (3.0, 12.0)  # below are pulses, above nothing is left after smoothing
LEAST_LEFT = 0.1  # of the hum: where less is left without it, there are no pulses
HUM_PERIODS, HUM_REACH = 1.0, 2.0  # scale of the weight of what is round a sample, and where it ends, in periods
HUM_WINDOW_S = 2.0  # of signal to see a line in
SKIRT, BESIDE, STANDS_OUT = (2.25, 3.15), (3.6, 9.0), 3.0  # widths of a line, 1 / window, and how far it is higher
PULSE_HZ, OVERTONE_HZ = (0.6, 3.5), 0.1  # where the pulses' frequency is sought; how near to a multiple is one
OVERTONE = 0.15  # share of a line that its double has in pulses
RIVAL_S, LEAST_RIVAL_S = 8.0, 4.0  # of signal to see another rhythm in, and at least
LOWEST_RIVAL_HZ, HIGHEST_RIVAL_HZ = 0.5, 4.2  # below are breaths, above overtones
OWN_WIDTHS, OWN_SHARE = 2.8, 0.28  # 1 / window, share of the rate told: how far a heart's own line and breath reach
SHARE_BELOW, SHARE_ABOVE = 0.12, 2.0  # of the height of the line of the rate told, from which another one is a rival
RIVAL_BESIDE, RIVAL_STANDS_OUT = (3.0, 8.0), 3.5  # widths, and how much higher: noise makes lines up to three times


@lru_cache(maxsize=4)
def hum_hz(fs_hz: float) -> tuple[float, ...]:
    """Return where mains and flicker of lamps appear at this sampling rate, as far as pulses have power there."""
    folded = {round(folded_hz(mains_hz * harmonic, fs_hz), 3) for mains_hz in MAINS_HZ for harmonic in (1, 2)}
    return tuple(sorted(line for line in folded if HUM_HZ[0] <= line <= HUM_HZ[1]))


def without_hum(ppg: Floats, fs_hz: float) -> Floats:
    """Return ppg, shape (n,), less the mains that stand out in it; without hum it is returned as it is.

    The kit's `hum` fits a line over seconds, because a QRS complex has power at 50 Hz; folded hum lies among the
    overtones of the pulses, which seconds would mix with those of their neighbours.
    """
    if len(ppg) < HUM_WINDOW_S * fs_hz or not ppg.max() > ppg.min():
        return ppg
    places_hz = hum_hz(fs_hz)
    spectrum, bins_per_hz = amplitudes(ppg, fs_hz) if places_hz else (ppg, 0.0)
    for line_hz in [_line(spectrum, bins_per_hz, len(ppg) / fs_hz, place_hz) for place_hz in places_hz]:
        if line_hz is not None:
            wave = _wave(ppg - ppg.mean(), fs_hz, line_hz)
            if np.ptp(ppg - wave) > LEAST_LEFT * np.ptp(wave):
                ppg = ppg - wave
    return ppg


def _wave(ppg: Floats, fs_hz: float, hz: float) -> Floats:
    """Return the wave of this frequency in ppg, for every sample from what is round it, so that it may drift.

    Towards the ends, where there is not enough round a sample, the outermost wave goes on.
    """
    half = min(round(HUM_REACH * fs_hz / hz), (len(ppg) - 1) // 2)
    periods = np.arange(-half, half + 1) * (hz / fs_hz)
    weight, turn = np.exp(-0.5 * (periods / HUM_PERIODS) ** 2), np.exp(2j * np.pi * periods)
    wave = np.convolve(ppg, turn * weight / (weight @ turn.real**2), "valid")
    before, after = turn[:half], turn[half + 1 :]
    return np.concatenate([wave[0] * before, wave, wave[-1] * after]).real


def amplitudes(ppg: Floats, fs_hz: float) -> tuple[Floats, float]:
    """Return the spectrum of ppg, shape (n,), eight times and more as fine as n tells apart, and its bins per Hz."""
    size = 8 << len(ppg).bit_length()
    return np.abs(np.fft.rfft((ppg - ppg.mean()) * _taper(len(ppg)), size)), size / fs_hz


@lru_cache(maxsize=4)
def _taper(count: int) -> Floats:
    return np.asarray(np.hanning(count), np.float64)


def _line(spectrum: Floats, bins_per_hz: float, window_s: float, near_hz: float) -> float | None:
    """Return the frequency of a line near near_hz, None where none stands out, or where its overtone says: a heart."""
    first, last = (int((near_hz + side * MAINS_WANDER_HZ) * bins_per_hz) for side in (-1, 1))
    best = first + int(spectrum[first : last + 2].argmax())
    if not spectrum[best] >= max(spectrum[best - 1 : best + 2].tolist()):
        return None
    for widths, level in ((SKIRT, np.max), (BESIDE, median)):  # hardly anything gets past the first
        if spectrum[best] < STANDS_OUT * level(_around(spectrum, best, widths, bins_per_hz / window_s)):
            return None
    overtone = spectrum[2 * best] if 2 * best < len(spectrum) else 0.0
    if near_hz * 60 <= features.FASTEST_BPM and overtone > OVERTONE * spectrum[best]:
        return None
    if _is_overtone(spectrum, best, bins_per_hz):
        return None
    return best / bins_per_hz


def _is_overtone(spectrum: Floats, best: int, bins_per_hz: float) -> bool:
    """Return whether a bin is a multiple of the pulses' frequency, and lower than the multiple before it."""
    lowest, highest = (int(hz * bins_per_hz) for hz in PULSE_HZ)
    pulse = lowest + int(np.argmax(spectrum[lowest:highest]))
    order = round(best / pulse)
    before = spectrum[max(0, best - pulse - 2) : best - pulse + 3]
    return order >= 2 and abs(best - order * pulse) < OVERTONE_HZ * bins_per_hz and spectrum[best] < before.max()


def _around(spectrum: Floats, best: int, widths: tuple[float, float], bins_per_width: float) -> Floats:
    """Return what lies that far from a bin, on both sides."""
    near, far = (int(distance * bins_per_width) for distance in widths)
    return np.concatenate([spectrum[max(0, best - far) : best - near], spectrum[best + near : best + far]])


def second_rhythm_hz(ppg: Floats, fs_hz: float, told_hz: float) -> float:
    """Return the lowest line that stands out in evenly spaced ppg, shape (n,), and is no multiple of the rate told.

    A pulse that repeats has nothing between breathing and its own rate. What is there is a heart under steps that are
    told in its place, or half of what is told: the second wave of each beat was taken for a pulse, or beats alternate.
    Above the rate told a line counts only where it is much the higher one: pulses are irregular. NaN: none.
    """
    ppg = ppg[-round(RIVAL_S * fs_hz) :]
    window_s = len(ppg) / fs_hz
    if window_s < LEAST_RIVAL_S:
        return np.nan
    rise = features.steady(features.slope(ppg, fs_hz), fs_hz)
    most = features.typical_rise(rise, fs_hz, features.LONGEST_PERIOD_S / 2)  # an artefact must not outweigh the rest
    spectrum, bins_per_hz = amplitudes(np.clip(rise, -most, most), fs_hz)
    apart = max(OWN_WIDTHS / window_s, OWN_SHARE * told_hz) * bins_per_hz
    told = told_hz * bins_per_hz
    own = spectrum[int(told - bins_per_hz / window_s) : int(told + bins_per_hz / window_s) + 2].max()
    found = features.maxima(spectrum[: int(HIGHEST_RIVAL_HZ * bins_per_hz)])
    for line in found[spectrum[found] > min(SHARE_BELOW, SHARE_ABOVE) * own].tolist():
        if line > LOWEST_RIVAL_HZ * bins_per_hz and abs(line - max(1, round(line / told)) * told) > apart:
            share = SHARE_BELOW if line < told else SHARE_ABOVE
            beside = _around(spectrum, line, RIVAL_BESIDE, bins_per_hz / window_s)
            if spectrum[line] > share * own and spectrum[line] > RIVAL_STANDS_OUT * median(beside):
                return line / bins_per_hz
    return np.nan
