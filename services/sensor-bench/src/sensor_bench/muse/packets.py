"""What a Muse 2 puts into its packets: pure, a function of sample numbers alone.

Sample i of a stream is taken i / rate seconds after the bench's start. Every packet has 20 bytes: a counter of 16 bits,
then samples, all big-endian.
"""

import json
import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.sources import MotionSource, Noise, PpgSource, Wearing, sample_times_s
from sensor_bench.signals.waveforms import stored

EEG, MOTION, PPG = "eeg", "motion", "ppg"
ELECTRODES = ("TP9", "AF7", "AF8", "TP10")
G, DEGREES_PER_S = 1 / 16384, 0.0074768
MICROVOLT, MIDDLE, MOST = 0.48828125, 2048, 4095
ALPHA_HZ, ALPHA_UV, NOISE_UV = 10.0, (30.0, 12.0, 12.0, 30.0), 6.0
LINE = 19  # bytes of text in a packet of the control characteristic


class Shape(NamedTuple):
    """Rate in Hz of a stream's samples, and how many are in a packet."""

    fs_hz: float
    samples: int


SHAPES = {EEG: Shape(256.0, 12), MOTION: Shape(52.0, 3), PPG: Shape(64.0, 6)}
SENSOR_TYPES = {EEG: ("eeg",), MOTION: ("accelerometer", "gyroscope"), PPG: ("ppg",)}


class Band:
    """The signals of one headband on a participant: alpha waves, breath in the motion, the pulse at the forehead."""

    def __init__(self, heart: Rhythm, seed: int, transit_s: float) -> None:
        wearing = Wearing()
        self._noise = Noise(seed, len(ELECTRODES))
        self._acceleration = MotionSource(heart, seed + 1, (0.02, -0.05, 0.99), 0.004, 0.003, G)
        self._rotation = MotionSource(heart, seed + 2, (0.3, -0.2, 0.1), 0.8, 0.3, DEGREES_PER_S)
        self._pulse = PpgSource(heart, wearing, stored(), seed + 3, transit_s)

    def microvolts(self, first: int, count: int) -> NDArray[np.float64]:
        """EEG, shape (count, 4), as the device rounds it."""
        times_s = sample_times_s(first, count, SHAPES[EEG].fs_hz)[:, None]
        waves = np.sin(2 * np.pi * ALPHA_HZ * times_s) * ALPHA_UV + self._noise.at(first, count) * NOISE_UV
        return np.asarray((_twelve_bits(waves) - MIDDLE) * MICROVOLT, np.float64)

    def packets(self, stream: str, counter: int, first: int) -> list[bytes]:
        """Return the packets that carry the samples from number `first` on; one for each characteristic."""
        count, head = SHAPES[stream].samples, struct.pack(">H", counter & 0xFFFF)
        fs_hz = SHAPES[stream].fs_hz
        if stream == EEG:
            numbers = _twelve_bits(self.microvolts(first, count))
            return [head + _pack_pairs(column) for column in numbers.T.tolist()]
        if stream == MOTION:
            sources = (self._acceleration, self._rotation)
            return [head + source.read(first, count, fs_hz).astype(">i2").tobytes() for source in sources]
        light = np.maximum(self._pulse.read(first, count, fs_hz), 0)[:, :2]
        return [head + b"".join(value.to_bytes(3, "big") for value in column) for column in light.T.tolist()]


def _twelve_bits(microvolts: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.clip(np.rint(microvolts / MICROVOLT) + MIDDLE, 0, MOST).astype(np.int64)


def _pack_pairs(values: list[int]) -> bytes:
    """Two values of 12 bits in three bytes."""
    pairs = zip(values[::2], values[1::2], strict=True)
    return b"".join((first << 12 | second).to_bytes(3, "big") for first, second in pairs)


def command_of(written: bytes) -> str:
    """Return the command in what was written: length of what follows, letters, line feed. Raises ValueError."""
    if len(written) < 3 or written[0] != len(written) - 1 or written[-1:] != b"\n":
        raise ValueError(f"no command: {written.hex(' ')}")
    return written[1:-1].decode("ascii")


def answer(**values: object) -> Iterator[bytes]:
    """Yield the packets of an answer in JSON: length, then at most 19 letters, filled with zeros."""
    text = json.dumps(values, separators=(",", ":")).encode()
    for at in range(0, len(text), LINE):
        piece = text[at : at + LINE]
        yield bytes([len(piece)]) + piece.ljust(LINE, b"\0")
