"""Skin conductance and respiration: what is found in real recordings beside NeuroKit2 in the same run, and its cost.

    .venv/bin/python tests/bench/bench_modalities.py

Recordings are those of ../shared/data; rows of absent ones are left out. BioSPPy's own counts are those of its
REFERENCE.md; its method for breathing is NeuroKit2's `biosppy`.
"""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_eda.config import Config as EdaConfig
from interpreter_eda.stream import EdaStream
from interpreter_respiration.config import Config as RespirationConfig
from interpreter_respiration.stream import RespirationStream
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from costs import cost_percent, memory_mib
from slow_signals import PHYSIOKIT_HZ, event_times_s, falling_noise, play, skin

Floats = NDArray[np.float64]
Row = dict[str, Any]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
HOUR_S = 3600.0
SURE = 0.7  # a signal quality that users take for good
P11_HZ = PHYSIOKIT_HZ["P11_baseline_1675943915_070305"]


def eda(samples: Floats, fs_hz: float, unit: str) -> list[Any]:
    """Updates of interpreter-eda."""
    return play(lambda info: EdaStream(EdaConfig(), info), samples, fs_hz, "eda", unit)


def respiration(samples: Floats, fs_hz: float) -> list[Any]:
    """Updates of interpreter-respiration."""
    return play(lambda info: RespirationStream(RespirationConfig(), info), samples, fs_hz, "respiration", "a.u.")


def column(path: str, name: str) -> Floats:
    """One column of a CSV file."""
    return np.asarray(np.genfromtxt(DATA / path, delimiter=",", names=True)[name])


def neurokit(kind: str, samples: Floats, fs_hz: float, method: str = "") -> int:
    """How many responses, or breaths, NeuroKit2 counts with its defaults."""
    import neurokit2

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if kind == "eda":
            return len(neurokit2.eda_process(samples, sampling_rate=round(fs_hz))[1]["SCR_Peaks"])
        cleaned = neurokit2.rsp_clean(samples, sampling_rate=round(fs_hz), method=method)
        _, found = neurokit2.rsp_peaks(cleaned, sampling_rate=round(fs_hz), method=method)
        return int(np.isfinite(found["RSP_Peaks"]).sum())


def responses() -> list[Row]:
    """Skin conductance responses beside those of the tools."""
    biosppy = np.loadtxt(DATA / "eda/biosppy/eda.txt")
    pictures = column("multimodal/neurokit/bio_eventrelated_100hz.csv", "EDA")
    floor = np.loadtxt(DATA / "e4/flirt/EDA.csv")[2:]
    rows = []
    for name, samples, fs_hz, unit, also in (
        ("eda/biosppy", biosppy, 1000.0, "counts", "; BioSPPy 6"),
        ("neurokit/bio_eventrelated", pictures, 100.0, "uS", ""),
    ):
        ours = len(event_times_s(eda(samples, fs_hz, unit), "scr_peak_timestamps"))
        theirs = neurokit("eda", samples, fs_hz)
        measured = f"{ours}; NeuroKit2 {theirs}{also}"
        rows.append({"what": f"SCRs in {name}", "target": "+-2", "measured": measured, "ok": abs(ours - theirs) <= 2})
    false = len(event_times_s(eda(floor, 4.0, "uS"), "scr_peak_timestamps"))
    measured = f"{false}; NeuroKit2 {neurokit('eda', floor, 4.0)}"
    return [
        *rows,
        {"what": "SCRs in the noise floor of e4/flirt", "target": "0", "measured": measured, "ok": false == 0},
    ]


def breaths() -> list[Row]:
    """Breaths beside those of the tools."""
    rows = []
    for name, samples, fs_hz, most in (
        ("bio_resting_5min", column("multimodal/neurokit/bio_resting_5min_100hz.csv", "RSP"), 100.0, 1),
        ("bio_eventrelated", column("multimodal/neurokit/bio_eventrelated_100hz.csv", "RSP"), 100.0, 2),
        ("PhysioKit P11", column("multimodal/physiokit/P11_baseline_1675943915_070305.csv", "Resp"), P11_HZ, 3),
    ):
        ours = len(event_times_s(respiration(samples, fs_hz), "breath_timestamps"))
        khodadad, biosppy = (neurokit("respiration", samples, fs_hz, method) for method in ("khodadad2018", "biosppy"))
        measured = f"{ours}; NeuroKit2 {khodadad}, its biosppy method {biosppy}"
        ok = abs(ours - khodadad) <= most
        rows.append({"what": f"breaths in {name}", "target": f"+-{most}", "measured": measured, "ok": ok})
    return rows


def breathing_noise() -> list[Row]:
    """How often noise that falls with the frequency breathes for sure: 20 times 4 minutes each."""
    rows = []
    for exponent in (1.0, 1.5, 2.0, 2.5, 3.0):
        updates = [each for seed in range(20) for each in respiration(falling_noise(exponent, 6000, seed), 25.0)]
        sure = sum(each.signal_quality >= SURE and bool(np.isfinite(each.breaths_per_min)) for each in updates)
        what = f"breathing rates at quality >= {SURE:g} in noise that falls with f^{exponent:g}, 20 x 4 min"
        measured = f"{sure} of {len(updates)} updates"
        rows.append({"what": what, "target": "0", "measured": measured, "ok": sure == 0})
    return rows


def costs() -> list[Row]:
    """CPU per stream, beside a batch call on a minute every second; memory over an hour of signal."""
    import neurokit2

    skin_us = skin(300, 100.0, np.arange(10, 290, 10.0), np.full(28, 0.4))
    belt = 1 - np.cos(2 * np.pi * np.arange(30_000) / 100.0 / 4)
    rows = []
    for name, run, batch in (
        ("interpreter-eda", lambda: eda(skin_us, 100.0, "uS"), neurokit2.eda_process),
        ("interpreter-respiration", lambda: respiration(belt, 100.0), neurokit2.rsp_process),
    ):
        ours = cost_percent(run, 300.0)
        window = (skin_us if name.endswith("eda") else belt)[:6000]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            batch(window, sampling_rate=100)
            theirs = cost_percent(lambda batch=batch, window=window: [batch(window, sampling_rate=100)], 1.0)
        measured = f"{ours:.2f} %; NeuroKit2 on a minute every second {theirs:.1f} %"
        what = f"CPU of {name}'s step per stream at 100 Hz"
        rows.append({"what": what, "target": "<= 1 % of a core", "measured": measured, "ok": ours <= 1.0})
    hour = skin(HOUR_S, 4.0, np.arange(10, HOUR_S - 20, 12.0), np.full(298, 0.3), drift_us_per_min=0.0)[
        : round(4 * HOUR_S)
    ]
    before_mib = memory_mib()
    kept = eda(hour, 4.0, "uS")
    grown_mib = memory_mib() - before_mib
    measured = f"{grown_mib:+.1f} MiB, the {len(kept)} updates that the bench keeps among them"
    what = "memory over an hour of EDA, fast-forwarded"
    return [*rows, {"what": what, "target": "<= 20 MiB", "measured": measured, "ok": grown_mib <= 20}]


def rows() -> list[Row]:
    """Accuracy on what is there, and costs."""
    return [*(responses() + breaths() if DATA.is_dir() else []), *breathing_noise(), *costs()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
