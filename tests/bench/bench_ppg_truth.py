"""What interpreter-ppg says of signals whose truth is known: hum, tremor, rhythms that are no heart, fast hearts.

.venv/bin/python tests/bench/bench_ppg_truth.py
"""

from typing import Any

import numpy as np
import ppg_trials as trials
from ppg_trials import LEVEL, PULSE, Floats

Row = dict[str, Any]
LONG_S, SHORT_S = 600.0, 120.0
SENSOR_RATES_HZ = (28, 44, 55, 64, 135)  # of arm bands and wristbands


def times_s(fs_hz: float, duration_s: float) -> Floats:
    return np.arange(0, duration_s, 1 / fs_hz)


def no_heart_row(name: str, wave: Any) -> Row:
    """Ten minutes at each rate of what is no heart."""
    counts = {}
    for fs_hz in SENSOR_RATES_HZ:
        t = times_s(fs_hz, LONG_S)
        noise = 20 * np.random.default_rng(0).normal(size=len(t))
        updates = trials.play(LEVEL + PULSE * wave(t) + noise, fs_hz)
        counts[fs_hz] = len(trials.confident(updates, 0.5))
    told = ", ".join(f"{fs_hz} Hz {count}" for fs_hz, count in counts.items())
    return row(f"PPG, {name}, 10 min each: updates with a rate", "0", told, not any(counts.values()))


def fast_row() -> Row:
    found = []
    for bpm in (200, 220, 240):
        t, heart = times_s(55, SHORT_S), trials.heart(SHORT_S, bpm, 8)
        updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t), 55)
        near = [abs(u.heart_rate_bpm - heart.rate_bpm(trials.end_s(u) - 1)) < 10 for u in trials.confident(updates)]
        found.append(f"{bpm} /min {100 * sum(near) / len(updates):.0f} %")
    ok = all(float(one.split()[-2]) > 90 for one in found)
    return row("PPG, real heart of 200-240 /min: updates with its rate", "> 90 %", ", ".join(found), ok)


def hum_row(mains_hz: float, fs_hz: float, share: float) -> Row:
    """Hum of this share of the pulse's height, against the same signal without it."""
    t, heart = times_s(fs_hz, LONG_S), trials.heart(LONG_S, 68)
    wave = trials.pulses(heart, t)
    clean, spoilt = (
        trials.play(LEVEL + PULSE * (wave + hum), fs_hz) for hum in (0 * t, share * trials.mains(mains_hz, t, 0.05))
    )
    added_ms = np.sqrt(max(0.0, trials.jitter_ms(spoilt, heart) ** 2 - trials.jitter_ms(clean, heart) ** 2))
    rmssd_ms = [updates[-1].hrv.rmssd_ms for updates in (clean, spoilt)]
    error_ms = abs(rmssd_ms[1] - rmssd_ms[0])
    alias_hz = abs(mains_hz - fs_hz * round(mains_hz / fs_hz))
    what = f"PPG at {fs_hz:g} Hz, {mains_hz:g} Hz hum of {share:g} of a pulse (seen at {alias_hz:g} Hz)"
    told = f"{added_ms:.2f} ms, {error_ms:.2f} ms (without hum {rmssd_ms[0]:.1f}, true {heart.rmssd_ms:.1f})"
    ok = added_ms <= 0.5 and error_ms <= 0.2
    return row(f"{what}: jitter, RMSSD error", "<= 0.5 ms, <= 0.2 ms", told, ok)


def row(what: str, target: str, measured: str, ok: bool) -> Row:
    return {"what": what, "target": target, "measured": measured, "ok": bool(ok)}


def rows() -> list[Row]:
    """Every number of this page."""
    return [
        no_heart_row("a 5 Hz sine", lambda t: trials.sine(5, t)),
        no_heart_row("an 8 Hz sine", lambda t: trials.sine(8, t)),
        no_heart_row("tremor of 5 Hz", lambda t: trials.tremor(5, t)),
        no_heart_row("pops of one sample, 1.2/s", lambda t: np.diff(np.floor(1.2 * t), prepend=0.0)),
        fast_row(),
        *(hum_row(50, fs_hz, 0.5) for fs_hz in (28, 44, 55, 135)),
        *(hum_row(60, fs_hz, 0.5) for fs_hz in (28, 55, 64)),
    ]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {'yes' if entry['ok'] else 'NO'} |")
