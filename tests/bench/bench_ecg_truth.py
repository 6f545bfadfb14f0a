"""No confident number that is wrong: interpreter-ecg on signals of which the truth is known (ecg_trials), as ladders.

.venv/bin/python tests/bench/bench_ecg_truth.py
"""

from typing import Any

import bench_ecg
import ecg_trials as trials
import numpy as np
from interpreter_ecg.stream import EcgUpdate
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Row = dict[str, Any]

FS_HZ, SECONDS = 130.0, 150.0
N = round(FS_HZ * SECONDS)
CONFIDENT, SETTLED_S = 0.7, 8


def rmssd_ms(rhythm: trials.Rhythm) -> float:
    """Of the normal-to-normal intervals."""
    pair = rhythm.normal[1:] & rhythm.normal[:-1]
    return float(np.sqrt(np.mean(np.diff(np.diff(rhythm.beats_s) * 1e3)[pair[1:] & pair[:-1]] ** 2)))


def rate_error(updates: list[EcgUpdate], rhythm: trials.Rhythm) -> float:
    """The largest error in bpm of a rate given with confidence; 0 where there is none.

    The truth: true beats per minute from the beginning of the window to the newest beat told by then, parts of a beat
    counted.
    """
    errors, told_s = [0.0], 0.0
    for i, update in enumerate(updates):
        told_s = max([told_s, *((t - bench_ecg.START_NS) / 1e9 for t in update.peak_timestamps)])
        begin_s = ((update.device_ns or 0) - bench_ecg.START_NS) / 1e9 - update.window_s
        begin_s = max(begin_s, float(rhythm.beats_s[0]))
        begun, done = np.interp((begin_s, told_s), rhythm.beats_s, np.arange(len(rhythm.beats_s)))
        if i >= SETTLED_S and update.signal_quality >= CONFIDENT and done > begun + 1:
            errors.append(abs(update.heart_rate_bpm - 60 * (done - begun) / (told_s - begin_s)))
    return float(np.nanmax(errors))


def described(ecg: Floats, rhythm: trials.Rhythm, fs_hz: float = FS_HZ) -> tuple[str, float, float]:
    """What was given, the largest confident error of the rate, the error of the last RMSSD (NaN: withheld)."""
    updates = bench_ecg.play(ecg, fs_hz)
    off_bpm, off_ms = rate_error(updates, rhythm), updates[-1].hrv.rmssd_ms - rmssd_ms(rhythm)
    quality = np.mean([u.signal_quality for u in updates[SETTLED_S:]])
    return f"quality {quality:.2f}, rate off by {off_bpm:.1f} bpm, RMSSD by {off_ms:.1f} ms", off_bpm, off_ms


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
    for n in (2, 3, 4):
        rhythm = trials.every(rest, n)
        row(f"every {n}. beat ectopic", trials.ecg_of(rhythm, FS_HZ, SECONDS), rhythm, 2)
    for snr_db in (24, 18, 12, 6, 0):
        noise = trials.at_snr(trials.electrode_motion(N, FS_HZ, 2), snr_db)
        row(f"electrode motion at {snr_db} dB", trials.ecg_of(rest, FS_HZ, SECONDS) + noise, rest, 10)
    for noise_uv in (200, 260, 300, 360):
        white = np.random.default_rng(2).normal(0, noise_uv, N)
        row(f"{noise_uv} uV of white noise", trials.ecg_of(rest, FS_HZ, SECONDS) + white, rest, 10)
    for fs_hz, hz in ((250.0, 50.0), (130.0, 50.0), (130.0, 60.0), (100.0, 60.0)):
        ecg = trials.ecg_of(rest, fs_hz, SECONDS)
        row(f"{hz:g} Hz hum at {fs_hz:g} Hz", ecg + trials.hum(len(ecg), fs_hz, hz), rest, 0.5, fs_hz)
    nobody = {
        "sine of 5 Hz": trials.sine(N, FS_HZ, 5.0),
        "sine of 8 Hz": trials.sine(N, FS_HZ, 8.0),
        "pops": trials.pops(N, FS_HZ),
        "pacing without capture": trials.pacing_spikes(N, FS_HZ),
        "tremor": trials.tremor(N, FS_HZ),
        "white noise": np.random.default_rng(1).normal(0, 100, N),
    }
    for what, ecg in nobody.items():
        given = sum(bool(np.isfinite(update.heart_rate_bpm)) for update in bench_ecg.play(ecg, FS_HZ))
        table.append({"what": f"ECG, {what}", "target": "no rate", "measured": f"{given} rates", "ok": given == 0})
    return table


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
