"""Signals of nine modalities whose every event is known, and what an interpreter says of them.

Times are seconds since the Unix epoch; the same second gives the same signal. Events are `every` so many seconds.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from sense4hri_msgs.msg import (
    ECG,
    EDA,
    EEG,
    EMG,
    EOG,
    PPG,
    EyeTracking,
    Motion,
    PhysioFeature,
    Pupillometry,
    Respiration,
)
from synthetic_signals import PULSE_DELAY_S, Signal, acceleration, beats, ecg_uv, every, noise, ppg_counts

BPM = 68.0
SCR_EVERY_S, SCR_AFTER_S, SCR_RISE_S, TONIC_US = 7.0, 1.0, 2.0, 4.2
BREATH_EVERY_S, BREATH_AFTER_S = 4.0, 1.0
BURSTS = {"biceps": (1.0, 1.6), "triceps": (3.0, 1.1)}  # s after every sixth second, and s long
BURST_EVERY_S = 6.0
BLINK_EVERY_S, BLINK_AFTER_S, BLINK_S = 3.5, 1.2, 0.25
LOOK_S, SACCADE_S = 0.5, 0.05
ELECTRODES = (
    "Fp1 Fp2 AF3 AF4 F7 F3 Fz F4 F8 FC5 FC1 FC2 FC6 T7 C3 Cz C4 T8 CP5 CP1 CP2 CP6 P7 P3 Pz P4 P8 PO3 PO4 O1 Oz O2"
)
CAP = ELECTRODES.split()
POOR, DOUBTFUL = "T7", "O2"


class Kind(NamedTuple):
    """One stream. make: times -> samples (n, channels); tell: (features message, since, until) -> that, filled."""

    sensor_type: str
    rate_hz: float
    unit: str
    channels: tuple[str, ...]
    make: Callable[[Signal], Signal]
    tell: Callable[[float, float], Any]


def stamps(times_s: Signal) -> list[Time]:
    """Return times as stamps."""
    return [Time(sec=int(t), nanosec=round(t % 1 * 1e9) % 10**9) for t in times_s]


def eda(times_s: Signal) -> Signal:
    """A level and one response every seven seconds: up in two seconds, half of it lost in another two."""
    found = TONIC_US + 0.3 * np.sin(times_s / 40) + noise(times_s, 1, 0.004)[:, 0]
    for onset in every(SCR_EVERY_S, SCR_AFTER_S, times_s[0] - 20, times_s[-1]):
        since = times_s - onset
        rise = 0.5 - 0.5 * np.cos(np.pi * np.clip(since / SCR_RISE_S, 0, 1))
        found += 0.5 * rise * np.exp(-np.maximum(0, since - SCR_RISE_S) / 2.5)
    return found[:, None]


def tell_eda(since_s: float, until_s: float) -> EDA:
    onsets = every(SCR_EVERY_S, SCR_AFTER_S, since_s - SCR_RISE_S, until_s - SCR_RISE_S)
    told = EDA(tonic_us=TONIC_US, scr_count=4, scr_rate_per_min=60 / SCR_EVERY_S, scr_rise_time_s=SCR_RISE_S)
    told.scr_onset_timestamps, told.scr_peak_timestamps = stamps(onsets), stamps(onsets + SCR_RISE_S)
    told.scr_amplitudes_us, told.scr_amplitude_us = [0.5] * len(onsets), 0.5
    level = TONIC_US + 0.3 * np.sin(until_s / 40)
    told.extra = [PhysioFeature(name="tonic_now", unit="uS", values=[level])]
    return told


def respiration(times_s: Signal) -> Signal:
    """A breath every four seconds, at its greatest one second after these."""
    return (80 * np.sin(2 * np.pi * (times_s % BREATH_EVERY_S) / BREATH_EVERY_S) + noise(times_s, 1, 2)[:, 0])[:, None]


def tell_respiration(since_s: float, until_s: float) -> Respiration:
    breaths = every(BREATH_EVERY_S, BREATH_AFTER_S, since_s, until_s)
    return Respiration(breath_timestamps=stamps(breaths), breaths_per_min=60 / BREATH_EVERY_S, period_s=BREATH_EVERY_S)


def rate_of_heart(at_s: float) -> float:
    """Breaths per minute that the ECG tells at a whole second: slowly to and fro, three seconds of twenty unknown."""
    return math.nan if 12 <= at_s % 20 < 15 else 14 + 2 * math.sin(at_s / 8)


def tell_breathing_of_heart(until_s: float) -> Respiration:
    rate = rate_of_heart(until_s)
    reasons = ["breathing rate: amplitude and interval of the beats disagree"] if math.isnan(rate) else []
    return Respiration(breaths_per_min=rate, period_s=60 / rate, reasons=reasons)


def emg(times_s: Signal) -> Signal:
    """Two muscles that contract in turn."""
    found = noise(times_s, 2, 6)
    for column, (after_s, long_s) in enumerate(BURSTS.values()):
        on = (times_s - after_s) % BURST_EVERY_S < long_s
        found[on, column] += noise(times_s[on] + 3, 1, 220)[:, 0]
    return found


def tell_emg(since_s: float, until_s: float) -> EMG:
    told = EMG(channel_names=list(BURSTS), channel_quality=[0.93, 0.9], rms_uv=[40.0, 35.0])
    for muscle, (after_s, long_s) in BURSTS.items():
        onsets = stamps(every(BURST_EVERY_S, after_s, since_s, until_s))
        offsets = stamps(every(BURST_EVERY_S, after_s + long_s, since_s, until_s))
        told.onset_timestamps, told.offset_timestamps = (
            [*told.onset_timestamps, *onsets],
            [*told.offset_timestamps, *offsets],
        )
        told.onset_channels, told.offset_channels = (
            [*told.onset_channels, *[muscle] * len(onsets)],
            [*told.offset_channels, *[muscle] * len(offsets)],
        )
    told.active = [bool((until_s - after_s) % BURST_EVERY_S < long_s) for after_s, long_s in BURSTS.values()]
    return told


def eeg(times_s: Signal) -> Signal:
    """Thirty-two electrodes: alpha that waxes towards the back of the head; one has no contact."""
    found = noise(times_s, len(CAP), 9)
    waxing = 1 + np.sin(2 * np.pi * (times_s % 9) / 9)
    for column, name in enumerate(CAP):
        strong = 14 if name[0] in "PO" else 4
        found[:, column] += strong * waxing * np.sin(2 * np.pi * 10 * (times_s % 60) + column / 5)
        found[:, column] += 8 * np.sin(2 * np.pi * 2 * (times_s % 60) + column / 3)
    found[:, CAP.index(POOR)] *= 6
    return found


def tell_eeg(since_s: float, until_s: float) -> EEG:
    alpha = 30 * (1 + np.sin(2 * np.pi * (until_s % 9) / 9)) + 5
    told = EEG(channel_names=CAP, engagement_index=0.7, theta_alpha_ratio=0.8, frontal_alpha_asymmetry=0.05)
    for band, power in (("delta", 30.0), ("theta", 18.0), ("alpha", alpha), ("beta", 9.0), ("gamma", 4.0)):
        setattr(told, f"{band}_uv2", [1e4 if name == POOR else power for name in CAP])
    told.channel_quality = [{POOR: 0.15, DOUBTFUL: 0.62}.get(name, 0.95) for name in CAP]
    return told


def blinks(start_s: float, end_s: float) -> Signal:
    """Return the times of greatest closure."""
    return every(BLINK_EVERY_S, BLINK_AFTER_S, start_s, end_s)


def looks(start_s: float, end_s: float) -> list[tuple[float, float, float]]:
    """Return (start, x, y) of every fixation that starts in a range; px of 1920 x 1080."""
    starts = every(LOOK_S, 0.0, start_s, end_s)
    return [(t, 960 + 700 * np.sin(t % 97), 540 + 380 * np.cos(1.7 * (t % 89))) for t in starts]


def eog(times_s: Signal) -> Signal:
    """Steps of the eyes to the side, and lids."""
    found = noise(times_s, 2, 8)
    for start, x, _ in looks(times_s[0] - 1, times_s[-1] + 1):
        found[(times_s >= start) & (times_s < start + LOOK_S), 0] += (x - 960) / 5
    for blink in blinks(times_s[0] - 1, times_s[-1] + 1):
        found[:, 1] += 320 * np.exp(-(((times_s - blink) / 0.06) ** 2) / 2)
    return found


def tell_eog(since_s: float, until_s: float) -> EOG:
    times = blinks(since_s, until_s)
    told = EOG(blink_timestamps=stamps(times), blink_durations_ms=[1000 * BLINK_S] * len(times))
    told.saccade_timestamps = stamps(np.array([start for start, _, _ in looks(since_s, until_s)]))
    told.extra = [PhysioFeature(name=f"{name}_quality", values=[0.97]) for name in ("heog", "veog")]
    told.blink_rate_per_min, told.blink_duration_ms, told.saccade_rate_per_min = 60 / BLINK_EVERY_S, 250.0, 120.0
    return told


def closed(times_s: Signal) -> Signal:
    """Return where the eyes are shut."""
    return np.abs((times_s - BLINK_AFTER_S + BLINK_EVERY_S / 2) % BLINK_EVERY_S - BLINK_EVERY_S / 2) < BLINK_S / 2


def gaze(times_s: Signal) -> Signal:
    """From fixation to fixation; nothing while the eyes are shut."""
    found = noise(times_s, 2, 6)
    before = (960.0, 540.0)
    for start, x, y in looks(times_s[0] - 1, times_s[-1] + 1):
        way = np.clip((times_s - start) / SACCADE_S, 0, 1)[:, None]
        here = (times_s >= start) & (times_s < start + LOOK_S)
        found[here] += (np.array(before) + way * (np.array((x, y)) - before))[here]
        before = (x, y)
    found[closed(times_s)] = np.nan
    return np.column_stack((found, ~closed(times_s)))


def tell_gaze(since_s: float, until_s: float) -> EyeTracking:
    ended = looks(since_s - LOOK_S, until_s - LOOK_S)
    told = EyeTracking(fixation_timestamps=stamps(np.array([t + SACCADE_S for t, _, _ in ended])))
    told.fixation_durations_ms = [1000 * (LOOK_S - SACCADE_S)] * len(ended)
    told.saccade_timestamps = stamps(np.array([t for t, _, _ in looks(since_s, until_s)]))
    times = blinks(since_s - 0.3, until_s - 0.3)
    told.blink_timestamps, told.blink_durations_ms = stamps(times - BLINK_S / 2), [1000 * BLINK_S] * len(times)
    told.fixation_duration_ms, told.valid_ratio = 450.0, 0.93
    told.extra = [
        PhysioFeature(name="fixation_x", unit="px", values=[x for _, x, _ in ended]),
        PhysioFeature(name="fixation_y", unit="px", values=[y for _, _, y in ended]),
    ]
    return told


def pupil(times_s: Signal) -> Signal:
    """Both pupils, of which nothing is seen while the eyes are shut."""
    wide = 3.6 + 0.25 * np.sin(2 * np.pi * (times_s % 20) / 20)
    found = np.column_stack((wide, wide - 0.2)) + noise(times_s, 2, 0.015)
    found[closed(times_s)] = np.nan
    return np.column_stack((found, ~closed(times_s)))


def tell_pupil(since_s: float, until_s: float) -> Pupillometry:
    told = Pupillometry(unit="mm", diameter=3.6, change_percent=4.0, missing_ratio=0.07)
    ago = until_s - blinks(since_s - 0.3, until_s - 0.3)
    told.extra = [
        PhysioFeature(name="interpolated_begin_s", unit="s", values=(ago + BLINK_S / 2).tolist()),
        PhysioFeature(name="interpolated_end_s", unit="s", values=(ago - BLINK_S / 2).tolist()),
    ]
    return told


def tell_beats(message: type, delay_s: float) -> Callable[[float, float], Any]:
    def tell(since_s: float, until_s: float) -> Any:
        peaks = beats(since_s, until_s, BPM) + delay_s
        return message(peak_timestamps=stamps(peaks), heart_rate_bpm=BPM, rr_interval_ms=60_000 / BPM)

    return tell


def tell_motion(since_s: float, until_s: float) -> Motion:
    return Motion(intensity_m_per_s2=0.4 + 0.3 * np.sin(until_s / 3), posture="sitting")


NINE = (
    Kind("ecg", 130.0, "uV", ("ecg",), lambda t: ecg_uv(t, BPM)[:, None], tell_beats(ECG, 0.0)),
    Kind(
        "ppg", 55.0, "counts", ("ppg_0",), lambda t: ppg_counts(t, BPM)[:, None], tell_beats(PPG, PULSE_DELAY_S + 0.1)
    ),
    Kind("respiration", 25.0, "a.u.", ("respiration",), respiration, tell_respiration),
    Kind("eda", 16.0, "uS", ("eda",), eda, tell_eda),
    Kind("emg", 500.0, "uV", tuple(BURSTS), emg, tell_emg),
    Kind("eeg", 250.0, "uV", tuple(CAP), eeg, tell_eeg),
    Kind("eog", 250.0, "uV", ("heog", "veog"), eog, tell_eog),
    Kind("eye_tracking", 120.0, "px", ("gaze_x", "gaze_y", "confidence"), gaze, tell_gaze),
    Kind("pupillometry", 120.0, "mm", ("diameter_left", "diameter_right", "confidence"), pupil, tell_pupil),
    Kind("accelerometer", 50.0, "m/s^2", ("x", "y", "z"), acceleration, tell_motion),
)
