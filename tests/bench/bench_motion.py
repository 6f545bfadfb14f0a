"""Motion: steps of simulated walks, false ones of noise, gestures and resting wrists, and what it costs.

    .venv/bin/python tests/bench/bench_motion.py

NeuroKit2 and BioSPPy count no steps; beside it stands what everybody begins with, scipy's `find_peaks` on the magnitude
(1 m/s^2 above gravity, 0.3 s apart). The rows of recordings are left out where ../shared/data is absent.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_motion.config import Config
from interpreter_motion.stream import MotionStream
from numpy.typing import NDArray
from scipy.signal import find_peaks
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from costs import cost_percent, memory_mib
from slow_signals import play
from walking import GRAVITY, acceleration

Floats = NDArray[np.float64]
Row = dict[str, Any]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
FS_HZ, XYZ, MINUTES, DAY_S = 50.0, ("x", "y", "z"), 10, 86_400
PACES = (80, 95, 110, 125, 140, 170)


def ours(samples: Floats, fs_hz: float = FS_HZ) -> int:
    """Steps that interpreter-motion counts."""
    updates = play(lambda info: MotionStream(Config(), info), samples, fs_hz, "accelerometer", "m/s^2", XYZ)
    return int(updates[-1].extra[0].values[0])


def peaks(samples: Floats, fs_hz: float = FS_HZ) -> int:
    """Steps by peaks of the magnitude alone."""
    return len(find_peaks(np.linalg.norm(samples, axis=1), height=GRAVITY + 1, distance=int(0.3 * fs_hz))[0])


def walks() -> list[Row]:
    """A minute at each pace, strong and weak, clean and noisy."""
    rows = []
    for strength, noise in ((2.5, 0.05), (1.2, 0.3), (2.5, 1.0)):
        mine, theirs = [], []
        for per_min in PACES:
            samples = acceleration(70, FS_HZ, [(4, 64, per_min)], noise=noise, strength=strength)
            mine.append(100 * abs(ours(samples) / per_min - 1))
            theirs.append(100 * abs(peaks(samples) / per_min - 1))
        measured = f"{max(mine):.1f} % at worst; find_peaks {max(theirs):.0f} %"
        what = f"steps of a minute at {PACES[0]} to {PACES[-1]} per min, {strength:g} m/s^2 in {noise:g} m/s^2 of noise"
        rows.append({"what": what, "target": "3 %", "measured": measured, "ok": max(mine) <= 3})
    return rows


def nobody_walks() -> list[Row]:
    """False steps per minute."""
    rng = np.random.default_rng(7)
    n = round(MINUTES * 60 * FS_HZ)
    white = rng.normal(0, 3, (n, 3))
    spectrum = np.fft.rfft(rng.normal(0, 1, (n, 3)), axis=0)
    at_hz = np.fft.rfftfreq(n, 1 / FS_HZ)
    spectrum[(at_hz < 0.5) | (at_hz > 4)] = 0
    shaking = np.fft.irfft(spectrum, n, axis=0)
    signals = {"white noise of 3 m/s^2": white, "shaking of 2 m/s^2 without rhythm": 2 * shaking / shaking.std()}
    found = {name: (samples + np.array([0, 0, GRAVITY]), FS_HZ) for name, samples in signals.items()}
    if DATA.is_dir():
        verity = DATA / "polar" / "verity_sense" / "Polar_Sense_ACC.txt"
        resting = np.loadtxt(verity, delimiter=";", skiprows=1, usecols=(2, 3, 4)) * GRAVITY / 1000
        wrist = np.loadtxt(DATA / "e4" / "flirt" / "ACC.csv", delimiter=",", skiprows=2) * GRAVITY / 64
        found |= {"a Verity Sense at rest": (resting, 52.0), "an E4 at work": (wrist, 32.0)}
    rows = []
    for name, (samples, fs_hz) in found.items():
        minutes = len(samples) / fs_hz / 60
        mine, theirs = ours(samples, fs_hz) / minutes, peaks(samples, fs_hz) / minutes
        measured = f"{mine:.1f}; find_peaks {theirs:.0f}"
        rows.append({"what": f"false steps per min in {name}", "target": "<= 1", "measured": measured, "ok": mine <= 1})
    return rows


def costs() -> list[Row]:
    """CPU of a stream, beside find_peaks on the last minute every second."""
    samples = acceleration(300, FS_HZ, [(10, 290, 110)])
    mine = cost_percent(lambda: ours(samples), 300)
    theirs = cost_percent(lambda: [peaks(samples[:3000]) for _ in range(100)], 100)
    measured = f"{mine:.2f} %; find_peaks on a minute every second {theirs:.2f} %"
    what = "CPU of interpreter-motion's step per stream at 50 Hz"
    return [{"what": what, "target": "<= 1 % of a core", "measured": measured, "ok": mine <= 1}]


def memory() -> list[Row]:
    """Growth after the first hour of a day, fast-forwarded with an update every 10 s."""
    minute = acceleration(60, 25.0, [(5, 40, 110)])
    info = StreamInfo(StreamName("p1", "accelerometer", "s1"), 25.0, "m/s^2", XYZ)
    step, clock, begun_mib = MotionStream(Config(update_interval_s=10.0), info), SampleClock(25.0), 0.0
    for i in range(DAY_S // 60):
        stamp_ns = 10**18 + round((60 * (i + 1) - 1 / 25.0) * 1e9)
        step.push(clock.place(Chunk(XYZ, minute, stamp_ns, stamp_ns)))
        begun_mib = memory_mib() if i == 60 else begun_mib
    grown_mib = memory_mib() - begun_mib
    what = "memory over 24 h of acceleration, fast-forwarded, after its first hour"
    return [{"what": what, "target": "<= 2 MiB", "measured": f"{grown_mib:+.1f} MiB", "ok": grown_mib <= 2}]


def rows() -> list[Row]:
    """Accuracy on what is there, and costs."""
    return [*memory(), *walks(), *nobody_walks(), *costs()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
