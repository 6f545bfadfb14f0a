"""A driver of a sensor that exists only here, for tests/bench/bench_scaling.py: KIND=strap (ECG, IMU) or band (PPG).

It packs samples as a Polar H10 and a Verity Sense do; with PACKETS_PER_S it sends so many packets of every stream.
"""

import asyncio
import heapq
import itertools
import os
import sys
import time
from collections.abc import AsyncGenerator, Iterator, Mapping

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import DriverConfig, Identity, Item, Samples, Stream
from sense4hri.driver import run_driver

ECG = Stream(130.0, "uV", -1e4, 1e4, 24, ("ecg",))
IMU = Stream(52.0, "m/s^2", -80.0, 80.0, 16, ("x", "y", "z"))
PPG = Stream(55.0, "counts", 0.0, 4e6, 22, ("ppg_0",))
PACKET_SAMPLES = {"ecg": 73, "accelerometer": 36, "ppg": 40}
STREAMS = {"ecg": ECG, "accelerometer": IMU, "ppg": PPG}
KINDS = {"strap": ("ecg", "accelerometer"), "band": ("ppg",)}


def signal(kind: str, at_s: np.ndarray) -> np.ndarray:
    """A heart of 72 per minute, or gravity: shape (n, channels)."""
    phase = (at_s * 1.2) % 1.0
    if kind == "ecg":
        return 1000 * np.exp(-(((phase - 0.3) / 0.015) ** 2))[:, None] + 10 * np.sin(7 * at_s)[:, None]
    if kind == "ppg":
        return 1e5 + 2000 * np.exp(-(((phase - 0.4) / 0.12) ** 2))[:, None]
    return np.stack([np.sin(at_s), np.cos(at_s), np.full(len(at_s), 9.81)], axis=1)


def packets_per_s(kind: str) -> float:
    """Return how many packets of a stream come in a second."""
    given = os.environ.get("PACKETS_PER_S")
    return float(given) if given else STREAMS[kind].sampling_frequency_hz / PACKET_SAMPLES[kind]


class Sensor:
    """Sends packet after packet of every stream, each when its last sample is there."""

    def __init__(self, config: DriverConfig, streams: Mapping[str, Stream]) -> None:
        self._streams = streams

    async def stream(self) -> AsyncGenerator[Item, None]:
        yield Identity(serial_number="scaling", firmware_version="1")
        begun_s, sent = time.monotonic(), dict.fromkeys(self._streams, 0)
        for due_s, kind in heapq.merge(*(_packets(kind) for kind in self._streams)):
            await asyncio.sleep(max(0.0, begun_s + due_s - time.monotonic()))
            about = self._streams[kind]
            rate_hz = about.sampling_frequency_hz
            numbers = np.arange(sent[kind], round(due_s * rate_hz))
            sent[kind] += len(numbers)
            device_ns = round(sent[kind] / rate_hz * 1e9) + 10**15
            samples = signal(kind, numbers / rate_hz)
            yield Samples(kind, Chunk(tuple(about.channel_names), samples, device_ns, time.time_ns()))


def _packets(kind: str) -> Iterator[tuple[float, str]]:
    """Yield when each packet of a stream is due, in s from the beginning."""
    return ((number / packets_per_s(kind), kind) for number in itertools.count(1))


if __name__ == "__main__":
    offered = {kind: STREAMS[kind] for kind in KINDS[os.environ["KIND"]]}
    sys.exit(run_driver("scaling", DriverConfig, lambda config: offered, Sensor))
