"""A driver of a device that exists only here: a ramp whose samples carry their number.

`TOY_FAULTS` is a comma-separated list of what goes wrong: `lost` (the link drops once after 5 frames), `bad` (the third
frame is undecodable), `gap` (ten samples are missing), `time` (a frame, an event and a measurement of its clock have
impossible device times), `config` (the configuration is wrong, found on connecting). Of a toy without a clock,
`counted` tells the gap by its count, and `uncounted` has none. `stuck`: its link is lost while it is released. `long`:
it says more of itself than anybody reads. `asked`: only on connecting it tells its rate, 125 Hz. `slow`: it has a
second stream, of 1 Hz, of which no sample comes.
While the file that `TOY_AWAY` names exists, the toy is out of reach.
"""

import asyncio
import os
import sys
import time
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import (
    ClockMeasurement,
    Declared,
    DriverConfig,
    Feature,
    Identity,
    Item,
    Marked,
    Reported,
    Samples,
    Status,
    Stream,
)
from sense4hri.driver import run_driver
from sense4hri.errors import ConfigError, DeviceLost, FrameError

FS_HZ, ASKED_HZ, FRAME = 100.0, 125.0, 10
FAULTS = frozenset(filter(None, os.environ.get("TOY_FAULTS", "").split(",")))
ECG = Stream(FS_HZ, "uV", -1e6, 1e6, 24, ("ecg",))
SLOW = {"temperature": Stream(1.0, "degC", 20.0, 40.0, 16, ("temperature",))} if "slow" in FAULTS else {}


@dataclass(frozen=True, kw_only=True)
class Config(DriverConfig):
    gain: float = 1.0
    labels: tuple[str, ...] = ("a", "b")

    @property
    def asks_rates(self) -> bool:
        return "asked" in FAULTS


class Toy:
    def __init__(self, config: Config, streams: Mapping[str, Stream]) -> None:
        self._config, self._streams = config, streams
        self._faults = set(FAULTS)
        self._sent = 0

    def _once(self, fault: str) -> bool:
        if fault not in self._faults:
            return False
        self._faults.discard(fault)
        return True

    def _reach(self) -> None:
        if Path(os.environ.get("TOY_AWAY", "/nowhere")).exists():
            raise DeviceLost("the toy is out of reach")

    async def stream(self) -> AsyncGenerator[Item, None]:
        if "config" in self._faults:
            raise ConfigError("parameter 'ecg.sampling_frequency_hz' is 7, the toy offers 100")
        self._reach()
        model = "toy " * 100 if "long" in self._faults else None
        yield Identity(serial_number="TOY-1", firmware_version="1.2.3", model=model)
        yield Status(battery_percent=81.0, rssi_dbm=-60.0, contact=1.0)
        if "asked" in self._faults:
            yield Declared({"ecg": replace(ECG, sampling_frequency_hz=ASKED_HZ)})
        begun_s = time.monotonic()
        try:
            for frame in range(1_000_000):
                await asyncio.sleep(begun_s + (frame + 1) * FRAME / FS_HZ - time.monotonic())
                self._reach()
                if frame == 2 and self._once("bad"):
                    yield FrameError("3 bytes")
                if frame == 3 and self._once("gap"):
                    self._sent += FRAME
                if frame == 5 and self._once("lost"):
                    raise DeviceLost("the toy was unplugged")
                self._sent += FRAME
                samples = np.arange(self._sent - FRAME, self._sent, dtype=float)[:, None] * self._config.gain
                now = time.time_ns()
                device_ns = round(self._sent / FS_HZ * 1e9) + 10**15
                if frame == 4 and self._once("time"):
                    device_ns = 2**63 - 1
                    yield Marked(now, device_ns, "pressed", "")
                    yield ClockMeasurement(now, -5, 0, 0.001, "toy")
                if self._faults & {"counted", "uncounted"}:
                    lost = None if "uncounted" in self._faults else FRAME if frame == 3 else 0
                    yield Samples("ecg", Chunk(("ecg",), samples, None, now), lost=lost)
                    continue
                yield Samples("ecg", Chunk(("ecg",), samples, device_ns, now))
                yield Reported("ecg", now, None, (Feature("heart_rate", "1/min", (61.0,)),))
        finally:
            print("toy released", file=sys.stderr, flush=True)
            if "stuck" in self._faults:
                raise DeviceLost("the toy was unplugged before it was released")


if __name__ == "__main__":
    sys.exit(run_driver("toy", Config, lambda config: {"ecg": ECG, **SLOW}, Toy))
