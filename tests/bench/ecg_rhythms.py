"""Rate and RMSSD on the MIT-BIH records with many ectopic beats and with fibrillation, against their annotations."""

import re
from collections import Counter
from typing import Any, NamedTuple

import bench_ecg
import numpy as np
from interpreter_ecg.stream import EcgUpdate
from numpy.typing import NDArray
from scipy.signal import resample_poly

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RECORDS = ("200", "201", "207", "210", "213", "217")
FS_HZ = 130.0
NORMAL, NONE = "NLR/", "Q"  # the paced beats of 217 are its usual ones
FEW_ECTOPIC_PERCENT, FIRST_S, SETTLED_S, CONFIDENT = 10.0, 0.5, 10.0, 0.7


class Truth(NamedTuple):
    """The annotated beats of one record, shape (n,) each, and the stretches of flutter that are left out."""

    beats_s: Floats
    normal: Bools
    ectopic: Bools
    excluded_s: list[tuple[float, float]]


class Told(NamedTuple):
    """What one update says, and what is true of the beats told by then."""

    rate_off_bpm: float  # NaN where no rate is given with confidence
    rmssd_off_ms: float  # NaN where it is withheld
    ectopic_percent: tuple[float, float]  # annotated in the window of variability; told
    reason: str  # why variability is withheld


def truth_of(name: str) -> Truth:
    """Beats at their refined times; one cut by the beginning of the record has none."""
    record = bench_ecg.load(name)
    normal, none = (np.isin(record.symbols, list(symbols)) for symbols in (NORMAL, NONE))
    whole = record.beats_s > FIRST_S
    return Truth(bench_ecg.refined(record), normal & whole, ~normal & ~none, record.excluded_s)


def scored(name: str) -> list[Told]:
    """Every update of a record from SETTLED_S on, at FS_HZ."""
    record, truth = bench_ecg.load(name), truth_of(name)
    updates = bench_ecg.play(resample_poly(record.ecg, int(FS_HZ), int(record.fs_hz)), FS_HZ)
    told, newest_s = [], 0.0
    for update in updates:
        newest_s = max([newest_s, *((t - bench_ecg.START_NS) / 1e9 for t in update.peak_timestamps)])
        end_s = ((update.device_ns or 0) - bench_ecg.START_NS) / 1e9
        if end_s > SETTLED_S and not any(a < end_s and b > end_s - 11 for a, b in truth.excluded_s[1:]):
            told.append(compared(update, truth, end_s, newest_s))
    return told


def compared(update: EcgUpdate, truth: Truth, end_s: float, newest_s: float) -> Told:
    """One update against the annotated beats up to the newest it knows of."""
    off_bpm = np.nan
    if update.signal_quality >= CONFIDENT:
        off_bpm = update.heart_rate_bpm - rate_bpm(truth.beats_s, end_s - update.window_s, newest_s)
    inside = (truth.beats_s > end_s - update.hrv.window_s) & (truth.beats_s < newest_s + 0.05)
    percent = 100 * float(truth.ectopic[inside].mean()) if inside.any() else 0.0
    off_ms = update.hrv.rmssd_ms - rmssd_ms(truth.beats_s[inside], truth.normal[inside])
    reasons = [reason for reason in update.reasons if reason.startswith("hrv withheld")]
    reason = re.sub(r"[\d.]+ %", "n %", reasons[0].removeprefix("hrv withheld: ")) if reasons else ""
    return Told(off_bpm, off_ms, (percent, update.extra[1].values[0]), reason)


def rate_bpm(beats_s: Floats, begin_s: float, end_s: float) -> float:
    """True beats per minute of a stretch, parts of a beat counted."""
    begin_s = max(begin_s, float(beats_s[0]))
    begun, done = np.interp((begin_s, end_s), beats_s, np.arange(len(beats_s)))
    return float(60 * (done - begun) / (end_s - begin_s)) if end_s > begin_s else np.nan


def rmssd_ms(beats_s: Floats, normal: Bools) -> float:
    """Of the normal-to-normal intervals; NaN without two that follow each other."""
    pair = normal[1:] & normal[:-1]
    differences = np.diff(np.diff(beats_s) * 1e3)[pair[1:] & pair[:-1]]
    return float(np.sqrt(np.mean(differences**2))) if len(differences) else np.nan


def row(name: str) -> dict[str, Any]:
    """One record against the promise."""
    told = scored(name)
    rates = np.abs([t.rate_off_bpm for t in told])
    rates = rates[np.isfinite(rates)]
    few = np.array([t.ectopic_percent[0] <= FEW_ECTOPIC_PERCENT for t in told])
    rmssd = np.abs([t.rmssd_off_ms for t in told])
    why = Counter(t.reason for t in told if t.reason)
    percents = np.nanmean([t.ectopic_percent for t in told], axis=0)
    ok = bool(np.all(rates <= 5) and not np.any(rmssd[few] > 2) and not np.any(rmssd[~few] > 10))
    return {
        "what": f"ECG, MIT-BIH {name}, {len(told)} updates",
        "target": "confident rates within 5 bpm; RMSSD within 2 ms up to 10 % ectopic, above within 10 or withheld",
        "measured": f"{len(rates)} confident rates, off by {rates.max():.1f} bpm, {np.sum(rates > 5)} by more than 5; "
        f"RMSSD up to 10 % ectopic {spread(rmssd[few])}, above {spread(rmssd[~few])}; withheld: "
        + (", ".join(f"{n} {reason}" for reason, n in why.most_common()) or "none")
        + f"; ectopic {percents[0]:.0f} % annotated, {percents[1]:.0f} % told",
        "ok": ok,
    }


def spread(errors_ms: Floats) -> str:
    """How many are given and how far they are off."""
    given = errors_ms[np.isfinite(errors_ms)]
    if not len(given):
        return "never given"
    return f"{len(given)} times, off by {np.percentile(given, 95):.1f} (p95), {given.max():.1f} ms (worst)"
