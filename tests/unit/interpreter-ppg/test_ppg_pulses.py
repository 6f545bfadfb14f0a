"""Every pulse of a synthetic wearer is found, at its time, at any rate, polarity, level and heart rate."""

from typing import NamedTuple

import numpy as np
import pytest
from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStep, PpgUpdate
from sense4hri.chunk import Chunk
from sense4hri.sample_clock import SampleClock

START_NS = 704_201_975_000_000_000


class Info(NamedTuple):
    """What the step asks of a StreamInfo."""

    sampling_frequency_hz: float
    unit: str = "counts"
    range_min: float = float("nan")
    range_max: float = float("nan")


def beats_s(duration_s, rate_bpm, variability_ms=25.0, seed=1):
    """Times of heart beats: breathing modulates the interval, the rest is chance."""
    random = np.random.default_rng(seed)
    times = [0.3]
    while times[-1] < duration_s:
        breath = variability_ms * np.sin(2 * np.pi * 0.25 * times[-1])
        times.append(times[-1] + 60 / rate_bpm + (breath + random.normal(0, variability_ms / 3)) / 1000)
    return np.array(times)


def pleth(times_s, beats, amplitude=3000.0, level=4e5, breathing=0.5, dicrotic=0.35, noise=0.0, seed=2):
    """Light absorbed: a systolic and a dicrotic wave per beat, on a level that moves with breathing."""
    random = np.random.default_rng(seed)
    x = np.zeros(len(times_s))
    for i, beat in enumerate(beats):
        stretch = min(1.0, (beats[i + 1] - beat if i + 1 < len(beats) else 1.0) / 0.8)
        after = times_s - beat
        x += np.exp(-0.5 * ((after - 0.20 * stretch) / (0.085 * stretch)) ** 2)
        x += dicrotic * np.exp(-0.5 * ((after - 0.47 * stretch) / (0.13 * stretch)) ** 2)
    x += breathing * np.sin(2 * np.pi * 0.23 * times_s) + noise * random.normal(size=len(times_s))
    return level + amplitude * x


def rises_s(beats):
    """When the systolic wave of each beat of `pleth` rises most steeply."""
    stretch = np.minimum(1.0, np.diff(beats, append=beats[-1] + 1.0) / 0.8)
    return beats + 0.115 * stretch


def play(
    samples, fs_hz, frames=(20,), config=None, names=("ppg_0", "ppg_1", "ppg_2"), info=None, skip=()
) -> list[PpgUpdate]:
    """Every update of a recording cut into frames; the frames whose numbers are in skip are lost on the way."""
    samples = np.asarray(samples, float).reshape(len(samples), -1)
    clock, step = SampleClock(fs_hz), PpgStep(config or Config(), info or Info(fs_hz))
    updates, start, number = [], 0, 0
    while start < len(samples):
        stop = min(start + frames[number % len(frames)], len(samples))
        stamp_ns = START_NS + round((stop - 1) / fs_hz * 1e9)
        chunk = Chunk(tuple(names[: samples.shape[1]]), samples[start:stop], stamp_ns, stamp_ns + 10**18)
        if number not in skip:
            updates += step.push(clock.place(chunk))
        start, number = stop, number + 1
    return updates


def published_s(updates):
    return np.array([(t - START_NS) / 1e9 for update in updates for t in update.peak_times_ns])


def matches(found, truth, tolerance_s=0.08):
    """Indices (found, truth) of pulses within the tolerance, each once."""
    nearest = np.abs(found[:, None] - truth).argmin(axis=1)
    close = np.abs(found - truth[nearest]) < tolerance_s
    which, first = np.unique(nearest[close], return_index=True)
    return np.flatnonzero(close)[first], which


@pytest.mark.parametrize("fs_hz", [25, 54.75, 100, 200, 500])
@pytest.mark.parametrize("rate_bpm", [40, 60, 75, 120, 180])
@pytest.mark.parametrize("sign", [1, -1])
def test_every_pulse_once(fs_hz, rate_bpm, sign):
    """Every pulse between the first second and the last is published once, at any rate, heart rate and polarity."""
    times_s = np.arange(0, 40, 1 / fs_hz)
    beats = beats_s(40, rate_bpm)
    updates = play(sign * pleth(times_s, beats), fs_hz)
    found = published_s(updates)
    truth = rises_s(beats)
    known, which = matches(found, truth)
    assert len(known) == len(found)
    assert set(np.flatnonzero((truth > 0.9) & (truth < 38))) <= set(which)
    assert np.all(np.diff(found) > 0)
    assert np.std(found[known] - truth[which]) < (0.003 if rate_bpm <= 75 else 0.015)
    print(
        fs_hz, rate_bpm, sign, 1000 * np.std(found[known] - truth[which]), 1000 * np.mean(found[known] - truth[which])
    )
    assert updates[-1].heart_rate_bpm == pytest.approx(rate_bpm, abs=2.5)
    assert updates[-1].signal_quality > 0.9
