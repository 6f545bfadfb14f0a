"""Counted accuracy on real recordings: changes should not lead to worse results. The numbers are those of bench_ppg."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

BENCH = Path(__file__).resolve().parents[2] / "bench" / "bench_ppg.py"


@pytest.fixture(scope="module")
def bench(shared_data: Path) -> ModuleType:
    """bench_ppg as a module."""
    spec = importlib.util.spec_from_file_location("bench_ppg", BENCH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_finger_and_ear_agree_to_the_pulse(bench):
    """At the finger and at the ear of PhysioKit P11 the same 366 pulses are found, 10 ms apart at most on average."""
    stamps_ns, samples = bench.physiokit("P11")
    finger, ear = (bench.pulses_s(bench.play(samples[:, [i]], stamps_ns, 250.0), int(stamps_ns[0])) for i in (0, 1))
    hit, lag_s, rest_s = bench.matched(finger, ear)
    assert len(finger) == len(ear) == hit.sum() == 366
    assert abs(lag_s) < 0.06
    assert rest_s.std() < 0.011


def test_pulses_of_a_verity_sense_are_its_own(bench):
    """All 417 valid intervals the sensor reports are found, 9 ms apart; the variability is near the reference."""
    stamps_ns, samples, ppi_ms, valid = bench.verity()
    updates = bench.play(samples, stamps_ns, 55.0, 36, names=("ppg_0", "ppg_1", "ppg_2", "ambient"))
    pulses = bench.pulses_s(updates, int(stamps_ns[0]))
    hit, _, rest_s = bench.matched(np.cumsum(ppi_ms) / 1000, pulses, longest_lag_s=25.0)
    assert hit[valid].sum() == 417
    assert rest_s.std() < 0.009
    assert updates[-1].hrv.rmssd_ms == pytest.approx(102.8, abs=6)
    assert updates[-1].hrv.sdnn_ms == pytest.approx(101.4, abs=6)


def test_a_dropout_is_gated(bench, shared_data):
    """Of a recording that begins with 42 s of handling and a dropout, nothing of that is called a good signal."""
    signal = np.loadtxt(shared_data / "ppg" / "heartpy" / "data2.csv", skiprows=1, delimiter=",")[:, 1]
    updates = bench.play(signal[:, None], bench.evenly(len(signal), 116.988), 116.988)
    assert all(np.isnan(update.heart_rate_bpm) for update in updates[:42])
    assert not any(18.8 < t < 24.8 for t in bench.pulses_s(updates, 1_000_000_000_000))
    rates = np.array([update.heart_rate_bpm for update in updates[60:]])
    assert np.nanmean(rates) == pytest.approx(61.5, abs=1.5)
    assert np.isfinite(rates).mean() > 0.9
