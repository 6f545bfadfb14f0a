"""Simulated EEG whose rhythms are known, and recordings, played through interpreter-eeg's step without a graph."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_eeg.config import Config
from interpreter_eeg.stream import EegStream, EegUpdate
from numpy.typing import NDArray
from slow_signals import T0_NS
from slow_signals import play as play_signal

Floats = NDArray[np.float64]
CAP = ("Fp1", "Fp2", "F3", "F4", "Fz", "Cz", "P3", "P4", "Pz", "O1", "Oz", "O2")
EEGLAB_HZ, BIOSPPY_HZ, MUSE_HZ, OPENBCI_HZ = 128.0, 125.0, 256.0, 250.0
_EEGLAB = """FPz EOG1 F3 Fz F4 EOG2 FC5 FC1 FC2 FC6 T7 C3 C4 Cz T8 CP5 CP1 CP2 CP6 P7 P3 Pz P4 P8 PO7 PO3 POz PO4
    PO8 O1 Oz O2"""
EEGLAB = tuple(_EEGLAB.split())
OPENBCI = tuple(f"ch{k}" for k in range(1, 9))
MUSE = ("TP9", "AF7", "AF8", "TP10", "Right AUX")


def brain(seconds: float, fs_hz: float, channels: int = 1, alpha_uv: float = 8.0, seed: int = 0) -> Floats:
    """EEG in uV, shape (n, channels): a background that falls with frequency, 8 uV rms, and waxing alpha at 10 Hz."""
    count = round(seconds * fs_hz)
    rng = np.random.default_rng(seed)
    hz = np.fft.rfftfreq(count, 1 / fs_hz)
    shape = np.where(hz > 0, 1 / np.maximum(hz, 0.5) ** 0.8, 0.0)[:, None]
    noise = np.fft.irfft(shape * np.fft.rfft(rng.normal(size=(count, channels)), axis=0), count, axis=0)
    noise *= 8.0 / noise.std(axis=0)
    times_s = np.arange(count)[:, None] / fs_hz
    waxing = 1 + 0.5 * np.sin(2 * np.pi * (0.2 * times_s + rng.uniform(size=channels)))
    return noise + alpha_uv * waxing * np.sin(2 * np.pi * (10 * times_s + rng.uniform(size=channels)))


def blink(times_s: Floats, at_s: Sequence[float], height_uv: float) -> Floats:
    """Blinks, shape (n,): bumps 0.2 s wide at half height."""
    return height_uv * sum(np.exp(-0.5 * ((times_s - at) / 0.085) ** 2) for at in at_s)


def play(
    samples: Floats, fs_hz: float, names: Sequence[str], unit: str = "uV", config: Config | None = None, **options: Any
) -> list[EegUpdate]:
    """Updates of samples, shape (n, channels)."""
    chosen = config or Config()
    return play_signal(lambda info: EegStream(chosen, info), samples, fs_hz, "eeg", unit, names=tuple(names), **options)


def extra(update: EegUpdate, name: str) -> Floats:
    """The values of one feature of an update's `extra`, empty where it is not there."""
    return np.array(next((feature.values for feature in update.extra if feature.name == name), ()))


def eeglab(shared_data: Path) -> Floats:
    """The EEGLAB tutorial recording in uV, shape (30504, 32)."""
    return np.fromfile(shared_data / "eeg" / "eeglab" / "eeglab_data.fdt", "<f4").reshape(-1, 32).astype(float)


def muse(shared_data: Path) -> Floats:
    """Two minutes of a Muse in uV, shape (30732, 5)."""
    path = next((shared_data / "eeg" / "muse").glob("*.csv"))
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(1, 6))


def openbci(shared_data: Path) -> Floats:
    """14 s of an OpenBCI board, its sample counter first, shape (3471, 9); the line that breaks off is left out."""
    lines = (shared_data / "eeg" / "openbci" / "test_openbci.txt").read_text().splitlines()
    rows = [line.split(",") for line in lines if not line.startswith("%")]
    return np.array([row for row in rows if len(row) == 9], float)


BLINKS_S = (4.1, 24.9, 42.8, 73.2, 92.1, 135.5, 162.5, 165.9, 168.2, 171.2, 179.5, 183.4, 224.0)
"""Blinks that are clear in a picture of FPz, EOG1, F3 and F4 of the EEGLAB recording, by hand."""


def blink_times_s(updates: Sequence[EegUpdate]) -> list[float]:
    """When the updates say that there were blinks, each once, in s since the first sample of a recording."""
    now_s = [(update, ((update.device_ns or 0) - T0_NS) / 1e9) for update in updates]
    return sorted({round(at_s - age_s, 2) for update, at_s in now_s for age_s in extra(update, "blink_age")})
