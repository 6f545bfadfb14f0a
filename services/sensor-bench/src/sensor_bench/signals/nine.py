"""A minute of one participant, nine modalities and an accelerometer, with known truth, as files for `driver-file`.

    python -m sensor_bench.signals.nine compose/studies/nine-modalities

`body.hea` and `body.dat` are a WFDB record of an amplifier, `gaze.csv` an eye tracker's table, `truth.json` what is in
them. The minute ends as it begins, so that it can be played over and over without a seam.
"""

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sensor_bench.signals.playback import RecordedHeart
from sensor_bench.signals.sources import EcgSource, PpgSource, Wearing
from sensor_bench.signals.waveforms import FloatArray, stored

SECONDS = 60
BEATS, BREATHS, SWING = 66, 15, 0.04  # in the minute; how much breathing moves a beat, in s
R_SWING, TILT_M_PER_S2 = 0.07, 0.17  # with the breath: R higher and lower by this share, the chest tilted by a degree
BURSTS_S = ((10.0, 13.0), (30.0, 34.0), (50.0, 52.0))
RESPONSES = ((8.0, 0.5), (23.0, 0.4), (41.0, 0.6))  # onset in s and amplitude in uS
STEPS_S, STEP_HZ = (42.0, 52.0), 1.8
BLINKS_S = (5.0, 12.5, 21.0, 29.5, 37.0, 46.5, 55.0)
BLINK_S, PUPIL_MM, DILATIONS = 0.2, 3.5, ((15.0, 0.3), (40.0, 0.4))
FIXATION_S, SACCADE_S, GAZE_HZ = 0.75, 0.04, 120
EOG_UV_PER_DEG = 15.0
ELECTRODES = ("Fp1", "Fp2", "F3", "F4", "Cz", "Pz", "O1", "O2")
ALPHA_UV = (2.0, 2.0, 4.0, 4.0, 6.0, 12.0, 20.0, 20.0)


class Track(NamedTuple):
    """A signal of the record: samples a second, unit, counts a unit, value of the count 0, and its values."""

    per_s: int
    unit: str
    gain: float
    middle: float
    values: FloatArray


def tracks() -> dict[str, Track]:
    """Return the signals of the amplifier by name."""
    heart = RecordedHeart(beats_s(), SECONDS)
    wearing, waves = Wearing(), stored()
    ecg = EcgSource(heart, wearing, waves, seed=1).read(0, 250 * SECONDS, 250).astype(np.float64)
    ppg = PpgSource(heart, wearing, waves, seed=2).read(0, 55 * SECONDS, 55).astype(np.float64)
    found = {"ecg": Track(250, "uV", 10, 0, ecg[:, 0] * (1 - R_SWING * np.cos(_phase(_times(250)))))}
    found |= {f"ppg_{i}": Track(55, "counts", 1, PpgSource.BASE[i], ppg[:, i]) for i in range(3)}
    found["ambient"] = Track(55, "counts", 1, PpgSource.BASE[3], ppg[:, 3])
    found["eda"] = Track(10, "uS", 1000, 0, _eda(_times(10)))
    found["respiration"] = Track(25, "a.u.", 1000, 0, -np.cos(_phase(_times(25))))
    found["biceps"] = Track(1000, "uV", 10, 0, _emg(_times(1000)))
    found |= {name: Track(250, "uV", 10, 0, values) for name, values in _eeg(_times(250)).items()}
    gaze = gaze_deg(_times(125))
    found["heog"] = Track(125, "uV", 10, 0, EOG_UV_PER_DEG * gaze[:, 0] + _noise(3, 125, 4.0))
    found["veog"] = Track(
        125, "uV", 10, 0, EOG_UV_PER_DEG * gaze[:, 1] + 250 * _lids(_times(125)) + _noise(4, 125, 4.0)
    )
    return found | {f"acc_{axis}": Track(50, "m/s^2", 1000, 0, values) for axis, values in _motion(_times(50)).items()}


def beats_s() -> FloatArray:
    """Return the R peaks: evenly through the minute, each moved by the breath it falls into."""
    even_s = (np.arange(BEATS) + 0.5) * SECONDS / BEATS
    return even_s + SWING * np.sin(_phase(even_s))


def truth() -> dict[str, Any]:
    """Return what is in the files, in s from their beginning."""
    return {
        "seconds": SECONDS,
        "heart_rate_bpm": BEATS * 60 / SECONDS,
        "r_peaks_s": np.round(beats_s(), 4).tolist(),
        "breaths_per_min": BREATHS * 60 / SECONDS,
        "scr": [{"onset_s": at_s, "amplitude_us": height} for at_s, height in RESPONSES],
        "emg_bursts_s": [list(burst) for burst in BURSTS_S],
        "alpha_hz": 10,
        "blinks_s": list(BLINKS_S),
        "saccades_s": np.round(saccades_s(), 4).tolist(),
        "pupil_mm": PUPIL_MM,
        "dilations": [{"onset_s": at_s, "height_mm": height} for at_s, height in DILATIONS],
        "steps": {"from_s": STEPS_S[0], "to_s": STEPS_S[1], "per_min": 60 * STEP_HZ},
    }


def saccades_s() -> FloatArray:
    """Return the onsets of saccades: every fixation ends with one."""
    return np.asarray(np.arange(1, round(SECONDS / FIXATION_S) + 1) * FIXATION_S - SACCADE_S, np.float64)


def gaze_deg(times_s: FloatArray) -> FloatArray:
    """Return horizontal and vertical gaze, shape (n, 2), in degrees: fixations, and between them a swift turn."""
    count = round(SECONDS / FIXATION_S)
    targets = np.random.default_rng(5).uniform((-12, -8), (12, 8), (count, 2))
    number = (times_s // FIXATION_S).astype(int) % count
    turned = np.clip((times_s % FIXATION_S - (FIXATION_S - SACCADE_S)) / SACCADE_S, 0, 1)
    smooth = (3 * turned**2 - 2 * turned**3)[:, None]
    return np.asarray(targets[number] * (1 - smooth) + targets[(number + 1) % count] * smooth)


def gaze_table() -> list[str]:
    """Return the eye tracker's rows; where a lid is down its columns are empty and the confidence is 0."""
    times_s = _times(GAZE_HZ)
    gaze = gaze_deg(times_s) + np.random.default_rng(6).normal(0, 0.02, (len(times_s), 2))
    pupils = pupil_mm(times_s)[:, None] + np.random.default_rng(7).normal(0, 0.005, (len(times_s), 2))
    rows = ["time_s,gaze_x,gaze_y,confidence,diameter_left,diameter_right"]
    for at_s, (x, y), (left, right), covered in zip(times_s, gaze, pupils, shut(times_s), strict=True):
        seen = ",,0.0,," if covered else f"{x:.3f},{y:.3f},1.0,{left:.3f},{right:.3f}"
        rows.append(f"{at_s:.5f},{seen}")
    return rows


def pupil_mm(times_s: FloatArray) -> FloatArray:
    """Return the size of the pupils: at rest, and its dilations, over and over."""
    return np.asarray(PUPIL_MM + sum(height * _response(times_s - at_s, 1.5, 0.6) for at_s, height in DILATIONS))


def shut(times_s: FloatArray) -> Any:
    """Return where the pupil is covered, over and over."""
    return np.any([np.abs(times_s % SECONDS - at_s) < BLINK_S / 2 for at_s in BLINKS_S], axis=0)


def write(folder: Path) -> None:
    """Write the record, the table and the truth."""
    found = tracks()
    stored_counts = [_counts(track).reshape(SECONDS, track.per_s) for track in found.values()]
    (folder / "body.dat").write_bytes(np.hstack(stored_counts).astype("<i2").tobytes())
    lines = [f"body {len(found)} 1 {SECONDS}"]
    for name, track in found.items():
        zero = round(-track.middle * track.gain)
        lines.append(f"body.dat 16x{track.per_s} {track.gain:g}({zero})/{track.unit} 16 0 0 0 0 {name}")
    (folder / "body.hea").write_text("\n".join(lines) + "\n")
    (folder / "gaze.csv").write_text("\n".join(gaze_table()) + "\n")
    (folder / "truth.json").write_text(json.dumps(truth(), indent=1) + "\n")


def _counts(track: Track) -> FloatArray:
    return np.clip(np.rint((track.values - track.middle) * track.gain), -32767, 32767)


def _times(per_s: int) -> FloatArray:
    return np.arange(per_s * SECONDS) / per_s


def _noise(seed: int, per_s: int, level: float) -> FloatArray:
    return np.random.default_rng(seed).normal(0, level, per_s * SECONDS)


def _phase(times_s: FloatArray) -> FloatArray:
    """Return how far each breath is, in radians; 0 at its beginning, pi at the end of the inspiration."""
    return np.asarray(2 * np.pi * BREATHS / SECONDS * times_s)


def _response(after_s: FloatArray, decay_s: float, rise_s: float) -> FloatArray:
    """Return a rise and decay of height 1 that begins at 0, going round with the minute."""
    after_s = after_s % SECONDS
    shape = np.exp(-after_s / decay_s) - np.exp(-after_s / rise_s)
    peak_s = np.log(decay_s / rise_s) * decay_s * rise_s / (decay_s - rise_s)
    return np.asarray(shape / (np.exp(-peak_s / decay_s) - np.exp(-peak_s / rise_s)))


def _eda(times_s: FloatArray) -> FloatArray:
    tonic = 5 + 0.2 * np.sin(2 * np.pi * times_s / SECONDS)
    responses = sum(height * _response(times_s - at_s, 3.0, 0.7) for at_s, height in RESPONSES)
    return np.asarray(tonic + responses)


def _within(times_s: FloatArray, begin_s: float, end_s: float, edge_s: float) -> FloatArray:
    """Return 1 between the two, 0 outside, with soft edges."""
    return np.clip((times_s - begin_s) / edge_s, 0, 1) * np.clip((end_s - times_s) / edge_s, 0, 1)


def _emg(times_s: FloatArray) -> FloatArray:
    """Return muscle noise of 40 to 250 Hz: 4 uV at rest, 120 uV in a burst."""
    level = 4 + 116 * sum(_within(times_s, *burst, 0.05) for burst in BURSTS_S)
    return np.asarray(level * _band(8, len(times_s), 40, 250))


def _band(seed: int, length: int, low_hz: float, high_hz: float, power: float = 0.0) -> FloatArray:
    """Return noise of unit variance between two frequencies, its power falling with that power of the frequency."""
    hz = np.fft.rfftfreq(length, SECONDS / length)
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(length))
    inside = (hz >= low_hz) & (hz <= high_hz)
    spectrum[~inside] = 0
    spectrum[inside] *= hz[inside] ** (-power / 2)
    noise = np.fft.irfft(spectrum, length)
    return np.asarray(noise / noise.std())


def _eeg(times_s: FloatArray) -> dict[str, FloatArray]:
    """Return a spectrum that falls with the frequency, alpha at the back, blinks at the front."""
    alpha = np.sqrt(2) * np.sin(2 * np.pi * 10 * times_s) * (1 + 0.5 * np.sin(2 * np.pi * times_s / 4))
    lids = 90 * _lids(times_s)
    return {
        name: 8 * _band(20 + i, len(times_s), 0.5, 100, 1.0) + ALPHA_UV[i] * alpha + lids * (1.0, 0.3)[i > 1] * (i < 4)
        for i, name in enumerate(ELECTRODES)
    }


def _lids(times_s: FloatArray) -> FloatArray:
    """Return how far the lids are down, 0 to 1."""
    return np.asarray(sum(np.exp(-0.5 * ((times_s - at_s) / (BLINK_S / 3)) ** 2) for at_s in BLINKS_S))


def _motion(times_s: FloatArray) -> dict[str, FloatArray]:
    """Return somebody upright who breathes, and walks for a while."""
    walking = _within(times_s, *STEPS_S, 0.5) * np.sin(2 * np.pi * STEP_HZ * times_s)
    breath = TILT_M_PER_S2 * np.cos(_phase(times_s))
    return {
        "x": 0.3 + _noise(9, 50, 0.02),
        "y": 9.8 + 1.5 * walking + _noise(10, 50, 0.02),
        "z": 0.5 + breath + 0.5 * walking + _noise(11, 50, 0.02),
    }


if __name__ == "__main__":
    write(Path(sys.argv[1]))
