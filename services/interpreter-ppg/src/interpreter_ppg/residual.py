"""What is left of a PPG once its pulses are taken off: noise, or another rhythm. Arrays in, answers out.

Motion adds to the pulses, so what is left repeats at a rate of its own. Breathing changes the pulses: their length and
height are taken off with them, and what is left of their shape repeats with them, or with the breaths.
"""

import numpy as np
from numpy.typing import NDArray
from sense4hri.medians import median, medians

from interpreter_ppg import features

Floats = NDArray[np.float64]

# Periods of another rhythm that are looked for, in those told: nearer ones and multiples are the pulses themselves.
PERIODS = np.concatenate([np.arange(0.55, 0.93, 0.005), np.arange(1.08, 1.6, 0.005)])
MOST_UNEVEN = 1.25  # longest interval over the shortest: a rate that changes fast changes the shape of its pulses
REPEATS = (1, 2, 3)  # times that what is left is to repeat: breaths are slower, and noise does once or twice
COMPARED = 0.25  # of what is left, at least, on which a repeat is seen
# How well it repeats, and how high that makes the other rhythm beside the whole: at rest it is below one or the other.
LEAST_CORRELATION, LEAST_SHARE = 0.4, 0.07


def without_pulses(wave: Floats, times_s: Floats, rises_s: Floats) -> tuple[Floats, Floats]:
    """Return wave from the first rise to the last, and what is left of it without pulses; both of shape (m,).

    wave, times_s: shape (n,); rises_s: of the pulses. What is taken off is the median pulse, as long as each interval
    and as high as it is there.
    """
    turns = features.turns(wave, times_s, rises_s)
    pulse = medians(turns.T)
    pulse -= pulse.mean()
    power = float(pulse @ pulse)
    heights = turns @ pulse / power if power > 0 else np.zeros(len(turns))
    inside = slice(*times_s.searchsorted((rises_s[0], rises_s[-1])))
    turn = np.interp(times_s[inside], rises_s, np.arange(len(rises_s)))
    height = np.interp(turn, np.arange(len(heights)) + 0.5, heights)
    return wave[inside], wave[inside] - height * np.interp(turn, features.PHASES, pulse, period=1.0)


def correlations(values: Floats) -> Floats:
    """Return how alike values, shape (n,), are to themselves so many samples later, shape (n,); 0 where all are 0."""
    n = len(values)
    spectrum = np.fft.rfft(values - values.mean(), 1 << (2 * n - 1).bit_length())
    products = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[:n] / (n - np.arange(n))
    return products / products[0] if products[0] > 0 else np.zeros(n)


def another_rhythm(wave: Floats, times_s: Floats, rises_s: Floats) -> bool:
    """Return whether what is left of wave without its pulses, arguments as there, repeats at a rate of its own."""
    intervals_s = np.diff(rises_s)
    if len(intervals_s) < features.FEWEST_TURNS or intervals_s.max() > MOST_UNEVEN * intervals_s.min():
        return False
    whole, left = without_pulses(wave, times_s, rises_s)
    n, fs_hz = len(left), (len(times_s) - 1) / (times_s[-1] - times_s[0])
    lags = PERIODS * median(intervals_s) * fs_hz
    lags = lags[REPEATS[-1] * lags <= (1 - COMPARED) * n]
    if not len(lags):
        return False
    alike = correlations(left)
    repeats = float(np.min([np.interp(times * lags, np.arange(n), alike) for times in REPEATS], axis=0).max())
    return repeats > LEAST_CORRELATION and repeats * left.std() > LEAST_SHARE * whole.std()
