"""EOG: blinks in a real recording against a list made by eye, beside NeuroKit2's and MNE's methods; saccades; cost.

    .venv/bin/python tests/bench/run.py eog

The recording is that of ../shared/data; its rows are left out where it is absent.
"""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_eog.config import Config
from interpreter_eog.stream import EogStream
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from costs import cost_percent, memory_mib
from eog_signals import eyes
from slow_signals import event_times_s, play

ROOT = Path(__file__).resolve().parents[2]
Floats = NDArray[np.float64]
Row = dict[str, Any]

RECORDING = ROOT.parent / "shared" / "data" / "eog" / "neurokit" / "eog_100hz.csv"
HAND = ROOT / "tests" / "unit" / "interpreter-eog" / "blinks_by_hand.csv"
FS_HZ, NEAR_S = 100.0, 0.15
METHODS = ("neurokit", "mne", "brainstorm", "blinker")


def ours(samples: Floats, names: tuple[str, ...] = ("veog",)) -> list[Any]:
    """Updates of interpreter-eog."""
    return play(lambda info: EogStream(Config(), info), samples, FS_HZ, "eog", "uV", names=names)


def score(found_s: Floats) -> tuple[int, int, int, int]:
    """(clear blinks found, of, false ones, doubtful ones found)."""
    hand = np.genfromtxt(HAND, delimiter=",", names=True)
    clear, doubtful = (hand["time_s"][hand["clear"] == kind] for kind in (1, 0))
    right, open_ = ((np.abs(found_s[:, None] - times_s) < NEAR_S) for times_s in (clear, doubtful))
    false = len(found_s) - int(right.any(axis=1).sum()) - int(open_.any(axis=1).sum())
    return int(right.any(axis=0).sum()), len(clear), false, int(open_.any(axis=0).sum())


def told(found_s: Floats) -> str:
    """The score as text; precision without and with the doubtful ones as false."""
    right, of, false, doubtful = score(found_s)
    strictly = 100 * right / max(1, right + false + doubtful)
    return (
        f"{right} of {of}, precision {100 * right / max(1, right + false):.0f} % ({strictly:.0f} % with doubtful ones)"
    )


def blinks() -> list[Row]:
    """Blinks of the recording."""
    import neurokit2

    veog_uv = 1e6 * np.genfromtxt(RECORDING, skip_header=1)
    cleaned = neurokit2.eog_clean(veog_uv, sampling_rate=FS_HZ)
    theirs = {name: _peaks(neurokit2, cleaned, name) / FS_HZ for name in METHODS}
    found_s = event_times_s(ours(veog_uv), "blink_timestamps")
    right, of, false, _ = score(found_s)
    ok = right >= 0.9 * of and right >= 0.9 * (right + false)
    target = ">= 90 % found, >= 90 % right"
    rows: list[Row] = [{"what": "blinks, neurokit/eog_100hz", "target": target, "measured": told(found_s), "ok": ok}]
    swapped = event_times_s(ours(-veog_uv), "blink_timestamps")
    rows.append({"what": "the same, electrodes swapped", "target": target, "measured": told(swapped), "ok": ok})
    for name, found in theirs.items():
        what = f"the same by NeuroKit2's method {name}"
        rows.append({"what": what, "target": "", "measured": told(np.unique(found)), "ok": None})
    return rows


def _peaks(neurokit2: Any, cleaned: Floats, method: str) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(neurokit2.eog_findpeaks(cleaned, sampling_rate=FS_HZ, method=method), float)


def saccades() -> list[Row]:
    """Simulated saccades of 40 to 300 uV, at random, with noise and blinks between them."""
    dice = np.random.default_rng(7)
    onsets_s = np.arange(3.0, 297.0, 2.0) + dice.uniform(-0.3, 0.3, 147)
    sizes_uv = dice.uniform(40, 300, 147) * (-1.0) ** np.arange(147)
    rows: list[Row] = []
    for noise_uv in (2.0, 5.0, 10.0):
        truth = list(zip(onsets_s.tolist(), sizes_uv.tolist(), strict=True))
        samples = eyes(300, FS_HZ, onsets_s[::3] + 1.0, truth, noise_uv=noise_uv)
        updates = ours(samples, ("heog", "veog"))
        found_s = event_times_s(updates, "saccade_timestamps")
        found_uv = np.array([value for update in updates for value in update.saccade_amplitudes_uv])
        off_s = np.abs(found_s[:, None] - onsets_s)
        right, nearest = off_s.min(axis=0) < 0.05, off_s.argmin(axis=0)
        off_percent = 100 * np.abs(found_uv[nearest] / sizes_uv - 1)[right]
        f1 = 2 * right.sum() / (len(found_s) + len(onsets_s))
        measured = (
            f"F1 {f1:.3f}, onset {1e3 * np.median(off_s.min(axis=0)[right]):.0f} ms, "
            f"amplitude {np.median(off_percent):.1f} % (medians)"
        )
        rows.append(
            {
                "what": f"simulated saccades, noise {noise_uv:g} uV",
                "target": "F1 >= 0.9",
                "measured": measured,
                "ok": bool(f1 >= 0.9),
            }
        )
    return rows


def costs() -> list[Row]:
    """CPU of two channels beside a batch call on a minute every second; memory from 10 min to an hour of signal."""
    import neurokit2

    samples = eyes(300, FS_HZ, np.arange(4.0, 298.0, 4.0), [(at_s, 100.0) for at_s in np.arange(2.0, 298.0, 8.0)])
    step_percent = cost_percent(lambda: ours(samples, ("heog", "veog")), 300)
    minute = samples[:6000, 1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        neurokit2.eog_process(minute, sampling_rate=FS_HZ)
        batch_percent = cost_percent(lambda: neurokit2.eog_process(minute, sampling_rate=FS_HZ), 1)
    measured = f"{step_percent:.2f} %; NeuroKit2's eog_process of veog's last minute every second {batch_percent:.1f} %"
    what = "CPU of interpreter-eog's step per stream, 2 channels at 100 Hz"
    rows: list[Row] = [{"what": what, "target": "<= 1 % of a core", "measured": measured, "ok": step_percent <= 1}]
    grown_mib = _grown_mib(samples)
    what = "memory of the step from 10 min to an hour of signal"
    return [*rows, {"what": what, "target": "<= 2 MiB", "measured": f"{grown_mib:+.1f} MiB", "ok": grown_mib <= 2}]


def _grown_mib(samples: Floats) -> float:
    """Five minutes played twelve times without a hole; nothing is kept."""
    from sense4hri.chunk import Chunk
    from sense4hri.names import StreamName
    from sense4hri.sample_clock import SampleClock
    from sense4hri.stream_info import StreamInfo

    names = ("heog", "veog")
    step = EogStream(Config(), StreamInfo(StreamName("p1", "eog", "s1"), FS_HZ, "uV", names))
    clock, sent, at_mib = SampleClock(FS_HZ), 0, []
    for _ in range(12):
        for part in np.split(samples, 600):
            sent += len(part)
            stamp_ns = 10**18 + round((sent - 1) / FS_HZ * 1e9)
            step.push(clock.place(Chunk(names, part, stamp_ns, stamp_ns)))
        at_mib.append(memory_mib())
    return at_mib[-1] - at_mib[1]


def rows() -> list[Row]:
    """Blinks where the recording is there, saccades, costs."""
    return [*(blinks() if RECORDING.exists() else []), *saccades(), *costs()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
