"""Gaze and pupils: what is found in real recordings beside pymovements in the same run, and what it costs.

    .venv/bin/python tests/bench/bench_eye.py

Recordings are those of ../shared/data; without it only the simulated rows are there. pymovements is no dependency of
the project: `.venv/bin/pip install pymovements` beforehand, else its half of a row says that it is absent.
"""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_eye_tracking.config import Config as EyeConfig
from interpreter_eye_tracking.stream import EyeStream
from interpreter_pupillometry.config import Config as PupilConfig
from interpreter_pupillometry.features import valid_sizes
from interpreter_pupillometry.stream import PupilStream
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from costs import cost_percent, memory_mib
from gaze import EYELINK_HZ, EYELINK_PX_PER_DEG, EyeLink, eyelink, looking, matched, pupils
from slow_signals import event_times_s, play

Floats = NDArray[np.float64]
Row = dict[str, Any]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
TOOL = importlib.util.find_spec("pymovements") is not None
ABSENT = "pymovements not installed"
WITHIN_S = 0.02
WINDOW_S = 60.0
HOUR_S = 3600.0


def gaze_updates(gaze: Floats, fs_hz: float, unit: str = "px", px_per_deg: float | None = None) -> list[Any]:
    """Updates of interpreter-eye-tracking."""
    known = {} if px_per_deg is None else {"eye_tracking.px_per_deg": px_per_deg}
    names = ("gaze_x", "gaze_y")
    return play(lambda info: EyeStream(EyeConfig(), info), gaze, fs_hz, "eye_tracking", unit, names, parameters=known)


def pupil_updates(sizes: Floats, fs_hz: float, unit: str = "mm") -> list[Any]:
    """Updates of interpreter-pupillometry."""
    names = ("diameter_left", "diameter_right")
    return play(lambda info: PupilStream(PupilConfig(), info), sizes, fs_hz, "pupillometry", unit, names)


def pymovements_onsets_s(gaze_deg: Floats, fs_hz: float) -> tuple[Floats, Floats]:
    """Onsets of its saccades (Engbert & Kliegl) and fixations (I-VT at 20 deg/s), with its defaults, in s."""
    from pymovements import Experiment
    from pymovements.gaze import from_numpy

    times_ms = np.arange(len(gaze_deg)) * 1000 / fs_hz
    experiment = Experiment(sampling_rate=fs_hz)
    onsets = []
    for kind, name in (("microsaccades", "saccade"), ("ivt", "fixation")):
        known = from_numpy(position=gaze_deg, time=times_ms, experiment=experiment, orient="row", time_unit="ms")
        known.pos2vel("fivepoint")
        known.detect(kind)
        found = known.events.frame
        onsets.append(found["onset"].to_numpy()[found["name"].to_numpy() == name] / 1000)
    return onsets[0], onsets[1]


def eyelink_rows() -> list[Row]:
    """Events of an EyeLink against its own parser, both eyes."""
    rows = []
    for eye in ("L", "R"):
        truth = eyelink(DATA, eye)
        theirs = pymovements_onsets_s(truth.gaze / EYELINK_PX_PER_DEG, EYELINK_HZ) if TOOL else None
        for unit, px_per_deg in (("px", None), ("deg", EYELINK_PX_PER_DEG)):
            updates = gaze_updates(truth.gaze, EYELINK_HZ, "px", px_per_deg)
            rows += _scored(f"EyeLink 002 {eye}, {unit}", truth, updates, theirs)
        told_s = event_times_s(updates, "blink_timestamps")
        f1, _ = matched(truth.blinks[:, 0], told_s, 0.004)
        measured = f"{len(told_s)} of {len(truth.blinks)}, F1 {f1:.3f}"
        rows.append(
            {"what": f"blinks in EyeLink 002 {eye}", "target": "all", "measured": measured, "ok": bool(f1 == 1)}
        )
    return rows


def _scored(name: str, truth: EyeLink, updates: list[Any], theirs: tuple[Floats, Floats] | None) -> list[Row]:
    rows = []
    saccades_s, fixations_s = (event_times_s(updates, f"{kind}_timestamps") for kind in ("saccade", "fixation"))
    for what, true, found_s, their in (
        ("saccades (all of the tracker)", truth.saccades, saccades_s, 0),
        ("saccades (but those of blinks)", truth.saccades[~truth.lid], saccades_s, 0),
        ("fixations", truth.fixations, fixations_s, 1),
    ):
        f1, errors_s = matched(true[:, 0], found_s, WITHIN_S)
        middle_ms = 1000 * float(np.median(errors_s))
        beside = ABSENT if theirs is None else f"pymovements F1 {matched(true[:, 0], theirs[their], WITHIN_S)[0]:.3f}"
        measured = f"F1 {f1:.3f}, onsets off by {middle_ms:.0f} ms in the middle; {beside}"
        ok = f1 >= 0.9 and middle_ms <= 6
        rows.append({"what": f"{what} in {name}", "target": "F1 >= 0.9, <= 6 ms", "measured": measured, "ok": bool(ok)})
    return rows


def toy_row() -> Row:
    """pymovements' toy: no truth, counts beside each other."""
    table = np.genfromtxt(DATA / "eye" / "pymovements" / "trial_0_1.csv", names=True)
    gaze = np.column_stack([table["x"], table["y"]])
    last = gaze_updates(gaze, 1000.0)[-1]
    theirs = ABSENT if not TOOL else f"pymovements {len(pymovements_onsets_s(gaze / 30.0, 1000.0)[0])} saccades"
    measured = f"{last.saccade_count} saccades, {last.fixation_count} fixations; {theirs} (30 px/deg assumed)"
    return {"what": "pymovements toy, 17 s of reading", "target": "-", "measured": measured, "ok": None}


def pupil_rows() -> list[Row]:
    """What of an EyeLink's lost samples gets through, and known dilations."""
    rows = []
    for eye in ("L", "R") if DATA.is_dir() else ():
        pupil = eyelink(DATA, eye).pupil
        valid = valid_sizes(pupil, np.arange(len(pupil)) * 2_000_000, mm=False)
        through, zeros = int(valid[pupil == 0].sum()), int((pupil == 0).sum())
        measured = f"{through} of {zeros}; {100 * (1 - valid.mean()):.1f} % of all samples excluded with their margins"
        rows.append(
            {"what": f"zeros of EyeLink 002 {eye} let through", "target": "0", "measured": measured, "ok": not through}
        )
    for fs_hz in (30.0, 60.0, 500.0):
        errors = []
        for size in (-0.5, 0.1, 0.3, 0.6):
            updates = pupil_updates(pupils(fs_hz, 46, [(40.0, 46.0, size)], (12.0, 30.0, 42.3)), fs_hz)
            errors.append(abs(np.mean([update.change for update in updates[41:44]]) / size - 1))
        measured = ", ".join(f"{100 * error:.1f} %" for error in errors)
        what = f"dilations of -0.5, 0.1, 0.3, 0.6 mm at {fs_hz:g} Hz, noise and a blink in it: error"
        rows.append({"what": what, "target": "<= 3 %", "measured": measured, "ok": bool(max(errors) <= 0.03)})
    return rows


def cost_rows() -> list[Row]:
    """CPU per stream, beside a batch call on a minute every second."""
    rows, places = [], np.random.default_rng(1).uniform([-15, -10], [15, 10], (180, 2))
    for fs_hz in (60.0, 500.0, 1000.0):
        gaze, _ = looking(fs_hz, places, noise=0.03)
        gaze = gaze[: round(WINDOW_S * fs_hz)]
        ours = cost_percent(lambda gaze=gaze, fs_hz=fs_hz: gaze_updates(gaze, fs_hz, "deg"), len(gaze) / fs_hz)
        theirs = ABSENT
        if TOOL:
            pymovements_onsets_s(gaze, fs_hz)
            percent = cost_percent(lambda gaze=gaze, fs_hz=fs_hz: pymovements_onsets_s(gaze, fs_hz), 1.0)
            theirs = f"pymovements on a minute every second {percent:.1f} %"
        what = f"CPU of interpreter-eye-tracking's step per stream at {fs_hz:g} Hz"
        rows.append(
            {"what": what, "target": "<= 1 % of a core", "measured": f"{ours:.2f} %; {theirs}", "ok": bool(ours <= 1)}
        )
        sizes = pupils(fs_hz, WINDOW_S, [(20.0, 25.0, 0.3)], np.arange(3, 58, 4.0))
        ours = cost_percent(lambda sizes=sizes, fs_hz=fs_hz: pupil_updates(sizes, fs_hz), WINDOW_S)
        what = f"CPU of interpreter-pupillometry's step per stream at {fs_hz:g} Hz"
        rows.append({"what": what, "target": "<= 1 % of a core", "measured": f"{ours:.2f} %", "ok": bool(ours <= 1)})
    return rows


def memory_rows() -> list[Row]:
    """Memory over an hour of both, fast-forwarded at 60 Hz; the updates are not kept."""
    rows, fs_hz = [], 60.0
    places = np.random.default_rng(1).uniform([-15, -10], [15, 10], (11_000, 2))
    gaze = looking(fs_hz, places, noise=0.05)[0][: round(HOUR_S * fs_hz)]
    sizes = pupils(fs_hz, HOUR_S, [], np.arange(5, HOUR_S - 5, 5.0))
    for name, run, samples in (("gaze", gaze_updates, gaze), ("pupils", pupil_updates, sizes)):
        early = run(samples[: round(300 * fs_hz)], fs_hz, "deg" if name == "gaze" else "mm")
        before_mib = memory_mib()
        kept = len(run(samples, fs_hz, "deg" if name == "gaze" else "mm"))
        grown_mib = memory_mib() - before_mib
        measured = f"{grown_mib:+.1f} MiB, what {kept} updates take among them"
        what = f"memory over an hour of {name}, fast-forwarded"
        rows.append({"what": what, "target": "<= 20 MiB", "measured": measured, "ok": grown_mib <= 20})
        del early
    return rows


def rows() -> list[Row]:
    """Accuracy on what is there, and costs."""
    recorded = [*eyelink_rows(), toy_row()] if DATA.is_dir() else []
    return [*recorded, *pupil_rows(), *cost_rows(), *memory_rows()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
