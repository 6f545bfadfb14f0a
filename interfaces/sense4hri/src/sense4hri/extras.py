"""What is in `extra` of our messages: a sentence for every name, as a codebook tells it. Imports no ROS.

What has no field of its own has no comment in a message definition either. Units are told by the messages themselves.
"""

from fnmatch import fnmatchcase

OTHER = "a value without a field of its own"
_ANY = {"source_*": "the stream that this one is computed from, by its name; the value is its declared rate"}
_OF_MESSAGE: dict[str, dict[str, str]] = {
    "ECG": {
        "r_amplitude": "median height of the R peaks over their surroundings",
        "ectopic_percent": "share of beats that are not normal, among those of known kind in hrv_window_s",
    },
    "EDA": {
        "scr_threshold": "least amplitude of a response in force; never below noise and resolution",
        "tonic_now": "the tonic line at the newest sample",
    },
    "Respiration": {
        "autocorrelation_rate": "breaths per minute by autocorrelation, that the peaks are checked against",
        "likeness": "correlation of what intervals and QRS complexes show of breathing; an ECG's alone",
        "rhythm": "how alike the wave of an ECG is one breath later",
    },
    "EMG": {
        "rest_rms": "level at rest of each channel",
        "mvc_rms": "100 % of mvc_percent of each channel: its greatest effort after a marker mvc",
    },
    "EEG": {
        "relative_*": "share of the band in all bands, of each channel",
        "alpha_peak": "frequency of the highest peak from 7 to 13 Hz, of the back of the head where it has electrodes",
        "theta_alpha_ratio_all": "theta over alpha of all electrodes",
        "alpha_asymmetry_*_*": "ln alpha power of the right electrode, named first, less ln of the left one",
        "blink_count": "blinks at the forehead within window_s",
        "blink_age": "of each blink within window_s, time from it to the newest sample",
        "pop_count": "electrode pops within window_s, of each channel",
        "muscle_segments": "segments within window_s that show muscle, of each channel",
        "excluded": "share of window_s left out of the band powers, of each channel",
        "mains_rms": "mains taken away, of each channel",
    },
    "EOG": {
        "heog_quality": "signal quality of the horizontal channel alone",
        "veog_quality": "signal quality of the vertical channel alone",
        "veog_polarity": "1, or -1 where blinks lower veog: its electrodes are swapped",
        "saccade_is_vertical": "1 for each of saccade_timestamps whose amplitude is that of veog, else 0",
    },
    "EyeTracking": {
        "fixation_x": "horizontal place of each of fixation_timestamps",
        "fixation_y": "vertical place of each of fixation_timestamps",
        "saccade_amplitudes": "amplitude of each of saccade_timestamps, in the unit of gaze",
        "saccade_peak_velocities": "greatest velocity of each of saccade_timestamps",
        "saccade_rate_per_min": "saccades within window_s per minute without a hole",
        "fixation_rate_per_min": "fixations within window_s per minute without a hole",
        "saccade_threshold": "velocity in force from which an eye makes a saccade; follows the noise",
        "precision": "noise of single samples",
        "entropy_cell": "width of the cells that gaze_entropy_bits counts on",
        "missing_samples": "samples that never came within window_s",
        "irregular_intervals": "times between samples within window_s that are not the usual one",
        "backward_stamps": "samples within window_s that were not newer than the newest one, left out",
        "dwell_*": "time within window_s that gaze was in the area of interest of this name",
    },
    "Pupillometry": {
        "interpolated_begin_s": "beginning of each gap drawn through since the message before, before device_timestamp",
        "interpolated_end_s": "end of each gap drawn through since the message before, before device_timestamp",
        "interpolated_gaps": "gaps drawn through within the last 60 s",
        "blink_gaps": "gaps longer than 75 ms drawn through within the last 60 s",
        "change_least": "least change within window_s",
        "change_most": "greatest change within window_s: the peak of a short response",
        "baseline_by_marker": "1 where markers have set the baseline, 0 where it is rolling",
        "lhipa": "low/high index of pupillary activity; falls with cognitive load",
        "backward_stamps": "samples since the message before that were not newer than the newest one, left out",
    },
    "Motion": {
        "steps_total": "steps since the segment began",
        "tilt": "angle from upright",
    },
    "UserState": {
        "heart_rate_ecg": "mean heart rate by ECG",
        "heart_rate_ppg": "mean heart rate by PPG",
        "heart_rate_baseline": "heart rate that the others are compared with",
    },
    "StreamHealth": {
        "undecodable_frames_total": "frames that could not be decoded, skipped",
        "impossible_device_times_total": "frames whose device time no message can carry",
        "impossible_values_total": "numbers beyond all bounds, passed on as NaN",
    },
}


def about(message: str, name: str) -> str:
    """Return what a name in `extra` of a message (`EEG`) means; OTHER where nobody here gives it."""
    told = _OF_MESSAGE.get(message, {}) | _ANY
    return next((text for pattern, text in told.items() if fnmatchcase(name, pattern)), OTHER)
