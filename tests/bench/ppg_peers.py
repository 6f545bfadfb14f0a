"""Pulse detectors of others, as their users call them: counts in, times out. They say nothing of quality."""

from collections.abc import Callable

import neurokit2 as nk
import numpy as np
from ppg_trials import Floats
from scipy.signal import find_peaks


def elgendi(ppg: Floats, fs_hz: float) -> Floats:
    """Return the pulses, s, of neurokit2's default: band-pass, then Elgendi et al. 2013."""
    clean = nk.ppg_clean(ppg, sampling_rate=fs_hz)
    return np.asarray(nk.ppg_findpeaks(clean, sampling_rate=fs_hz)["PPG_Peaks"]) / fs_hz


def naive(ppg: Floats, fs_hz: float) -> Floats:
    """Return the maxima, s, that stand out by half a standard deviation, 0.3 s apart."""
    return find_peaks(ppg, distance=max(1, int(0.3 * fs_hz)), prominence=0.5 * ppg.std())[0] / fs_hz


PEERS: dict[str, Callable[[Floats, float], Floats]] = {"neurokit2": elgendi, "find_peaks": naive}
