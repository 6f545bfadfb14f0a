"""R-peak detectors of others, as their users call them: uV in, times in s out. They say nothing of quality."""

from collections.abc import Callable

import neurokit2 as nk
import numpy as np
import sleepecg
from numpy.typing import NDArray
from wfdb.processing import XQRS

Floats = NDArray[np.float64]


def neurokit(ecg: Floats, fs_hz: float) -> Floats:
    """Return what neurokit2's defaults find."""
    clean = nk.ecg_clean(ecg, sampling_rate=fs_hz)
    return np.asarray(nk.ecg_peaks(clean, sampling_rate=fs_hz)[1]["ECG_R_Peaks"]) / fs_hz


def modified_pan_tompkins(ecg: Floats, fs_hz: float) -> Floats:
    """Return what sleepecg finds."""
    return np.asarray(sleepecg.detect_heartbeats(ecg, fs_hz)) / fs_hz


def xqrs(ecg: Floats, fs_hz: float) -> Floats:
    """Return what wfdb's XQRS finds, in mV as it expects them."""
    detector = XQRS(sig=ecg / 1e3, fs=fs_hz)
    detector.detect(verbose=False)
    return np.asarray(detector.qrs_inds, float) / fs_hz


PEERS: dict[str, Callable[[Floats, float], Floats]] = {
    "neurokit2": neurokit,
    "sleepecg": modified_pan_tompkins,
    "xqrs": xqrs,
}
