"""Where a device moves, doubts about its other signals count twice: EDA, EEG, EOG and breathing alike."""

import numpy as np
import pytest
from brain_signals import brain
from breathing_signals import belt, ecg
from eog_signals import eyes
from interpreter_eda.config import Config as EdaConfig
from interpreter_eda.stream import EdaStream
from interpreter_eeg.config import Config as EegConfig
from interpreter_eeg.stream import EegStream
from interpreter_eog.config import Config as EogConfig
from interpreter_eog.stream import EogStream
from interpreter_respiration.config import Config as BreathConfig
from interpreter_respiration.heart import HeartStream
from interpreter_respiration.stream import RespirationStream
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo
from slow_signals import T0_NS, play, skin

SECONDS, FS_HZ, MOTION_HZ = 30, 128.0, 40
NOISE = np.random.default_rng(1).normal(size=(round(SECONDS * FS_HZ), 1))
TIMES_S, SHORT = np.arange(len(NOISE)) / FS_HZ, BreathConfig(window_s=20.0)
CASES = {
    "eda": (EdaStream, EdaConfig(), "uS", ("eda",), skin(SECONDS, FS_HZ, [], [])[:, None] + 0.05 * NOISE),
    "eeg": (EegStream, EegConfig(), "uV", ("Cz",), brain(SECONDS, FS_HZ) + 4 * NOISE),
    "eog": (EogStream, EogConfig(), "uV", ("veog",), eyes(SECONDS, FS_HZ, [4.0, 9.0, 17.0])[:, 1:] + 8 * NOISE),
    "respiration": (
        RespirationStream,
        SHORT,
        "a.u.",
        ("respiration",),
        np.clip(belt(TIMES_S, 20.0), -0.95, 0.95)[:, None],
    ),
    "ecg": (HeartStream, SHORT, "uV", ("ecg",), ecg(SECONDS, FS_HZ, noise_uv=60.0)[:, None]),
}


def moved(step, strength):
    """The step, after it has taken the acceleration of its device: gravity, and a sine of this strength in m/s^2."""
    info = StreamInfo(StreamName("p1", "accelerometer", "s1"), float(MOTION_HZ), "m/s^2", ("x", "y", "z"))
    clock, times_s = SampleClock(float(MOTION_HZ)), np.arange(SECONDS * MOTION_HZ) / MOTION_HZ
    samples = np.stack([strength * np.sin(2 * np.pi * 1.9 * times_s), 0 * times_s, 0 * times_s + 9.81], axis=1)
    for first in range(0, len(samples), MOTION_HZ):
        stamp_ns = T0_NS + round((first / MOTION_HZ + 1) * 1e9)
        step.evidence(info, clock.place(Chunk(("x", "y", "z"), samples[first : first + MOTION_HZ], stamp_ns, stamp_ns)))
    return step


@pytest.mark.parametrize("name", CASES)
def test_motion_squares_the_quality(name):
    """Walking squares the quality; at rest, or without an accelerometer, it is what the signal gives."""
    make, config, unit, names, samples = CASES[name]
    still, walking = (
        play(lambda info, strength=strength: moved(make(config, info), strength), samples, FS_HZ, name, unit, names)
        for strength in (0.0, 4.0)
    )
    without = play(lambda info: make(config, info), samples, FS_HZ, name, unit, names)
    for one, other, third in list(zip(still, walking, without, strict=True))[20:]:
        assert 0.3 < one.signal_quality < 0.97
        assert other.signal_quality == pytest.approx(one.signal_quality**2, rel=1e-6)
        assert third.signal_quality == one.signal_quality
