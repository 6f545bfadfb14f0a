"""What interpreter-ppg says of signals whose truth is known: hum, noise, steps, tremor, what is no heart, fast hearts.

.venv/bin/python tests/bench/bench_ppg_truth.py [--short]

Beside it, in the same run, detectors of others. Short: a fifth of the time, about 40 s on an idle core.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import ppg_trials as trials
from ppg_peers import PEERS
from ppg_trials import LEVEL, PULSE, Floats

Row = dict[str, Any]
LONG_S, SHORT_S = 600.0, 120.0
SENSOR_RATES_HZ = (28, 55, 135)  # of arm bands and wristbands
HUM_RATES_HZ = (25, 28, 50, 55, 64, 100, 128, 130, 135, 176, 250, 256, 500)
CONFIDENT, PROMISED_BPM, PROMISED_MS = 0.7, 5.0, 10.0
MOTION_TIMES = (0.5, 0.7, 0.9, 1.25, 1.5, 2, 3)  # rates of steps, of the heart's
LAG_S = 1.2  # of what an update tells behind its last sample


def times_s(fs_hz: float, duration_s: float) -> Floats:
    return np.arange(0, duration_s, 1 / fs_hz)


def no_heart_row(name: str, wave: Callable[[Floats], Floats], seconds: float) -> Row:
    """Each rate of sampling, of what is no heart."""
    counts = {}
    for fs_hz in SENSOR_RATES_HZ:
        t = times_s(fs_hz, seconds)
        noise = 20 * np.random.default_rng(0).normal(size=len(t))
        updates = trials.play(LEVEL + PULSE * wave(t) + noise, fs_hz)
        counts[fs_hz] = len(trials.confident(updates, 0.5))
    told = ", ".join(f"{fs_hz} Hz {count}" for fs_hz, count in counts.items())
    return row(f"PPG, {name}, {seconds:.0f} s each: updates with a rate", "0", told, not any(counts.values()))


def fast_row() -> Row:
    found = []
    for bpm in (200, 220, 240):
        t, heart = times_s(55, SHORT_S), trials.heart(SHORT_S, bpm, 8)
        updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t), 55)
        near = [abs(u.heart_rate_bpm - heart.rate_bpm(trials.end_s(u) - 1)) < 10 for u in trials.confident(updates)]
        found.append(f"{bpm} /min {100 * sum(near) / len(updates):.0f} %")
    ok = all(float(one.split()[-2]) > 90 for one in found)
    return row("PPG, real heart of 200-240 /min: updates with its rate", "> 90 %", ", ".join(found), ok)


def hum_row(fs_hz: float, seconds: float) -> Row:
    """The worse of 50 and 60 Hz, half a pulse high, 0.05 Hz off and drifting, against the same signal without."""
    t, heart = times_s(fs_hz, seconds), trials.heart(seconds, 68)
    wave = trials.pulses(heart, t)
    signals = [LEVEL + PULSE * (wave + hum) for hum in (0 * t, *(trials.mains(hz, t, 0.05) / 2 for hz in (50, 60)))]
    updates = [trials.play(signal, fs_hz) for signal in signals]
    found = [trials.seen_s(played) for played in updates]
    added_ms = added(found, heart)
    error_ms = max(abs(played[-1].hrv.rmssd_ms - updates[0][-1].hrv.rmssd_ms) for played in updates[1:])
    told = [f"{added_ms:.2f} ms, {error_ms:.2f} ms"]
    for name, peer in PEERS.items():
        others = [peer(signal, fs_hz) for signal in signals]
        off_ms = max(abs(trials.rmssd_ms(one) - trials.rmssd_ms(others[0])) for one in others[1:])
        told.append(f"{name} {added(others, heart):.1f} ms, {off_ms:.1f} ms")
    what = f"PPG at {fs_hz:g} Hz, worse of 50 and 60 Hz hum of half a pulse: jitter added, RMSSD error"
    return row(what, "<= 0.5 ms, <= 0.2 ms", "; ".join(told), added_ms <= 0.5 and error_ms <= 0.2)


def added(found: list[Floats], heart: trials.Heart) -> float:
    """Return the jitter, ms, that the later ones have beyond that of the first; NaN where pulses are not found."""
    clean_ms, *spoilt_ms = (trials.jitter_ms(times, heart) for times in found)
    return float(np.sqrt(np.maximum(np.square(spoilt_ms) - clean_ms**2, 0.0)).max())


def promise_row(
    name: str, noise: Callable[[Floats], Floats], seconds: float, moved: Callable[[Floats], Floats] | None = None
) -> Row:
    """Rate and RMSSD at quality 0.7 and more, worst of four hearts; the peers' worst in any window of 10 s."""
    t, given, total = times_s(55, seconds), 0, 0
    worst = {"": [0.0, 0.0]} | {peer: [0.0, 0.0] for peer in PEERS}
    for bpm in (55, 68, 90, 120):
        heart = trials.heart(seconds, bpm, 25 if bpm < 100 else 10)
        signal = LEVEL + PULSE * (trials.pulses(heart, t) + noise(t))
        updates = trials.play(signal, 55, moved=None if moved is None else moved(t))
        sure = trials.confident(updates, CONFIDENT)
        given, total = given + len(sure), total + len(updates)
        at_s = [trials.end_s(update) - LAG_S for update in sure]
        rates = [abs(u.heart_rate_bpm - heart.rate_bpm(end)) for u, end in zip(sure, at_s, strict=True)]
        hrv = [
            abs(u.hrv.rmssd_ms - trials.rmssd_ms(heart.beats_s[heart.beats_s <= end]))
            for u, end in zip(sure, at_s, strict=True)
        ]
        errors = {"": (rates, hrv)}
        for peer, find in PEERS.items():
            found = trials.Heart(find(signal, 55))
            ends = np.arange(15, seconds - 5, 5.0)
            errors[peer] = (
                [abs(found.rate_bpm(end) - heart.rate_bpm(end)) for end in ends],
                [abs(found.rmssd_ms - heart.rmssd_ms)],
            )
        for who, both in errors.items():
            worst[who] = [np.nanmax([before, *now]) for before, now in zip(worst[who], both, strict=True)]
    told = [f"{who} {bpm:.1f} /min, {ms:.1f} ms".strip() for who, (bpm, ms) in worst.items()]
    told[0] += f" ({100 * given / total:.0f} % of the updates)"
    ok = worst[""][0] <= PROMISED_BPM and worst[""][1] <= PROMISED_MS
    return row(f"PPG, {name}: rate and RMSSD off at quality >= 0.7", "<= 5 /min, <= 10 ms", "; ".join(told), ok)


def motion_row(times: float, seconds: float) -> Row:
    """Steps at so many times the heart's rate, half, once and twice as high as the pulse, no accelerometer."""
    t, off, sure, total = times_s(55, seconds), 0, 0, 0
    for bpm in (55, 68, 75, 90, 110):
        heart = trials.heart(seconds, bpm, 25 if bpm < 100 else 10)
        pulses, steps = trials.pulses(heart, t), trials.walking(times * bpm / 60, t)
        for height in (0.5, 1, 2):
            updates = trials.play(LEVEL + PULSE * (pulses + height * np.ptp(pulses) * steps), 55)
            given = trials.confident(updates, CONFIDENT)
            rates = [abs(u.heart_rate_bpm - heart.rate_bpm(trials.end_s(u) - LAG_S)) for u in given]
            off += sum(bpm_off > PROMISED_BPM for bpm_off in rates)
            sure, total = sure + len(given), total + len(updates)
    what = f"PPG, steps at {times:g} times the heart's rate, 0.5, 1 and 2 pulses high: rates off by > 5 /min"
    return row(what, "0", f"{off} of {sure} at quality >= 0.7, {total} updates", not off)


def premature_row(early: float, height: float, seconds: float) -> Row:
    """RMSSD at quality 0.7 and more against that of the normal beats, worst of two hearts."""
    t, off_ms, given, total = times_s(55, seconds), 0.0, 0, 0
    for bpm in (58, 78):
        heart = trials.premature(seconds, bpm, 0.1, early, height)
        updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t, heights=heart.heights), 55)
        told_ms = [u.hrv.rmssd_ms for u in trials.confident(updates, CONFIDENT) if np.isfinite(u.hrv.rmssd_ms)]
        given, total = given + len(told_ms), total + len(updates)
        off_ms = max([off_ms, *(abs(ms - heart.rmssd_ms) for ms in told_ms)])
    what = f"PPG, a beat in ten after {early:g} of an interval, its pulse {height:g} high: RMSSD off at quality >= 0.7"
    return row(what, "<= 10 ms", f"{off_ms:.1f} ms ({100 * given / total:.0f} % of the updates)", off_ms <= PROMISED_MS)


def row(what: str, target: str, measured: str, ok: bool) -> Row:
    return {"what": what, "target": target, "measured": measured, "ok": bool(ok)}


def rows(seconds: float = LONG_S) -> list[Row]:
    """Every number of this page; seconds: of signal for each of them."""
    shares = (0.1, 0.2, 0.4)
    return [
        no_heart_row("a 5 Hz sine", lambda t: trials.sine(5, t), seconds),
        no_heart_row("an 8 Hz sine", lambda t: trials.sine(8, t), seconds),
        no_heart_row("tremor of 5 Hz", lambda t: trials.tremor(5, t), seconds),
        no_heart_row("pops of one sample, 1.2/s", lambda t: np.diff(np.floor(1.2 * t), prepend=0.0), seconds),
        fast_row(),
        *(motion_row(times, SHORT_S / 2) for times in MOTION_TIMES),
        *(premature_row(early, height, SHORT_S) for early, height in ((0.55, 0.3), (0.65, 0), (0.75, 0.5), (0.8, 0.7))),
        *(hum_row(fs_hz, min(seconds, 2 * SHORT_S)) for fs_hz in HUM_RATES_HZ),
        *(promise_row(f"white noise of {s:g}", lambda t, s=s: s * trials.white(t), SHORT_S) for s in shares),
        *(promise_row(f"bursts of {s:g}", lambda t, s=s: s * trials.bursts(t), SHORT_S) for s in shares),
        *(
            promise_row(f"steps at {hz} Hz as high", lambda t, hz=hz: trials.walking(hz, t), SHORT_S)
            for hz in (1.6, 1.8, 2, 2.2)
        ),
        *(
            promise_row(
                f"steps at {hz} Hz as high, with the device's accelerometer",
                lambda t, hz=hz: trials.walking(hz, t),
                SHORT_S,
                lambda t, hz=hz: trials.acceleration(hz, t),
            )
            for hz in (1.6, 1.8, 2, 2.2)
        ),
    ]


if __name__ == "__main__":
    for entry in rows(SHORT_S if "--short" in sys.argv else LONG_S):
        told = "yes" if entry["ok"] else "NO"
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {told} |", flush=True)
