"""interpreter-ecg: no confident number that is wrong, under holes, ectopy, hum and noise (bench: bench_ecg_truth)."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))
import bench_ecg
import ecg_trials as trials

FS_HZ = 130.0
CONFIDENT = 0.7


def play(ecg, fs_hz=FS_HZ):
    """Every update of a recording."""
    return bench_ecg.play(ecg, fs_hz)


def confident_rates(updates):
    """Rates that are published at a quality of 0.7 or more."""
    rates = np.array([u.heart_rate_bpm for u in updates if u.signal_quality >= CONFIDENT])
    return rates[np.isfinite(rates)]


# -- holes


@pytest.mark.parametrize("value", [np.nan, 250.0, 8000.0])
def test_hole_without_signal_is_a_gap(value: float) -> None:
    """Three seconds of NaN, of one value, of a rail: no interval across, no beat invented, the rate stays right."""
    rhythm = trials.resting(60, rr_s=60 / 70)
    ecg = trials.ecg_of(rhythm, FS_HZ, 60)
    ecg[30 * 130 : 33 * 130] = value
    updates = play(ecg)
    rr_ms = np.array([rr for u in updates for rr in u.rr_intervals_ms])
    assert np.isnan(rr_ms).sum() == 2
    assert np.nanmax(rr_ms) < 1000
    assert np.abs(confident_rates(updates) - 70).max() < 7
    assert abs(updates[-1].hrv.rmssd_ms - np.sqrt(np.nanmean(np.diff(np.diff(rhythm.beats_s[:-3]) * 1e3) ** 2))) < 3


def test_hole_is_told_at_once() -> None:
    """While there is no signal the quality is 0, no rate is given, and the reason says since when."""
    ecg = trials.ecg_of(trials.resting(30), FS_HZ, 30)
    ecg[20 * 130 :] = ecg[20 * 130]
    last = play(ecg)[22]
    assert last.signal_quality == 0
    assert np.isnan([last.heart_rate_bpm, last.rr_interval_ms]).all()
    assert any(reason.startswith("no signal: the value has not changed for") for reason in last.reasons)


def test_electrodes_off_for_long() -> None:
    """After 20 s at a rail everything begins anew, and no rate is wrong."""
    ecg = trials.ecg_of(trials.resting(80, rr_s=60 / 70), FS_HZ, 80)
    ecg[30 * 130 : 50 * 130] = -9000
    updates = play(ecg)
    assert np.abs(confident_rates(updates) - 70).max() < 7
    assert updates[-1].hrv.window_s < 31
    assert updates[-1].signal_quality > 0.9


# -- what is no heart


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_number_from_noise(seed: int) -> None:
    """White noise has no heart rate, nor an interval."""
    updates = play(np.random.default_rng(seed).normal(0, 100, 130 * 60))
    assert np.isnan([(u.heart_rate_bpm, u.rr_interval_ms) for u in updates]).all()
    assert any(reason.startswith("heart_rate_bpm, rr_interval_ms withheld") for reason in updates[-1].reasons)
