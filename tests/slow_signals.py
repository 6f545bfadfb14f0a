"""Slow signals with known truth, and recordings, played through an interpreter's step without a graph."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

Floats = NDArray[np.float64]
T0_NS = 10**18
PHYSIOKIT_HZ = {"P11_baseline_1675943915_070305": 275.16, "P12_baseline_1675943910_462031": 258.83}


def skin(
    seconds: float,
    fs_hz: float,
    onsets_s: Iterable[float],
    amplitudes_us: Iterable[float],
    tonic_us: float = 5.0,
    drift_us_per_min: float = 0.1,
) -> Floats:
    """Conductance in uS: a drifting level and responses that rise in 1.4 s and lose half in about 4 s."""
    times_s = np.arange(round(seconds * fs_hz)) / fs_hz
    out: Floats = tonic_us + drift_us_per_min * times_s / 60
    shape_s = np.linspace(0, 40, 4001)
    shape = np.exp(-shape_s / 5.0) - np.exp(-shape_s / 0.6)
    shape /= shape.max()
    for onset_s, amplitude in zip(onsets_s, amplitudes_us, strict=True):
        out += amplitude * np.interp(times_s - onset_s, shape_s, shape, left=0.0, right=0.0)
    return out


def falling_noise(exponent: float, n: int, seed: int) -> Floats:
    """Noise of n samples whose power falls with the frequency to this exponent; 2: a random walk."""
    spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=n))
    return np.fft.irfft(spectrum / np.maximum(np.arange(len(spectrum)), 1) ** (exponent / 2), n)


def play(
    make: Callable[[StreamInfo], Any],
    samples: Floats,
    fs_hz: float,
    sensor_type: str,
    unit: str,
    names: tuple[str, ...] = (),
    sizes: Iterable[int] = (),
    lost: Iterable[tuple[float, float]] = (),
    late_s: float = 0.0,
    true_hz: float = 0.0,
    **info: Any,
) -> list[Any]:
    """Updates of samples, shape (n,) or (n, channels), in frames of a quarter of a second or of these sizes.

    make: the step of a described stream. lost: what lies from the first to the second time in s never came. late_s:
    by up to so much the device stamps its frames late, evenly by chance. true_hz: the rate at which they really come,
    where fs_hz is not it but only declared.
    """
    dice = np.random.default_rng(6)
    columns = np.asarray(samples, float).reshape(len(samples), -1)
    names = names or (sensor_type,)
    step = make(StreamInfo(StreamName("p1", sensor_type, "s1"), fs_hz, unit, names, **info))
    clock, updates, sent = SampleClock(fs_hz), [], 0
    for size in [*sizes] or [max(1, round(fs_hz / 4))] * len(columns):
        part = columns[sent : sent + size]
        sent += len(part)
        if not len(part):
            break
        at_s = (sent - 1) / (true_hz or fs_hz)
        if not any(begin <= at_s < end for begin, end in lost):
            stamp_ns = T0_NS + round((at_s + dice.uniform(0, late_s)) * 1e9)
            updates += step.push(clock.place(Chunk(names, part, stamp_ns, stamp_ns)))
    return updates


def event_times_s(updates: Iterable[Any], field: str) -> Floats:
    """The times of all events in a field of the updates, in s since the first sample."""
    return np.array([(time_ns - T0_NS) / 1e9 for update in updates for time_ns in getattr(update, field)])
