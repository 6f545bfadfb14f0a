"""Belts, ECGs and accelerations of somebody who breathes at a known rate."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def belt(times_s: Floats, per_min: float = 15.0, inhale: float = 0.4) -> Floats:
    """A belt that rises for a share `inhale` of each breath, by 2 units, and falls for the rest."""
    phase = times_s * per_min / 60 % 1
    return np.where(phase < inhale, -np.cos(np.pi * phase / inhale), np.cos(np.pi * (phase - inhale) / (1 - inhale)))


def ecg(
    seconds: float,
    fs_hz: float,
    per_min: float = 15.0,
    arrhythmia_s: float = 0.04,
    amplitude: float = 0.1,
    jitter: float = 0.01,
    noise_uv: float = 10.0,
    pause: float = 0.0,
) -> Floats:
    """ECG in uV at about 75 beats per min; lungs are full at (k + 1/4) breaths, or before that where there is a pause.

    pause: share of each breath that the lungs stay empty.

    Full lungs shorten the interval by arrhythmia_s and lower the QRS complex of 1 mV by the share amplitude; jitter:
    standard deviation of both that is no breathing.
    """
    dice = np.random.default_rng(3)
    times_s, at_s, out = (
        np.arange(round(seconds * fs_hz)) / fs_hz,
        0.5,
        dice.normal(0, noise_uv, round(seconds * fs_hz)),
    )
    while at_s < seconds:
        full = -np.cos(2 * np.pi * min((per_min / 60 * at_s + 0.25) % 1 / (1 - pause), 1.0))
        height = 1000 * (1 - amplitude * full + dice.normal(0, jitter))
        near = slice(max(0, round((at_s - 0.4) * fs_hz)), round((at_s + 0.5) * fs_hz))
        t = times_s[near] - at_s
        qrs = np.exp(-((t / 0.012) ** 2)) - 0.15 * np.exp(-(((t + 0.03) / 0.01) ** 2))
        out[near] += height * (
            qrs - 0.2 * np.exp(-(((t - 0.03) / 0.01) ** 2)) + 0.2 * np.exp(-(((t - 0.25) / 0.05) ** 2))
        )
        at_s += 0.8 - arrhythmia_s * full + dice.normal(0, jitter)
    return out


def chest(seconds: float, fs_hz: float, per_min: float = 15.0, tilt_deg: float = 1.0, noise: float = 0.02) -> Floats:
    """Acceleration in m/s^2, shape (n, 3), of a chest that gravity tilts with every breath, in a slanting position."""
    times_s = np.arange(round(seconds * fs_hz)) / fs_hz
    angle = np.radians(30 + tilt_deg * np.sin(2 * np.pi * per_min / 60 * times_s))
    out = 9.81 * np.column_stack([np.sin(angle) * 0.6, np.sin(angle) * 0.8, np.cos(angle)])
    return np.asarray(out + np.random.default_rng(4).normal(0, noise, out.shape))
