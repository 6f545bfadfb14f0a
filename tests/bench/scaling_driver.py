"""A driver of a sensor that exists only here, for tests/bench/bench_scaling.py: KIND=strap (ECG, IMU) or band (PPG)."""

import asyncio
import os
import sys
import time
from collections.abc import AsyncGenerator, Mapping

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import DriverConfig, Identity, Item, Samples, Stream
from sense4hri.driver import run_driver

PACKET_S = 0.2
ECG = Stream(130.0, "uV", -1e4, 1e4, 24, ("ecg",))
IMU = Stream(52.0, "m/s^2", -80.0, 80.0, 16, ("x", "y", "z"))
PPG = Stream(55.0, "counts", 0.0, 4e6, 22, ("ppg_0",))
KINDS = {"strap": {"ecg": ECG, "accelerometer": IMU}, "band": {"ppg": PPG}}


def signal(kind: str, at_s: np.ndarray) -> np.ndarray:
    """A heart of 72 per minute, or gravity: shape (n, channels)."""
    phase = (at_s * 1.2) % 1.0
    if kind == "ecg":
        return 1000 * np.exp(-(((phase - 0.3) / 0.015) ** 2))[:, None] + 10 * np.sin(7 * at_s)[:, None]
    if kind == "ppg":
        return 1e5 + 2000 * np.exp(-(((phase - 0.4) / 0.12) ** 2))[:, None]
    return np.stack([np.sin(at_s), np.cos(at_s), np.full(len(at_s), 9.81)], axis=1)


class Sensor:
    """Sends a packet of every stream five times a second."""

    def __init__(self, config: DriverConfig, streams: Mapping[str, Stream]) -> None:
        self._streams = streams

    async def stream(self) -> AsyncGenerator[Item, None]:
        yield Identity(serial_number="scaling", firmware_version="1")
        begun_s, sent = time.monotonic(), dict.fromkeys(self._streams, 0)
        for packet in range(1, 10_000_000):
            await asyncio.sleep(max(0.0, begun_s + packet * PACKET_S - time.monotonic()))
            for kind, about in self._streams.items():
                rate_hz = about.sampling_frequency_hz
                numbers = np.arange(sent[kind], int(packet * PACKET_S * rate_hz))
                sent[kind] += len(numbers)
                device_ns = round(sent[kind] / rate_hz * 1e9) + 10**15
                samples = signal(kind, numbers / rate_hz)
                yield Samples(kind, Chunk(tuple(about.channel_names), samples, device_ns, time.time_ns()))


if __name__ == "__main__":
    offered = KINDS[os.environ["KIND"]]
    sys.exit(run_driver("scaling", DriverConfig, lambda config: offered, Sensor))
