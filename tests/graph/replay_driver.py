"""A driver of a chest band that exists only here: ECG and PPG of one heart on one device clock.

SIGUSR1 reboots it: its clock starts again from another epoch.
"""

import asyncio
import signal
import sys
import time
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.device import DriverConfig, Feature, Identity, Item, Reported, Samples, Status, Stream
from sense4hri.driver import run_driver

STREAMS = {
    "ecg": Stream(130.0, "uV", -1e6, 1e6, 24, ("ecg",)),
    "ppg": Stream(55.0, "counts", 0.0, 1e6, 22, ("ppg_0",)),
}
FRAMES_PER_S = 5
BEATS_S = np.cumsum(np.concatenate([[0.5], 0.8 + 0.04 * np.sin(np.arange(2000) * 0.7)]))
_reboots = 0


def wave(sensor_type: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Samples of the heart at these times, shape (n, 1)."""
    since = times_s - BEATS_S[np.maximum(0, np.searchsorted(BEATS_S, times_s) - 1)]
    until = BEATS_S[np.searchsorted(BEATS_S, times_s)] - times_s
    if sensor_type == "ecg":
        near = np.minimum(since, until)
        out = 1200.0 * np.exp(-((near / 0.012) ** 2)) + 200.0 * np.exp(-(((since - 0.25) / 0.04) ** 2))
        out += 15.0 * np.sin(times_s * 311.7)
    else:
        out = 400_000.0 - 6_000.0 * np.exp(-(((since - 0.2) / 0.1) ** 2)) - 30.0 * np.sin(times_s * 113.3)
    return out[:, None]


@dataclass(frozen=True, kw_only=True)
class Config(DriverConfig):
    """As every driver's."""


class Band:
    def __init__(self, config: Config, streams: Mapping[str, Stream]) -> None:
        self._streams = streams

    async def stream(self) -> AsyncGenerator[Item, None]:
        yield Identity(serial_number="BAND-1", firmware_version="1.0.0")
        yield Status(battery_percent=80.0, rssi_dbm=-50.0, contact=1.0)
        begun_s = time.monotonic()
        for frame in range(1, 1_000_000):
            await asyncio.sleep(max(0.0, begun_s + frame / FRAMES_PER_S - time.monotonic()))
            epoch_ns = 10**15 + _reboots * 10**17
            for name, stream in self._streams.items():
                n = round(stream.sampling_frequency_hz / FRAMES_PER_S)
                times_s = np.arange((frame - 1) * n + 1, frame * n + 1) / stream.sampling_frequency_hz
                device_ns = epoch_ns + round(times_s[-1] * 1e9)
                chunk = Chunk(tuple(stream.channel_names), wave(name, times_s), device_ns, time.time_ns())
                yield Samples(name, chunk)
            if frame % FRAMES_PER_S == 0:
                yield Reported("ecg", time.time_ns(), None, (Feature("heart_rate", "1/min", (74.0,)),))


def reboot(number: int, frame: object) -> None:
    """Begin another epoch of the device clock."""
    global _reboots
    _reboots += 1


if __name__ == "__main__":
    signal.signal(signal.SIGUSR1, reboot)
    sys.exit(run_driver("band", Config, lambda config: STREAMS, Band))
