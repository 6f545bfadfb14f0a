"""Made PPG signals of which the truth is known: hearts, hum, tremor, and rhythms that are no heart. Pure."""

from typing import NamedTuple

import numpy as np
from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStream, PpgUpdate
from numpy.typing import NDArray
from scipy.signal import hilbert
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

Floats = NDArray[np.float64]
LEVEL, PULSE = 4e5, 3000.0  # counts
XYZ = ("x", "y", "z")


def rmssd_ms(beats_s: Floats) -> float:
    """Return the variability of the intervals between these times."""
    return float(np.sqrt(np.mean(np.diff(np.diff(beats_s) * 1e3) ** 2)))


class Heart(NamedTuple):
    """Times of beats, s; the rise of each pulse is a constant time later."""

    beats_s: Floats

    def rate_bpm(self, to_s: float, window_s: float = 10.0) -> float:
        """Return the mean rate over a window, NaN outside."""
        inside = np.diff(self.beats_s)[(self.beats_s[1:] <= to_s) & (self.beats_s[:-1] >= to_s - window_s)]
        return 60 / float(inside.mean()) if len(inside) else np.nan

    @property
    def rmssd_ms(self) -> float:
        """Return the variability of all intervals."""
        return rmssd_ms(self.beats_s)


class Premature(NamedTuple):
    """Beats of which some came early: times in s, the height of each pulse, RMSSD of what is normal to normal in ms."""

    beats_s: Floats
    heights: Floats
    rmssd_ms: float


def heart(duration_s: float, rate_bpm: float, rmssd_ms: float = 25.0, seed: int = 1) -> Heart:
    """Return beats with breathing and slow waves in their intervals, in the proportion of rest."""
    random = np.random.default_rng(seed)
    n = int(duration_s * rate_bpm / 60) + 20
    period_s = 60 / rate_bpm
    t = np.arange(n) * period_s
    waves = np.sin(2 * np.pi * 0.25 * t) + 0.7 * np.sin(2 * np.pi * 0.1 * t + 1) + 0.3 * random.normal(size=n)
    rr_s = period_s + waves * rmssd_ms / 1e3 / np.sqrt(np.mean(np.diff(waves) ** 2))
    beats_s = 0.3 + np.cumsum(rr_s)
    return Heart(beats_s[beats_s < duration_s + 2])


def pulses(
    heart: Heart | Premature,
    times_s: Floats,
    second: tuple[float, float, float] = (0.35, 0.47, 0.13),
    heights: Floats | float = 1.0,
) -> Floats:
    """Return a pulse wave of these heights at times_s; a fast heart's is shorter.

    second: the dicrotic wave's height, time and width in s; the first one's are 1, 0.2 and 0.085.
    """
    after = times_s[:, None] - heart.beats_s
    short = min(1.0, float(np.median(np.diff(heart.beats_s))) / 0.6)
    crest = np.exp(-0.5 * ((after - 0.2 * short) / (0.085 * short)) ** 2)
    height, at_s, width_s = second
    waves = crest + height * np.exp(-0.5 * ((after - at_s * short) / (width_s * short)) ** 2)
    return (heights * waves).sum(1)


def sine(frequency_hz: float, times_s: Floats) -> Floats:
    """Return a sine of amplitude 1."""
    return np.sin(2 * np.pi * frequency_hz * times_s)


def mains(frequency_hz: float, times_s: Floats, off_hz: float = 0.0, swing_hz: float = 0.02) -> Floats:
    """Return hum of amplitude 1, off_hz beside its frequency, which swings by swing_hz; its amplitude by a tenth."""
    phase = 2 * np.pi * (frequency_hz + off_hz) * times_s + 20 * swing_hz * np.sin(2 * np.pi * times_s / 20)
    return (1 + 0.1 * np.sin(2 * np.pi * times_s / 7)) * np.sin(phase + 0.3)


def tremor(frequency_hz: float, times_s: Floats, seed: int = 0) -> Floats:
    """Return a shaking of amplitude 1 whose rate and strength wander by a tenth."""
    random = np.random.default_rng(seed)
    step_s = float(times_s[1] - times_s[0])
    slow = np.convolve(random.normal(size=len(times_s)), np.hanning(int(2 / step_s)), "same")
    slow /= np.abs(slow).max()
    return (1 + 0.3 * slow) * np.sin(2 * np.pi * np.cumsum(frequency_hz * (1 + 0.1 * slow) * step_s))


def premature(
    duration_s: float, rate_bpm: float, share: float, early: float, height: float, seed: int = 1
) -> Premature:
    """Return a heart of which a share of the beats comes after `early` of an interval, and the next one in its time.

    height: of the pulses of these beats; that after each, for which the heart had more time to fill, is 1.2 high.
    """
    beats_s, random = heart(duration_s, rate_bpm, seed=seed).beats_s, np.random.default_rng(seed)
    is_early = np.zeros(len(beats_s), bool)
    for i in range(3, len(beats_s) - 1):
        is_early[i] = random.random() < share and not is_early[i - 2 : i].any()
    times_s, heights = beats_s.copy(), np.where(is_early, height, 1.0)
    times_s[is_early] = (beats_s[:-1] + early * np.diff(beats_s))[is_early[1:]]
    heights[1:][is_early[:-1]] = 1.2
    differences_ms, whole = np.diff(times_s, 2) * 1e3, ~(is_early[2:] | is_early[1:-1] | is_early[:-2])
    return Premature(times_s, heights, float(np.sqrt(np.mean(differences_ms[whole] ** 2))))


def play(
    samples: Floats, fs_hz: float, frame: int = 11, nominal_hz: float | None = None, moved: Floats | None = None
) -> list[PpgUpdate]:
    """Return every update of one channel of counts, device stamps to the ns; moved: m/s^2 beside them, shape (n, 3)."""
    nominal_hz = fs_hz if nominal_hz is None else nominal_hz
    info = StreamInfo(StreamName("p1", "ppg", "s1"), nominal_hz, "counts", ("ppg_0",))
    clock, step, updates = SampleClock(nominal_hz), PpgStream(Config(), info), []
    beside, beside_clock = StreamInfo(StreamName("p1", "accelerometer", "s1"), fs_hz, "m/s^2", XYZ), SampleClock(fs_hz)
    for start in range(0, len(samples) - frame + 1, frame):
        stamp_ns = round((start + frame - 1) / fs_hz * 1e9) + 10**15
        if moved is not None:
            acceleration = Chunk(XYZ, moved[start : start + frame], stamp_ns, stamp_ns)
            step.evidence(beside, beside_clock.place(acceleration))
        updates += step.push(clock.place(Chunk(("ppg_0",), samples[start : start + frame, None], stamp_ns, stamp_ns)))
    return updates


def white(times_s: Floats) -> Floats:
    """Return white noise of unit power."""
    return np.random.default_rng(3).normal(size=len(times_s))


def bursts(times_s: Floats, seed: int = 0) -> Floats:
    """Return noise of unit power like that of a moving hand: 0.5 to 5 Hz, swelling and ebbing within seconds."""
    random, step_s = np.random.default_rng(seed), float(times_s[1] - times_s[0])
    spectrum, hz = np.fft.rfft(random.normal(size=len(times_s))), np.fft.rfftfreq(len(times_s), step_s)
    noise = np.fft.irfft(np.where((hz > 0.5) & (hz < 5), spectrum, 0), len(times_s))
    slow = np.convolve(random.normal(size=len(times_s)), np.hanning(int(4 / step_s)), "same")
    noise *= np.exp(1.2 * slow / slow.std())
    return noise / noise.std()


def walking(hz: float, times_s: Floats, seed: int = 0) -> Floats:
    """Return the artefact of steps, peak to peak 1, whose pace wanders by 3 % and strength by 40 %."""
    random, step_s = np.random.default_rng(seed), float(times_s[1] - times_s[0])
    pace, strength = (
        np.convolve(random.normal(size=len(times_s)), np.hanning(int(span_s / step_s)), "same") for span_s in (4, 3)
    )
    phase = 2 * np.pi * np.cumsum(hz * (1 + 0.03 * pace / np.abs(pace).max()) * step_s)
    steps = np.sin(phase) + 0.4 * np.sin(2 * phase + 1) + 0.15 * np.sin(3 * phase + 2)
    return (1 + 0.4 * strength / np.abs(strength).max()) * steps / np.ptp(steps)


def acceleration(hz: float, times_s: Floats, seed: int = 0, strength_m_s2: float = 4.0) -> Floats:
    """Return what an accelerometer at the arm measures of `walking`: the steps, the arm at half their rate, noise."""
    random, steps = np.random.default_rng(seed + 1), walking(hz, times_s, seed)
    half = np.sin(np.unwrap(np.angle(hilbert(steps))) / 2)
    axes = np.outer(steps, (0.3, 1.0, 0.5)) + np.outer(half, (0.3, 0.0, 0.1))
    return strength_m_s2 * axes + (0, 9.81, 0) + 0.05 * random.normal(size=(len(times_s), 3))


def seen_s(updates: list[PpgUpdate]) -> Floats:
    """Return the times of all published pulses, s."""
    return np.array([(time_ns - 10**15) / 1e9 for update in updates for time_ns in update.peak_timestamps])


def end_s(update: PpgUpdate) -> float:
    """Return the newest sample's time, s."""
    return ((update.device_ns or 0) - 10**15) / 1e9


def jitter_ms(found: Floats, heart: Heart, within_s: float = 0.1) -> float:
    """Return the spread of pulses found, s, about a constant lag, ms; NaN where a tenth of them is farther off."""
    found = found[found > 5]
    if len(found) < 5:
        return np.nan
    at = np.clip(np.searchsorted(heart.beats_s, found) - 1, 0, len(heart.beats_s) - 1)
    lag = found - heart.beats_s[at]
    near = np.abs(lag - np.median(lag)) < within_s
    return float(np.std(lag[near])) * 1e3 if near.mean() > 0.9 else np.nan


def confident(updates: list[PpgUpdate], quality: float = 0.0) -> list[PpgUpdate]:
    """Return the updates that give a rate at this quality or better."""
    return [update for update in updates if np.isfinite(update.heart_rate_bpm) and update.signal_quality >= quality]
