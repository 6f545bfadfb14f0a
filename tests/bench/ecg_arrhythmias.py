"""Rhythms in which some intervals are not normal to normal, of which the truth is known, and what is told of them.

Premature beats of the atria, runs of ventricular beats, pauses and blocks, and deep breathing in which all is normal.
Every update is compared, not only the last.

    .venv/bin/python tests/bench/ecg_arrhythmias.py
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import bench_ecg
import ecg_trials as trials
import numpy as np
from interpreter_ecg.stream import EcgUpdate
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SECONDS, CONFIDENT, MOST_OFF_MS = 120.0, 0.7, 10.0
FIRST_BEATS = 8  # of a rhythm, without anything unusual


class Arrhythmia(NamedTuple):
    """A heart that is not always led by its sinus node."""

    rhythm: trials.Rhythm  # its `normal`: the shape of the beats
    normal_to_normal: Bools  # of the interval that ends with each beat, shape (n,); the first is none


def sinus(
    rate_bpm: float, seconds: float = SECONDS, depth: float = 0.0, breaths_hz: float = 0.25, seed: int = 1
) -> Floats:
    """Intervals in s of a sinus rhythm that breathing modulates by `depth` of the mean, a little noise and slow waves.

    Breaths differ in length by 15 %.
    """
    random = np.random.default_rng(seed)
    intervals_s: list[float] = []
    phase = elapsed_s = 0.0
    while elapsed_s < seconds - 0.5:
        slow = 0.02 * np.sin(2 * np.pi * 0.1 * elapsed_s) + 0.01 * random.standard_normal()
        interval_s = 60 / rate_bpm * (1 + depth * np.sin(phase) + slow)
        phase += 2 * np.pi * breaths_hz * (1 + 0.15 * random.standard_normal()) * interval_s
        elapsed_s += interval_s
        intervals_s.append(interval_s)
    return np.array(intervals_s)


def of(intervals_s: Floats, not_normal: Bools, ventricular: Bools | None = None) -> Arrhythmia:
    """The heart with these intervals. not_normal: intervals; ventricular: beats that end them."""
    beats_s = np.concatenate(([0.5], 0.5 + np.cumsum(intervals_s)))
    wide = np.zeros(len(not_normal), bool) if ventricular is None else ventricular
    return Arrhythmia(trials.Rhythm(beats_s, np.append(True, ~wide)), np.append(False, ~not_normal))


def atrial_premature(intervals_s: Floats, share: float, seed: int = 1) -> Arrhythmia:
    """That share of the beats comes 15 to 40 % early; the pause after it compensates nothing, all, or some of it."""
    random = np.random.default_rng(seed)
    intervals_s, early = intervals_s.copy(), np.zeros(len(intervals_s), bool)
    while early.mean() < share:
        i = int(random.integers(FIRST_BEATS, len(intervals_s) - 2))
        if not early[i - 1 : i + 2].any():
            missing_s = random.uniform(0.15, 0.4) * intervals_s[i]
            intervals_s[i] -= missing_s
            intervals_s[i + 1] += random.uniform(0, 1) * missing_s + 0.03 * intervals_s[i + 1]
            early[i] = True
    return of(intervals_s, early | np.append(False, early[:-1]))


def ventricular_runs(intervals_s: Floats, length: int, every_s: float = 20.0, rate_bpm: float = 167.0) -> Arrhythmia:
    """Every so often that many ventricular beats in a row, then a pause of 1.3 usual intervals."""
    parts, wide, since_s = [], [], 0.0
    for i, interval_s in enumerate(intervals_s):
        if since_s > every_s and i > FIRST_BEATS:
            parts += [60 / rate_bpm] * length + [1.3 * interval_s]
            wide += [True] * length + [False]
            since_s = 0.0
        else:
            parts.append(interval_s)
            wide.append(False)
        since_s += interval_s
    ventricular = np.array(wide)
    arrhythmia = of(np.array(parts), ventricular | np.append(False, ventricular[:-1]), ventricular)
    return until(arrhythmia, float(0.5 + intervals_s.sum()))


def until(arrhythmia: Arrhythmia, seconds: float) -> Arrhythmia:
    """Its beats before that time."""
    rhythm, normal_to_normal = arrhythmia
    inside = rhythm.beats_s < seconds
    return Arrhythmia(trials.Rhythm(rhythm.beats_s[inside], rhythm.normal[inside]), normal_to_normal[inside])


def pauses(intervals_s: Floats, pause_s: float, every: int = 25) -> Arrhythmia:
    """Every so many beats the sinus node pauses."""
    at = np.arange(len(intervals_s)) % every == every - 1
    return until(of(np.where(at, pause_s, intervals_s), at), float(0.5 + intervals_s.sum()))


def blocked(intervals_s: Floats, conducted: int, two_to_one: int) -> Arrhythmia:
    """So many beats are conducted one by one, then so many of which every other is not, in turn."""
    parts: list[float] = []
    longer: list[bool] = []
    waiting = list(intervals_s)
    while len(waiting) > 2:
        block = len(parts) % (conducted + two_to_one) >= conducted
        parts.append(waiting.pop(0) + (waiting.pop(0) if block else 0.0))
        longer.append(block)
    return of(np.array(parts), np.array(longer))


def rmssd_ms(arrhythmia: Arrhythmia, from_s: float = -np.inf, to_s: float = np.inf) -> float:
    """Of the normal-to-normal intervals that end in that time."""
    beats_s, both = arrhythmia.rhythm.beats_s, arrhythmia.normal_to_normal
    inside = both & (beats_s > from_s) & (beats_s < to_s)
    differences = np.diff(np.diff(beats_s) * 1e3)[inside[2:] & inside[1:-1]]
    return float(np.sqrt(np.mean(differences**2))) if len(differences) else np.nan


def ecg_of(arrhythmia: Arrhythmia, fs_hz: float) -> Floats:
    """What its recording shows, in uV."""
    return trials.ecg_of(arrhythmia.rhythm, fs_hz, float(arrhythmia.rhythm.beats_s[-1]) + 0.4)


class Told(NamedTuple):
    """What is told of one recording, in confident updates."""

    given: int  # updates with RMSSD
    wrong: int  # of these
    worst_ms: float
    last_ms: float  # error of the last; NaN where withheld
    ectopic_percent: float  # of the last


def told(arrhythmia: Arrhythmia, fs_hz: float) -> Told:
    """Every update of a recording of that heart against the truth up to its newest beat."""
    errors, newest_s, updates = [], 0.0, bench_ecg.play(ecg_of(arrhythmia, fs_hz), fs_hz)
    for update in updates:
        newest_s = max([newest_s, *((t - bench_ecg.START_NS) / 1e9 for t in update.peak_timestamps)])
        errors.append(_error_ms(update, arrhythmia, newest_s))
    off_ms = np.abs(errors)
    percent = next(feature.values[0] for feature in updates[-1].extra if feature.name == "ectopic_percent")
    wrong = int(np.sum(off_ms > MOST_OFF_MS))
    given = int(np.isfinite(off_ms).sum())
    return Told(given, wrong, float(np.nanmax(off_ms, initial=0.0)), float(off_ms[-1]), percent)


def _error_ms(update: EcgUpdate, arrhythmia: Arrhythmia, newest_s: float) -> float:
    if update.signal_quality < CONFIDENT:
        return np.nan
    end_s = ((update.device_ns or 0) - bench_ecg.START_NS) / 1e9
    return update.hrv.rmssd_ms - rmssd_ms(arrhythmia, end_s - update.hrv.window_s, newest_s + 0.05)


def kinds() -> Iterator[tuple[str, list[tuple[Arrhythmia, float]]]]:
    """What is tried: a name, and hearts with the rate they are sampled at."""
    hearts = list(zip((50, 75, 110), (250.0, 130.0, 360.0), strict=True))
    for depth, share in product((0.0, 0.05, 0.1), (0.02, 0.1, 0.2)):
        yield (
            f"{100 * share:.0f} % atrial premature beats, breathing {100 * depth:.0f} %",
            [(atrial_premature(sinus(rate, depth=depth), share, rate), fs_hz) for rate, fs_hz in hearts],
        )
    for share in (0.05, 0.1, 0.2):  # hearts so slow that a breath has three or four beats
        slow = [(rate, seed) for rate in (42, 50, 58, 66) for seed in (5, 6, 7)]
        yield (
            f"{100 * share:.0f} % atrial premature beats, breathing 10 %, 42 to 66 bpm",
            [(atrial_premature(sinus(rate, depth=0.1, seed=seed), share, seed), 250.0) for rate, seed in slow],
        )
    for depth, breaths_hz in ((0.1, 0.1), (0.15, 0.2), (0.12, 0.25)):
        tried = [(sinus(rate, depth=depth, breaths_hz=breaths_hz), fs_hz) for rate, fs_hz in hearts[:2]]
        yield (
            f"breathing {100 * depth:.0f} % at {60 * breaths_hz:.0f}/min, all normal",
            [(of(intervals_s, np.zeros(len(intervals_s), bool)), fs_hz) for intervals_s, fs_hz in tried],
        )
    rest = [(sinus(rate, depth=0.03), fs_hz) for rate, fs_hz in hearts[:2]]
    for length in (2, 3, 8, 30):
        many = 20.0 if length < 10 else 60.0
        yield (
            f"runs of {length} ventricular beats",
            [(ventricular_runs(intervals_s, length, many), fs_hz) for intervals_s, fs_hz in rest],
        )
    for pause_s in (2.0, 3.0):
        yield f"pauses of {pause_s:g} s", [(pauses(intervals_s, pause_s), fs_hz) for intervals_s, fs_hz in rest]
    for conducted, two_to_one in ((20, 1), (8, 4), (15, 15)):
        yield (
            f"{conducted} beats conducted, {two_to_one} at 2:1",
            [(blocked(intervals_s, conducted, two_to_one), fs_hz) for intervals_s, fs_hz in rest],
        )


def rows() -> list[dict[str, Any]]:
    """Every kind against the promise."""
    table = []
    for name, tried in kinds():
        all_told = [told(arrhythmia, fs_hz) for arrhythmia, fs_hz in tried]
        given, wrong = (sum(getattr(one, field) for one in all_told) for field in ("given", "wrong"))
        worst_ms = max(one.worst_ms for one in all_told)
        last = ", ".join("withheld" if np.isnan(one.last_ms) else f"{one.last_ms:.1f}" for one in all_told)
        percent = ", ".join(f"{one.ectopic_percent:.0f}" for one in all_told)
        table.append(
            {
                "what": f"ECG, {name}, {len(tried)} hearts",
                "target": "no confident RMSSD off by 10 ms",
                "measured": f"{wrong} of {given} off, worst {worst_ms:.0f} ms; last {last}; {percent} % ectopic told",
                "ok": wrong == 0,
            }
        )
    return table


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
