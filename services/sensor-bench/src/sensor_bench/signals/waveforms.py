"""One heartbeat as neurokit2 simulates it: the shapes that the signal sources repeat.

They are kept in `waveforms.json`, because importing neurokit2 takes seconds and 240 MB; the file is written anew by
`python -m sensor_bench.signals.waveforms`.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FS_HZ = 1000
FILE = Path(__file__).with_name("waveforms.json")


class Waveforms(NamedTuple):
    """Sampled at `FS_HZ`, made at 60 beats per minute."""

    ecg: FloatArray
    """One beat, R peak of height 1 at `ecg_peak`, zero at both ends."""
    ecg_peak: float
    """Position of the R peak's maximum, in samples (with fraction)."""
    ppg: FloatArray
    """One pulse from foot to foot, 0 at both ends, 1 at the systolic peak."""
    ppg_peak: float
    """Position of the systolic peak, in samples (with fraction)."""


def parabolic_peak(values: FloatArray, at: int) -> float:
    """Position of the maximum of the parabola through the samples at - 1, at, at + 1."""
    before, here, after = values[at - 1 : at + 2]
    return at + 0.5 * float(before - after) / float(before - 2 * here + after)


def from_simulations(ecg: FloatArray, ppg: FloatArray) -> Waveforms:
    """Cut one period out of two long simulations with exactly one beat per second."""
    period = FS_HZ
    r_peak = 3 * period + int(np.argmax(ecg[3 * period : 4 * period]))
    before, after = round(0.35 * period), round(0.6 * period)
    beat = ecg[r_peak - before : r_peak + after].astype(np.float64)
    beat -= np.linspace(beat[0], beat[-1], beat.size)
    fade = round(0.06 * period)
    edge = 0.5 - 0.5 * np.cos(np.pi * np.arange(fade) / fade)
    beat[:fade] *= edge
    beat[-fade:] *= edge[::-1]
    beat /= beat.max()

    foot = 3 * period + int(np.argmin(ppg[3 * period : 4 * period]))
    pulse = ppg[foot : foot + period + 1].astype(np.float64)
    pulse -= np.linspace(pulse[0], pulse[-1], pulse.size)
    pulse /= pulse.max()
    peaks = int(np.argmax(beat)), int(np.argmax(pulse))
    return Waveforms(beat, parabolic_peak(beat, peaks[0]), pulse, parabolic_peak(pulse, peaks[1]))


def simulate(seed: int = 1) -> Waveforms:
    """Make the waveforms with neurokit2 (McSharry's ECGSYN, and its PPG model), free of noise and variability."""
    import neurokit2 as nk

    ecg = nk.ecg_simulate(
        duration=10, sampling_rate=FS_HZ, noise=0, heart_rate=60, heart_rate_std=0, method="ecgsyn", random_state=seed
    )
    ppg = nk.ppg_simulate(
        duration=10,
        sampling_rate=FS_HZ,
        heart_rate=60,
        frequency_modulation=0,
        ibi_randomness=0,
        drift=0,
        motion_amplitude=0,
        powerline_amplitude=0,
        burst_number=0,
        random_state=seed,
    )
    return from_simulations(np.asarray(ecg, dtype=np.float64), np.asarray(ppg, dtype=np.float64))


def stored() -> Waveforms:
    """The waveforms of the package."""
    found = json.loads(FILE.read_text())
    return Waveforms(np.array(found["ecg"]), found["ecg_peak"], np.array(found["ppg"]), found["ppg_peak"])


def main() -> None:
    """Simulate, and store to the sixth decimal."""
    made = {name: np.round(value, 6).tolist() for name, value in simulate()._asdict().items()}
    FILE.write_text(json.dumps(made) + "\n")


if __name__ == "__main__":
    main()
