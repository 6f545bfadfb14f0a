"""What a broken or hostile driver sends within what the kit lets in: every interpreter takes it and goes on.

Each number up to 1e30, NaN, and stamps that jump, stand still or go back are no reason to end, to warn or to publish an
infinity. What comes is drawn from a seed; another one: `HOSTILE_SEEDS=100 .venv/bin/python -m pytest <this file>`.
"""

import math
import os
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import interpreter_ecg.config
import interpreter_ecg.stream
import interpreter_eda.config
import interpreter_eda.stream
import interpreter_eeg.config
import interpreter_eeg.stream
import interpreter_emg.config
import interpreter_emg.stream
import interpreter_eog.config
import interpreter_eog.stream
import interpreter_eye_tracking.config
import interpreter_eye_tracking.stream
import interpreter_motion.config
import interpreter_motion.stream
import interpreter_ppg.config
import interpreter_ppg.stream
import interpreter_pupillometry.config
import interpreter_pupillometry.stream
import interpreter_respiration.__main__
import interpreter_respiration.config
import numpy as np
import pytest
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.feed import Beside, Feed
from sense4hri.intake import LARGEST
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo

Floats = NDArray[np.float64]
SEEDS = range(int(os.environ.get("HOSTILE_SEEDS", "3")))
STRETCHES = 12
SIZES = (1e-300, 1e-30, 1e-9, 1e-3, 1.0, 1e3, 1e6, 1e12, 1e20, 1e29)
STRETCH_S, FRAME = (0.1, 1.0, 5.0, 20.0, 60.0), (1, 7, 36, 200, 1000)
JUMPS_NS = (0, 300_000_000, 2_000_000_000, 30_000_000_000, 4_000_000_000_000)
DEVICE_NS, RECEIVED_NS = 10**15, 10**18


class Source(NamedTuple):
    """A stream that an interpreter takes."""

    step: Callable[[Any, StreamInfo], Any]
    config: type
    sensor_type: str
    fs_hz: float
    unit: str
    channels: tuple[str, ...]


RESPIRATION = interpreter_respiration.__main__.step, interpreter_respiration.config.Config
SOURCES = {
    "ecg": Source(interpreter_ecg.stream.EcgStream, interpreter_ecg.config.Config, "ecg", 130.0, "uV", ("ecg",)),
    "ppg": Source(
        interpreter_ppg.stream.PpgStream, interpreter_ppg.config.Config, "ppg", 55.0, "counts", ("ppg_0", "ambient")
    ),
    "eda": Source(interpreter_eda.stream.EdaStream, interpreter_eda.config.Config, "eda", 10.0, "uS", ("eda",)),
    "eeg": Source(
        interpreter_eeg.stream.EegStream, interpreter_eeg.config.Config, "eeg", 250.0, "uV", ("Fz", "F3", "F4", "O1")
    ),
    "emg": Source(
        interpreter_emg.stream.EmgStream, interpreter_emg.config.Config, "emg", 500.0, "uV", ("emg_0", "emg_1")
    ),
    "eog": Source(
        interpreter_eog.stream.EogStream, interpreter_eog.config.Config, "eog", 100.0, "uV", ("heog", "veog")
    ),
    "gaze": Source(
        interpreter_eye_tracking.stream.EyeStream,
        interpreter_eye_tracking.config.Config,
        "eye_tracking",
        60.0,
        "px",
        ("gaze_x", "gaze_y"),
    ),
    "pupils": Source(
        interpreter_pupillometry.stream.PupilStream,
        interpreter_pupillometry.config.Config,
        "pupillometry",
        60.0,
        "mm",
        ("diameter_left", "diameter_right"),
    ),
    "motion": Source(
        interpreter_motion.stream.MotionStream,
        interpreter_motion.config.Config,
        "accelerometer",
        52.0,
        "m/s^2",
        ("x", "y", "z"),
    ),
    "belt": Source(*RESPIRATION, "respiration", 25.0, "N", ("respiration",)),
    "breathing from the heart": Source(*RESPIRATION, "ecg", 130.0, "uV", ("ecg",)),
    "breathing from the chest": Source(*RESPIRATION, "accelerometer", 52.0, "m/s^2", ("x", "y", "z")),
}


XYZ = ("x", "y", "z")
ACCELEROMETER = StreamInfo(StreamName("p1", "accelerometer", "s1"), 52.0, "m/s^2", XYZ)


def stretch(random: np.random.Generator, n: int, channels: int) -> Floats:
    """Values that no body has, of one kind, shape (n, channels)."""
    noise, size = random.normal(size=(n, channels)), float(random.choice(SIZES))
    at, every = np.arange(n)[:, None], np.ones((1, channels))
    spike, holed, lost = noise.copy(), size * noise, noise.copy()
    spike[random.integers(n)] = random.choice((LARGEST, -LARGEST))
    holed[random.random((n, channels)) < 0.5] = np.nan
    lost[:, random.integers(channels)] = np.nan
    kinds = (
        size * noise,
        size * np.round(noise),
        size * np.exp(np.minimum(5 * noise, np.log(LARGEST) / 2)),
        size * every * np.ones((n, 1)),
        size * every * np.where(at % 2, 1.0, -1.0),
        size * every * at / n,
        size * every * np.sin(at * random.random()),
        np.zeros((n, channels)),
        np.full((n, channels), np.nan),
        spike,
        holed,
        lost,
    )
    return np.clip(kinds[random.integers(len(kinds))], -LARGEST, LARGEST)


def events(random: np.random.Generator, source: Source, fs_hz: float) -> Iterator[Chunk | Beside]:
    """Stretch after stretch, in frames whose stamps do not always fit, the device's acceleration beside each."""
    device_ns, received_ns = DEVICE_NS, RECEIVED_NS
    for _ in range(STRETCHES):
        values = stretch(random, max(2, round(fs_hz * random.choice(STRETCH_S))), len(source.channels))
        if random.random() < 0.25:
            received_ns += int(random.choice(JUMPS_NS))
            device_ns += int(random.choice(JUMPS_NS))
        if random.random() < 0.1:
            device_ns = int(random.choice((0, 10**9, DEVICE_NS)))
        begin = 0
        while begin < len(values):
            part = values[begin : begin + int(random.choice(FRAME))]
            passed_ns = round(len(part) / fs_hz * 1e9)
            device_ns = max(0, device_ns + round(passed_ns * random.choice((1.0,) * 30 + (0.1, 3.0, -1.0))))
            received_ns += passed_ns
            yield Chunk(source.channels, part, device_ns if random.random() < 0.99 else None, received_ns)
            moved = Chunk(XYZ, stretch(random, max(1, len(part) // 2), 3), device_ns, received_ns)
            yield Beside(received_ns, ACCELEROMETER, moved)
            begin += len(part)


@pytest.mark.parametrize("name", SOURCES)
def test_the_streams_here_are_such_as_interpreters_take(name: str) -> None:
    """None is refused for its rate, unit or channels: nothing would be tried of it."""
    source = SOURCES[name]
    info = StreamInfo(StreamName("p1", source.sensor_type, "s1"), source.fs_hz, source.unit, source.channels)
    assert source.step(source.config(), info) is not None


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", SOURCES)
def test_nothing_ends_it_and_nothing_infinite_comes_of_it(name: str, seed: int) -> None:
    """No exception, no warning; every number is finite or NaN, and quality between 0 and 1."""
    source, random = SOURCES[name], np.random.default_rng(seed)
    fs_hz = source.fs_hz * float(random.choice((1.0, 2.0, 0.8, 0.25, 3.7)))
    stream = StreamName("p1", source.sensor_type, "s1")
    info = StreamInfo(stream, fs_hz if random.random() < 0.9 else 0.0, source.unit, source.channels)
    told: list[str] = []
    feed = Feed(lambda known: source.step(source.config(), known), 1.0, ordered=True, refused=told.append)
    feed.know(info)
    updates = [update for event in events(random, source, fs_hz) for update in feed.put(event)] + feed.finish()
    assert not [reason for reason in told if "its samples make" in reason]
    for update in updates:
        if hasattr(update, "signal_quality"):
            assert math.isnan(update.signal_quality) or 0.0 <= update.signal_quality <= 1.0
        for field, value in update._asdict().items():
            assert not (isinstance(value, float) and math.isinf(value)), field
