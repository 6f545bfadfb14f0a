"""Steps of four toy interpreters; each counts or averages, so that what must come out is known by hand."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.step import Feature, Marker
from sense4hri.stream_info import StreamInfo

NAN = float("nan")


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """Nothing of its own."""


class Count(NamedTuple):
    """For ECG and PPG: samples since the last update; the rate the device reported."""

    device_ns: int | None
    received_ns: int
    peak_count: int
    heart_rate_bpm: float


class Counter:
    """One source. It cannot work with a stream that is said to be in degrees."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        if info.unit == "deg":
            raise ValueError("unit is 'deg', must be 'uV'")
        self._blocks, self._n, self._rate = Blocks(config.update_interval_s), 0, NAN

    def push(self, timed: TimedChunk) -> list[Count]:
        return [update for block in self._blocks.take(timed) for update in self._count(block)]

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        self._rate = value

    def _count(self, block: Block) -> list[Count]:
        self._n += len(block.times_ns)
        if not block.due:
            return []
        n, self._n = self._n, 0
        return [Count(block.device_ns, block.received_ns, n, self._rate)]


class Breaths(NamedTuple):
    """For Respiration: how many samples the segment has had."""

    device_ns: int | None
    received_ns: int
    window_s: float
    breath_count: int
    amplitude: float


class DerivedBreathing:
    """Publishes another type than it takes; ECG and accelerometer alike. Mean of the samples since the last hole."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        self._blocks = Blocks(config.update_interval_s, bridged_s=0.05)
        self._n, self._sum, self._since = 0, 0.0, 0

    def push(self, timed: TimedChunk) -> list[Breaths]:
        return [update for block in self._blocks.take(timed) for update in self._breathe(block)]

    def _breathe(self, block: Block) -> list[Breaths]:
        if block.begins:
            self._n = 0
        self._n, self._since = self._n + len(block.times_ns), self._since + len(block.times_ns)
        self._sum += float(block.samples[:, 0].sum())
        mean = self._sum / self._since if self._since else NAN
        if isinstance(block.hole, Hole):
            self._sum, self._since = 0.0, 0
        if not block.due:
            return []
        return [Breaths(block.device_ns, block.received_ns, block.window_s(10.0), self._n, mean)]


class Pulse(NamedTuple):
    """For PPG: mean of the pulse beside the greatest acceleration of the same time."""

    device_ns: int | None
    received_ns: int
    pulse_amplitude: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class Moved:
    """Two sources of one device: ppg, and the accelerometer beside it."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        self._blocks = Blocks(config.update_interval_s, beside=("accelerometer",))

    def push(self, timed: TimedChunk) -> list[Pulse]:
        return [self._look(block) for block in self._blocks.take(timed) if block.due]

    def beside(self, info: StreamInfo, timed: TimedChunk) -> list[Pulse]:
        return [self._look(block) for block in self._blocks.take_beside(info.name.sensor_type, timed) if block.due]

    def _look(self, block: Block) -> Pulse:
        near = block.beside.get("accelerometer")
        motion = NAN if near is None else float(np.abs(near.samples).max())
        reasons = () if near is not None else ("motion: no accelerometer",)
        extra = (Feature("motion", "m/s^2", (motion,)),)
        return Pulse(block.device_ns, block.received_ns, float(block.samples.mean()), extra, reasons)


class Level(NamedTuple):
    """For EDA: tonic level above that of the baseline."""

    device_ns: int | None
    received_ns: int
    tonic_us: float
    reasons: tuple[str, ...]


class Baseline:
    """Takes markers: the level is told over that of the last sample before `baseline_end`."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        self._blocks, self._newest, self._baseline = Blocks(config.update_interval_s), NAN, NAN

    def push(self, timed: TimedChunk) -> list[Level]:
        blocks = self._blocks.take(timed)
        self._newest = float(timed.samples[-1, 0])
        return [self._level(block) for block in blocks if block.due]

    def marker(self, marker: Marker) -> None:
        if marker.name == "baseline_end":
            self._baseline = self._newest

    def _level(self, block: Block) -> Level:
        reasons = () if self._baseline == self._baseline else ("no baseline yet",)
        return Level(block.device_ns, block.received_ns, float(block.samples[-1, 0]) - self._baseline, reasons)
