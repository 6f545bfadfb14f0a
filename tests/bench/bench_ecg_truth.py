"""No confident number that is wrong: interpreter-ecg on signals of which the truth is known (ecg_trials), as ladders.

.venv/bin/python tests/bench/bench_ecg_truth.py
"""

from itertools import product
from typing import Any

import bench_ecg
import ecg_arrhythmias
import ecg_rhythms
import ecg_trials as trials
import numpy as np
from interpreter_ecg.config import Config
from interpreter_ecg.stream import EcgStream, EcgUpdate
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.sample_clock import SampleClock

Floats = NDArray[np.float64]
Row = dict[str, Any]

FS_HZ, SECONDS = 130.0, 150.0
N = round(FS_HZ * SECONDS)
CONFIDENT, SETTLED_S, UNDECIDED_S = 0.7, 8, 3
NOBODY_N = round(600 * FS_HZ)
HOLE_S, HOLES_SECONDS = (30.0, 30.4), 90.0


def rate_error(updates: list[EcgUpdate], rhythm: trials.Rhythm) -> float:
    """The largest error in bpm of a rate given with confidence; 0 where there is none.

    The truth: true beats per minute from the beginning of the window to the newest beat told by then, parts of a beat
    counted.
    """
    errors, told_s = [0.0], 0.0
    for i, update in enumerate(updates):
        told_s = max([told_s, *((t - bench_ecg.START_NS) / 1e9 for t in update.peak_timestamps)])
        begin_s = ((update.device_ns or 0) - bench_ecg.START_NS) / 1e9 - update.window_s
        if i >= SETTLED_S and update.signal_quality >= CONFIDENT:
            errors.append(abs(update.heart_rate_bpm - ecg_rhythms.rate_bpm(rhythm.beats_s, begin_s, told_s)))
    return float(np.nanmax(errors))


def described(ecg: Floats, rhythm: trials.Rhythm, fs_hz: float = FS_HZ) -> tuple[str, float, float]:
    """What was given, the largest confident error of the rate, the error of the last RMSSD (NaN: withheld)."""
    updates = bench_ecg.play(ecg, fs_hz)
    off_bpm, off_ms = rate_error(updates, rhythm), updates[-1].hrv.rmssd_ms - ecg_rhythms.rmssd_ms(*rhythm)
    quality = np.mean([u.signal_quality for u in updates[SETTLED_S:]])
    told = f"quality {quality:.2f}, rate off by {off_bpm:.1f} bpm, RMSSD by {off_ms:.1f} ms"
    return f"{told}; {beats(ecg, rhythm, fs_hz, updates)}", off_bpm, off_ms


def beats(ecg: Floats, rhythm: trials.Rhythm, fs_hz: float, updates: list[EcgUpdate]) -> str:
    """Sensitivity and PPV in percent between the first seconds and the last, ours beside those of others."""
    from ecg_peers import PEERS  # longer to import than all else here, and the unit tests compare with nobody

    found = {"beats": bench_ecg.peaks_s(updates)} | {name: peer(ecg, fs_hz) for name, peer in PEERS.items()}
    end_s = len(ecg) / fs_hz - UNDECIDED_S
    both = {who: shares(rhythm.beats_s, times, end_s) for who, times in found.items()}
    return ", ".join(f"{who} {sensitivity:.0f} / {ppv:.0f}" for who, (sensitivity, ppv) in both.items())


def shares(truth_s: Floats, found_s: Floats, end_s: float) -> tuple[float, float]:
    """Sensitivity and PPV in percent."""
    truth_s, found_s = (times[(times > SETTLED_S) & (times < end_s)] for times in (truth_s, found_s))
    errors, missed, invented = bench_ecg.compare(truth_s, found_s)
    sensitivity, ppv = (100 * len(errors) / max(len(errors) + wrong, 1) for wrong in (missed, invented))
    return sensitivity, ppv


def missing(ecg: Floats, at: slice) -> list[EcgUpdate]:
    """Every update where the frames of that stretch never came."""
    clock, stream, updates = SampleClock(FS_HZ), EcgStream(Config(), bench_ecg.info(FS_HZ)), []
    for part, first in ((ecg[: at.start], 0), (ecg[at.stop :], at.stop)):
        for chunk in bench_ecg.frames(part, FS_HZ):
            stamp = chunk.received_ns + round(first / FS_HZ * 1e9)
            updates += stream.push(clock.place(Chunk(chunk.channels, chunk.samples, stamp, stamp)))
    return updates


def holes(hole_s: float) -> Row:
    """A stretch of NaN, of one value, at a rail, at several places, against the run in which its frames are missing."""
    off_bpm, off_ms = [0.0], [0.0]
    for seed, at_s in product((2, 3, 4), HOLE_S):
        rhythm = trials.resting(HOLES_SECONDS, seed)
        ecg, at = (
            trials.ecg_of(rhythm, FS_HZ, HOLES_SECONDS),
            slice(round(at_s * FS_HZ), round((at_s + hole_s) * FS_HZ)),
        )
        truth_ms = missing(ecg, at)[-1].hrv.rmssd_ms
        for value in (np.nan, ecg[at.start - 1], 9000.0):
            broken = ecg.copy()
            broken[at] = value
            updates = bench_ecg.play(broken, FS_HZ)
            off_bpm.append(rate_error(updates, rhythm))
            off_ms.append(abs(updates[-1].hrv.rmssd_ms - truth_ms))
    return {
        "what": f"ECG, {len(off_ms) - 1} holes of {hole_s} s (NaN, held, rail)",
        "target": "confident rates within 7 bpm, RMSSD within 0.3 ms of the run with missing frames",
        "measured": f"rate off by {max(off_bpm):.1f} bpm, RMSSD by {np.max(off_ms):.2f} ms",
        "ok": bool(max(off_bpm) <= 7 and np.max(off_ms) <= 0.3),
    }


def low_and_inverted(rhythm: trials.Rhythm, fs_hz: float) -> Row:
    """Beats of a lead that sees little of the QRS complex, wanders, and has taller P and T waves."""
    ecg = trials.low_inverted(rhythm, fs_hz, SECONDS)
    updates = bench_ecg.play(ecg, fs_hz)
    worse = min(shares(rhythm.beats_s, bench_ecg.peaks_s(updates), SECONDS - UNDECIDED_S))
    return {
        "what": f"ECG, low inverted QRS after tall P waves at {fs_hz:g} Hz",
        "target": "sensitivity and PPV >= 97 %",
        "measured": beats(ecg, rhythm, fs_hz, updates),
        "ok": worse >= 97,
    }


def rows() -> list[Row]:
    """Every ladder against its target."""
    table: list[Row] = []

    def row(what: str, ecg: Floats, rhythm: trials.Rhythm, most_ms: float, fs_hz: float = FS_HZ) -> None:
        told, off_bpm, off_ms = described(ecg, rhythm, fs_hz)
        ok = bool(off_bpm <= 5 and not abs(off_ms) > most_ms)
        target = f"confident rates within 5 bpm, RMSSD within {most_ms:g} ms or withheld"
        table.append({"what": f"ECG, {what}", "target": target, "measured": told, "ok": ok})

    rest = trials.resting(SECONDS)
    for share in (0.0, 0.05, 0.1, 0.2):
        rhythm = trials.with_premature(rest, share)
        row(f"{100 * share:.0f} % premature beats", trials.ecg_of(rhythm, FS_HZ, SECONDS), rhythm, 2)
    for seed in (4, 5, 6):
        rhythm = trials.fibrillation(SECONDS, seed)
        waves = trials.flutter_waves(N, FS_HZ, seed)
        row(f"fibrillation {seed}", trials.ecg_of(rhythm, FS_HZ, SECONDS, p_wave=0.0) + waves, rhythm, 0)
    table += [holes(hole_s) for hole_s in (1, 3, 20)]
    for n in (2, 3, 4):
        rhythm = trials.every(rest, n)
        row(f"every {n}. beat ectopic", trials.ecg_of(rhythm, FS_HZ, SECONDS), rhythm, 2)
    for seed in (2, 3, 7, 8):
        for snr_db in (24, 18, 12, 6, 0):
            noise = trials.at_snr(trials.electrode_motion(N, FS_HZ, seed), snr_db)
            row(f"electrode motion {seed} at {snr_db} dB", trials.ecg_of(rest, FS_HZ, SECONDS) + noise, rest, 10)
    for noise_uv in (200, 260, 300, 360):
        white = np.random.default_rng(2).normal(0, noise_uv, N)
        row(f"{noise_uv} uV of white noise", trials.ecg_of(rest, FS_HZ, SECONDS) + white, rest, 10)
    for fs_hz, hz in ((250.0, 50.0), (130.0, 50.0), (130.0, 60.0), (100.0, 60.0)):
        ecg = trials.ecg_of(rest, fs_hz, SECONDS)
        row(f"{hz:g} Hz hum at {fs_hz:g} Hz", ecg + trials.hum(len(ecg), fs_hz, hz), rest, 0.5, fs_hz)
    table += [low_and_inverted(rest, fs_hz) for fs_hz in (130.0, 250.0, 360.0)]
    for what, ecg in trials.nobody(NOBODY_N, FS_HZ).items():
        rates = [u for u in bench_ecg.play(ecg, FS_HZ) if np.isfinite(u.heart_rate_bpm)]
        sure = sum(update.signal_quality >= CONFIDENT for update in rates)
        what = f"ECG, {what}, {NOBODY_N / FS_HZ / 60:.0f} min"
        told = f"{len(rates)} rates, {sure} of them confident"
        table.append({"what": what, "target": "no rate", "measured": told, "ok": not rates})
    table += ecg_arrhythmias.rows()
    table += [ecg_rhythms.row(name) for name in ecg_rhythms.RECORDS if name in bench_ecg.names()]
    return table


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
