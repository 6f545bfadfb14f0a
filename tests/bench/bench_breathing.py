"""Breathing from an ECG beside NeuroKit2's ecg_rsp, against the belt of the same recording; its cost.

    .venv/bin/python tests/bench/run.py breathing

Windows of a minute, one each second, and among them the minutes of the recording one after the other; right is a rate
within 1 /min of the belt's breaths in the same minute (by NeuroKit2's khodadad2018). The recordings are those of
../shared/data; without them only the cost is measured.
"""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import wfdb
from interpreter_respiration.config import Config
from interpreter_respiration.heart import HeartStream
from interpreter_respiration.stream import RespirationStream
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from breathing_signals import chest, ecg
from costs import cost_percent
from slow_signals import T0_NS, play

Floats = NDArray[np.float64]
Row = dict[str, Any]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "multimodal"
METHODS = ("vangent2019", "soni2019", "charlton2016", "sarkar2015")
WINDOW_S = 60


def recordings() -> list[tuple[str, Floats, float, Floats, float]]:
    """(name, ECG, its rate in Hz, belt, its rate in Hz) of what is there."""
    found = []
    for name in ("bio_resting_5min", "bio_eventrelated"):
        columns = np.genfromtxt(DATA / "neurokit" / f"{name}_100hz.csv", delimiter=",", names=True)
        found.append((name, columns["ECG"], 100.0, columns["RSP"], 100.0))
    record = wfdb.rdrecord(str(DATA / "mimicdb" / "03700181"), smooth_frames=False)
    signals = dict(zip(record.sig_name, record.e_p_signal, strict=True))
    rates_hz = {n: record.fs * k for n, k in zip(record.sig_name, record.samps_per_frame, strict=True)}
    heart, belt = np.nan_to_num(signals["MCL1"]), np.nan_to_num(signals["RESP"])
    return [*found, ("MIMIC 03700181", heart, rates_hz["MCL1"], belt, rates_hz["RESP"])]


def heart(samples: Floats, fs_hz: float) -> list[Any]:
    """Updates from an ECG."""
    return play(lambda info: HeartStream(Config(), info), samples, fs_hz, "ecg", "uV")


def breaths_s(neurokit2: Any, samples: Floats, fs_hz: float) -> Floats:
    """Ends of inspiration as NeuroKit2 finds them."""
    cleaned = neurokit2.rsp_clean(samples, sampling_rate=round(fs_hz))
    return np.asarray(neurokit2.rsp_peaks(cleaned, sampling_rate=round(fs_hz))[1]["RSP_Peaks"]) / fs_hz


def per_min(times_s: Floats, end_s: float) -> float:
    """Rate of the breaths in the minute before a time; NaN with fewer than three."""
    inside = times_s[(times_s > end_s - WINDOW_S) & (times_s <= end_s)]
    return 60 / float(np.diff(inside).mean()) if len(inside) > 2 else np.nan


def accuracy(neurokit2: Any) -> list[Row]:
    """How many windows have a rate, and how many of these are right."""
    rows: list[Row] = []
    for name, samples, fs_hz, belt, belt_hz in recordings():
        truth_s = breaths_s(neurokit2, belt, belt_hz)
        updates = [each for each in heart(samples, fs_hz) if each.window_s >= WINDOW_S - 0.1]
        ends_s = [(each.device_ns - T0_NS) / 1e9 for each in updates]
        ours = np.array([each.breaths_per_min for each in updates])
        truth = np.array([per_min(truth_s, end_s) for end_s in ends_s])
        rows.append(_row(f"{name}, rate from ECG", "right: >= 90 % of windows", ours, truth))
        of_minutes = slice(0, None, WINDOW_S)
        minutes = ours[of_minutes], truth[of_minutes]
        rows.append(_row(f"{name}, the same, minute after minute", "right: >= 90 % of minutes", *minutes))
        beats = neurokit2.ecg_peaks(neurokit2.ecg_clean(samples, round(fs_hz)), round(fs_hz))[1]["ECG_R_Peaks"]
        rate = neurokit2.ecg_rate(beats, sampling_rate=round(fs_hz), desired_length=len(samples))
        for method in METHODS:
            wave = neurokit2.ecg_rsp(rate, sampling_rate=round(fs_hz), method=method)
            theirs_s = breaths_s(neurokit2, wave, fs_hz)
            theirs = np.array([per_min(theirs_s, end_s) for end_s in ends_s])
            rows.append(_row(f"{name}, by NeuroKit2's ecg_rsp {method}", "", theirs, truth))
    return rows


def _row(what: str, target: str, rates: Floats, truth: Floats) -> Row:
    told = np.isfinite(rates)
    right = int((np.abs(rates - truth)[told] <= 1).sum())
    share = f" ({100 * right / told.sum():.0f} %)" if told.any() else ""
    measured = f"a rate in {told.sum()} of {len(rates)}, right {right}{share}"
    return {"what": what, "target": target, "measured": measured, "ok": right >= 0.9 * len(rates) if target else None}


def accelerometer(samples: Floats, fs_hz: float) -> list[Any]:
    """Updates from acceleration in m/s^2."""
    names = ("x", "y", "z")
    return play(lambda info: RespirationStream(Config(), info), samples, fs_hz, "accelerometer", "m/s^2", names=names)


def costs() -> list[Row]:
    """CPU of a stream from an ECG and from an accelerometer."""
    rows: list[Row] = []
    for what, run, samples, fs_hz in (
        ("an ECG at 130 Hz", heart, ecg(180, 130.0), 130.0),
        ("an accelerometer at 50 Hz", accelerometer, chest(180, 50.0), 50.0),
    ):
        percent = cost_percent(lambda run=run, samples=samples, fs_hz=fs_hz: run(samples, fs_hz), 180)
        what = f"CPU of a stream of respiration from {what}"
        rows.append({"what": what, "target": "<= 1 % of a core", "measured": f"{percent:.2f} %", "ok": percent <= 1})
    return rows


def rows() -> list[Row]:
    """Accuracy where the recordings are there, and costs."""
    if not DATA.is_dir():
        return costs()
    import neurokit2

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [*accuracy(neurokit2), *costs()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
