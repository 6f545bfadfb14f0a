"""Electromyograms: a recording and simulated muscles, beside NeuroKit2 in the same run, and what it costs.

    .venv/bin/python tests/bench/bench_emg.py

The row of the recording of ../shared/data is left out where that is absent. Memory is that of a long run, its updates
thrown away; 3 h of it, because 24 h at 1 kHz take minutes.
"""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_emg.config import Config
from interpreter_emg.stream import EmgStream
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from costs import cost_percent, memory_mib
from emg_signals import density, muscle
from slow_signals import event_times_s, play

Floats = NDArray[np.float64]
Row = dict[str, Any]

FILE = Path(__file__).resolve().parents[3] / "shared" / "data" / "emg" / "biosppy" / "emg.txt"
FS_HZ, NEAR_S = 1000.0, 0.1
METHODS = ("threshold", "mixture", "biosppy")
LONG_H, PIECE_S = 3, 60


def ours(samples: Floats, unit: str = "uV", names: tuple[str, ...] = ("emg",)) -> list[Any]:
    """Updates of interpreter-emg."""
    return play(lambda info: EmgStream(Config(), info), samples, FS_HZ, "emg", unit, names)


def neurokit(samples: Floats, method: str) -> Floats:
    """Onsets in s that NeuroKit2 finds in the whole of it."""
    import neurokit2

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        clean = neurokit2.emg_clean(samples, sampling_rate=round(FS_HZ))
        envelope = neurokit2.emg_amplitude(clean)
        given = {"emg_cleaned": clean} if method == "biosppy" else {"emg_amplitude": envelope}
        _, found = neurokit2.emg_activation(**given, sampling_rate=round(FS_HZ), method=method)
    return np.asarray(found["EMG_Onsets"], float) / FS_HZ


def episodes() -> list[Row]:
    """The recording of BioSPPy, in which one sees two episodes."""
    if not FILE.exists():
        return []
    samples = np.loadtxt(FILE)
    updates = ours(samples, "counts")
    pairs = zip(*(event_times_s(updates, f"{name}_timestamps") for name in ("onset", "offset")), strict=True)
    found = [f"{onset:.1f} to {offset:.1f} s" for onset, offset in pairs]
    theirs = ", ".join(f"{method} {len(neurokit(samples, method))}" for method in METHODS)
    measured = f"{'; '.join(found)}; onsets by NeuroKit2: {theirs}"
    return [
        {"what": "work in emg/biosppy", "target": "35 to 41, 50 to 58 s", "measured": measured, "ok": len(found) == 2}
    ]


def score(truth_s: Floats, found_s: Floats) -> str:
    """Sensitivity and precision of onsets within NEAR_S, and the median error of those."""
    off_s = np.abs(found_s[None] - truth_s[:, None]) if len(found_s) else np.full((len(truth_s), 1), np.inf)
    hit = off_s.min(axis=1) <= NEAR_S
    right = int((off_s.min(axis=0) <= NEAR_S).sum()) if len(found_s) else 0
    error_ms = 1000 * float(np.median(off_s.min(axis=1)[hit])) if hit.any() else np.nan
    return f"{100 * hit.mean():.0f}/{100 * right / max(1, len(found_s)):.0f} %, {error_ms:.0f} ms"


def onsets() -> list[Row]:
    """Bursts of 0.3 to 3 s at falling distance from the noise."""
    rng = np.random.default_rng(0)
    begins_s = 4.0 + np.cumsum(rng.uniform(3.5, 6, 20))
    bursts_s = [
        (begin_s, begin_s + length_s) for begin_s, length_s in zip(begins_s, rng.uniform(0.3, 2.5, 20), strict=True)
    ]
    rows = []
    for rest_uv in (5.0, 20.0, 40.0):
        samples = muscle(begins_s[-1] + 6, FS_HZ, bursts_s, rest_uv=rest_uv, seed=3)
        mine = score(begins_s, event_times_s(ours(samples), "onset_timestamps"))
        theirs = ", ".join(f"{method} {score(begins_s, neurokit(samples, method))}" for method in METHODS)
        sensitivity = int(mine.partition("/")[0])
        what = f"onsets of 20 bursts of 100 uV over {rest_uv:g} uV of noise: found/right, median error"
        rows.append(
            {"what": what, "target": ">= 90 %", "measured": f"{mine}; NeuroKit2 {theirs}", "ok": sensitivity >= 90}
        )
    return rows


def frequencies() -> list[Row]:
    """Mean and median frequency of a muscle whose spectrum is known."""
    updates = ours(muscle(60, FS_HZ, [(4, 60)]))[6:]
    at_hz = np.arange(20.0, 450.0)
    power = density(at_hz)
    truth = {
        "mean": power @ at_hz / power.sum(),
        "median": at_hz[np.searchsorted(np.cumsum(power), power.sum() / 2)],
    }
    rows = []
    for name, hz in truth.items():
        found = float(np.mean([getattr(update, f"{name}_frequency_hz")[0] for update in updates]))
        measured = f"{found:.1f} Hz, is {hz:.1f}"
        what = f"{name} frequency over 54 s of work"
        rows.append({"what": what, "target": "5 %", "measured": measured, "ok": bool(abs(found / hz - 1) <= 0.05)})
    return rows


def costs() -> list[Row]:
    """CPU of a stream of one and of eight channels, beside NeuroKit2 on 10 s of one channel every second."""
    import neurokit2

    names = tuple(f"m{i}" for i in range(8))
    eight = np.array([muscle(60, FS_HZ, [(5, 7), (12, 20), (30, 30.5)], seed=i) for i in range(8)]).T
    window = eight[:10_000, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        neurokit2.emg_process(window, sampling_rate=1000)
        theirs = cost_percent(lambda: neurokit2.emg_process(window, sampling_rate=1000), 1)
    at_s = np.arange(len(eight))[:, None] / FS_HZ
    hum = sum(40 / order * np.sin(2 * np.pi * 50 * order * at_s) for order in (1, 2, 3, 5))
    rows = []
    for count, target, samples, beside in (
        (1, 1.0, eight, ""),
        (8, 2.0, eight, ""),
        (8, 2.0, eight + hum, ", 50 Hz in it"),
    ):
        mine = cost_percent(lambda x=samples[:, :count]: ours(x, names=names[: x.shape[1]]), len(eight) / FS_HZ)
        measured = f"{mine:.2f} %; NeuroKit2 on 10 s of one channel every second {theirs:.1f} %"
        what = f"CPU of interpreter-emg's step per stream of {count} channel{'s' * (count > 1)} at 1 kHz{beside}"
        rows.append({"what": what, "target": f"<= {target:g} % of a core", "measured": measured, "ok": mine <= target})
    return rows


def memory() -> list[Row]:
    """Growth after the first ten minutes of a long run, fast-forwarded."""
    piece = muscle(PIECE_S, FS_HZ, [(5, 7), (12, 20), (30, 30.5)])[:, None]
    step = EmgStream(Config(), StreamInfo(StreamName("p1", "emg", "s1"), FS_HZ, "uV", ("emg",)))
    clock, begun_mib, sent = SampleClock(FS_HZ), 0.0, 0
    for minute in range(LONG_H * 60):
        for part in np.split(piece, PIECE_S):
            sent += len(part)
            stamp_ns = 10**18 + round((sent - 1) / FS_HZ * 1e9)
            step.push(clock.place(Chunk(("emg",), part, stamp_ns, stamp_ns)))
        begun_mib = memory_mib() if minute == 10 else begun_mib
    grown_mib = memory_mib() - begun_mib
    what = f"memory over {LONG_H} h of EMG, fast-forwarded, after its first 10 min"
    return [{"what": what, "target": "<= 2 MiB", "measured": f"{grown_mib:+.1f} MiB", "ok": grown_mib <= 2}]


def rows() -> list[Row]:
    """Memory first: NeuroKit2 brings its own."""
    return [*memory(), *episodes(), *onsets(), *frequencies(), *costs()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
