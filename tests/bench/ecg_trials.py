"""Test signals of which the truth is known: hearts of every kind, and what is laid over them. Pure: numpy and scipy.

Amplitudes in uV, times in s, shape (n,) throughout. A wave is 1 mV high unless said otherwise.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfiltfilt

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

R_UV = 1000.0


class Rhythm(NamedTuple):
    """The beats of a heart: when, and which of them the sinus node began."""

    beats_s: Floats
    normal: Bools

    def until(self, end_s: float) -> "Rhythm":
        """Its beats before end_s."""
        return Rhythm(self.beats_s[self.beats_s < end_s], self.normal[self.beats_s < end_s])


def heartbeat(t_s: Floats, qrs_s: float = 0.012, t_wave: float = 0.25, p_wave: float = 0.1) -> Floats:
    """One normal beat round its R peak at 0: P, Q, R, S and T, amplitude 1."""
    wave = np.exp(-0.5 * (t_s / qrs_s) ** 2)
    wave -= 0.15 * np.exp(-0.5 * ((t_s + 2.5 * qrs_s) / qrs_s) ** 2)
    wave -= 0.25 * np.exp(-0.5 * ((t_s - 2.5 * qrs_s) / qrs_s) ** 2)
    wave += p_wave * np.exp(-0.5 * ((t_s + 0.16) / 0.02) ** 2)
    return wave + t_wave * np.exp(-0.5 * ((t_s - 0.28) / 0.05) ** 2)


def ventricular(t_s: Floats) -> Floats:
    """One wide beat without a P wave, its T wave discordant."""
    return 1.5 * np.exp(-0.5 * (t_s / 0.035) ** 2) - 0.7 * np.exp(-0.5 * ((t_s - 0.25) / 0.06) ** 2)


def resting(seconds: float, seed: int = 2, rr_s: float = 0.77) -> Rhythm:
    """A person at rest: breathing at 0.25 Hz, slow waves, some noise; RMSSD about 27 ms."""
    random = np.random.default_rng(seed)
    beats = [0.5]
    while beats[-1] < seconds - 0.2:
        t_s = beats[-1]
        rr = rr_s + 0.022 * np.sin(2 * np.pi * 0.25 * t_s) + 0.02 * np.sin(2 * np.pi * 0.1 * t_s)
        beats.append(t_s + rr + 0.008 * random.standard_normal())
    beats_s = np.array(beats[:-1])
    return Rhythm(beats_s, np.ones(len(beats_s), bool))


def regular(rate_bpm: float, seconds: float) -> Rhythm:
    """A heart like a clock."""
    beats_s = np.arange(0.5, seconds - 0.2, 60 / rate_bpm)
    return Rhythm(beats_s, np.ones(len(beats_s), bool))


def with_premature(rhythm: Rhythm, share: float, seed: int = 3) -> Rhythm:
    """That share of the beats comes 25 to 45 % early and is ventricular; a compensatory pause follows."""
    random = np.random.default_rng(seed)
    beats_s, normal = rhythm.beats_s.copy(), rhythm.normal.copy()
    while np.mean(~normal) < share:
        i = int(random.integers(10, len(beats_s) - 2))
        if normal[i - 1 : i + 2].all():
            beats_s[i] -= random.uniform(0.25, 0.45) * (beats_s[i] - beats_s[i - 1])
            normal[i] = False
    return Rhythm(beats_s, normal)


def every(rhythm: Rhythm, n: int) -> Rhythm:
    """Every n-th beat is a ventricular one, early by 35 %: n is 2 in bigeminy, 3 in trigeminy."""
    beats_s, normal = rhythm.beats_s.copy(), rhythm.normal.copy()
    at = np.arange(n, len(beats_s) - 1, n)
    beats_s[at] -= 0.35 * (beats_s[at] - beats_s[at - 1])
    normal[at] = False
    return Rhythm(beats_s, normal)


def fibrillation(seconds: float, seed: int = 4) -> Rhythm:
    """Atria in fibrillation: normal complexes, intervals without order."""
    random = np.random.default_rng(seed)
    beats_s = 0.5 + np.cumsum(np.clip(random.gamma(16, 0.7 / 16, int(3 * seconds)), 0.32, 1.6))
    beats_s = beats_s[beats_s < seconds - 0.2]
    return Rhythm(beats_s, np.ones(len(beats_s), bool))


def flutter_waves(n: int, fs_hz: float, seed: int, amplitude_uv: float = 80.0) -> Floats:
    """The f waves of atria in fibrillation, 4 to 8 Hz."""
    return amplitude_uv * _band(np.random.default_rng(seed).standard_normal(n), 4.0, 8.0, fs_hz)


def ecg_of(
    rhythm: Rhythm, fs_hz: float, seconds: float, noise_uv: float = 10.0, qrs_s: float = 0.012, p_wave: float = 0.1
) -> Floats:
    """The ECG of a heart with R peaks at exactly beats_s, white noise in it; amplitudes vary with breathing by 5 %."""
    t_s = np.arange(round(seconds * fs_hz)) / fs_hz
    ecg = np.random.default_rng(1).normal(0, noise_uv, len(t_s))
    for beat, is_normal in zip(rhythm.beats_s, rhythm.normal, strict=True):
        near = slice(max(round((beat - 0.6) * fs_hz), 0), round((beat + 0.6) * fs_hz))
        offset_s = t_s[near] - beat
        height = R_UV * (1 + 0.05 * np.sin(2 * np.pi * 0.25 * beat))
        ecg[near] += height * (heartbeat(offset_s, qrs_s, p_wave=p_wave) if is_normal else ventricular(offset_s))
    return ecg


def low_inverted(rhythm: Rhythm, fs_hz: float, seconds: float, p_wave: float = 0.9) -> Floats:
    """A lead that sees little of the QRS, and from below: 0.2 mV, the P wave nearly as tall, the T wave taller.

    It wanders by 1 mV at 0.13 and 0.4 Hz.
    """
    t_s = np.arange(round(seconds * fs_hz)) / fs_hz
    ecg = np.random.default_rng(4).normal(0, 10, len(t_s))
    ecg += 500 * (np.sin(2 * np.pi * 0.13 * t_s) + np.sin(2 * np.pi * 0.4 * t_s + 1))
    for beat in rhythm.beats_s:
        near = slice(max(round((beat - 0.6) * fs_hz), 0), round((beat + 0.6) * fs_hz))
        offset_s = t_s[near] - beat
        wave = 0.2 * np.exp(-0.5 * ((offset_s + 0.03) / 0.012) ** 2) - np.exp(-0.5 * (offset_s / 0.012) ** 2)
        wave += p_wave * np.exp(-0.5 * ((offset_s + 0.24) / 0.023) ** 2)
        ecg[near] += 0.2 * R_UV * (wave + 1.4 * np.exp(-0.5 * ((offset_s - 0.28) / 0.05) ** 2))
    return ecg


def electrode_motion(n: int, fs_hz: float, seed: int = 1) -> Floats:
    """Noise of unit power like that of moving electrodes: 3-6 Hz in bursts, with steps as steep as a QRS."""
    random = np.random.default_rng(seed)
    wander = _band(random.standard_normal(n), 0.4, 3.0, fs_hz)
    shake = _band(random.standard_normal(n), 3.0, 6.0, fs_hz)
    loudness = np.exp(0.9 * _band(random.standard_normal(n), 0.02, 0.3, fs_hz))
    steps = np.where(random.random(n) < 0.6 / fs_hz, random.standard_normal(n), 0.0)
    steps = sosfilt(butter(1, (0.5, 14), "bandpass", fs=fs_hz, output="sos"), steps)
    noise = (0.7 * wander + shake) * loudness + 0.8 * steps / steps.std()
    return np.asarray(noise / noise.std())


def _band(white: Floats, low_hz: float, high_hz: float, fs_hz: float) -> Floats:
    noise = sosfiltfilt(butter(2, (low_hz, high_hz), "bandpass", fs=fs_hz, output="sos"), white)
    return np.asarray(noise / noise.std())


def at_snr(noise: Floats, snr_db: float, qrs_uv: float = 1.25 * R_UV) -> Floats:
    """Noise of unit power at the ratio of the MIT noise stress test (Moody 1984): (peak to peak of QRS)^2 / 8."""
    return noise * qrs_uv / np.sqrt(8 * 10 ** (snr_db / 10))


def hum(n: int, fs_hz: float, hz: float, amplitude_uv: float = 500.0) -> Floats:
    """Mains, its frequency wandering by 0.02 Hz and its amplitude by a tenth."""
    t_s = np.arange(n) / fs_hz
    phase = 2 * np.pi * hz * t_s + 0.02 * 20 * np.sin(2 * np.pi * t_s / 20)
    return amplitude_uv * (1 + 0.1 * np.sin(2 * np.pi * t_s / 7)) * np.sin(phase + 0.3)


def sine(n: int, fs_hz: float, hz: float, amplitude_uv: float = R_UV, noise_uv: float = 10.0) -> Floats:
    """A sine with a little white noise."""
    white = np.random.default_rng(5).normal(0, noise_uv, n)
    return white + amplitude_uv * np.sin(2 * np.pi * hz * np.arange(n) / fs_hz)


def pops(
    n: int, fs_hz: float, per_s: float = 1.2, amplitude_uv: float = R_UV, noise_uv: float = 10.0, wide: int = 1
) -> Floats:
    """Samples far off, so many in a row, at an even pace; no heart."""
    ecg = np.random.default_rng(6).normal(0, noise_uv, n)
    begins = np.rint(np.arange(0.3, n / fs_hz - 0.1, 1 / per_s) * fs_hz).astype(int)
    for i in range(wide):
        ecg[begins + i] += amplitude_uv
    return ecg


def pacing_spikes(n: int, fs_hz: float, per_s: float = 1.17, amplitude_uv: float = 2 * R_UV) -> Floats:
    """Pulses of a pacemaker of 1 ms, seen through the band of the device, with a small tail; the heart stands still."""
    fine = 8
    wide = np.zeros(n * fine)
    wide[np.rint(np.arange(0.3, n / fs_hz - 0.1, 1 / per_s) * fs_hz * fine).astype(int)] = fine
    spikes = sosfilt(butter(2, min(0.4 * fs_hz, 100.0), fs=fine * fs_hz, output="sos"), wide)
    tail = sosfilt(butter(1, 8.0, fs=fine * fs_hz, output="sos"), wide)
    spikes = spikes / spikes.max() - 0.05 * tail / tail.max()
    return np.asarray(amplitude_uv * spikes[::fine] + np.random.default_rng(7).normal(0, 10, n))


def tremor(n: int, fs_hz: float, hz: float = 5.0, amplitude_uv: float = R_UV) -> Floats:
    """A trembling hand: nearly a sine, with a second harmonic, its strength and pace wandering."""
    random = np.random.default_rng(8)
    pace = hz * (1 + 0.02 * _band(random.standard_normal(n), 0.05, 0.5, fs_hz))
    phase = 2 * np.pi * np.cumsum(pace) / fs_hz
    strength = 1 + 0.15 * _band(random.standard_normal(n), 0.05, 0.5, fs_hz)
    return amplitude_uv * strength * (np.sin(phase) + 0.3 * np.sin(2 * phase + 0.5))


def nobody(n: int, fs_hz: float) -> dict[str, Floats]:
    """What is no heart: noises of every colour, and things that are periodic."""
    white = np.random.default_rng(1).normal(0, 100, n)
    shape = np.maximum(np.fft.rfftfreq(n, 1 / fs_hz), 0.05) ** -0.5
    pink = np.fft.irfft(np.fft.rfft(white) * shape, n)
    bursts = np.exp(_band(np.random.default_rng(9).standard_normal(n), 0.1, 1.0, fs_hz))
    return {
        "white noise": white,
        "pink noise": 100 * pink / pink.std(),
        "noise of 5 to 25 Hz": 100 * _band(white, 5.0, 25.0, fs_hz),
        "muscles": 100 * _band(white, 15.0, 0.45 * fs_hz, fs_hz) * bursts,
        "electrode motion alone": 100 * electrode_motion(n, fs_hz),
        "sine of 5 Hz": sine(n, fs_hz, 5.0),
        "sine of 8 Hz": sine(n, fs_hz, 8.0),
        "pops": pops(n, fs_hz),
        "pops of 30 ms": pops(n, fs_hz, wide=round(0.03 * fs_hz)),
        "pacing without capture": pacing_spikes(n, fs_hz),
        "tremor": tremor(n, fs_hz),
    }
