"""One recorded stream of raw samples, on the corrected timeline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sense4hri.cdr import RawMessage
from sense4hri.chunk import Break, Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock

from sense4hri_session.clock_fit import ClockFit

Ints = NDArray[np.int64]
NO_SEGMENT = 0  # of a stream without device time
STEADY = 0.5  # share by which messages of the usual rate may differ from their median
GAP_PERIODS = 1.5  # samples further apart than this are a gap


class Block(NamedTuple):
    """Samples of one message.

    time_ns: corrected ROS time of every sample. device_time_ns: the device's clock, None where it gives no time.
    received_ns: header stamp of the message; the raw device stamp is the last device_time_ns. segment: epoch of the
    device clock, from 1; 0 without device time. continues: no sample is missing before this block.
    """

    time_ns: Ints
    device_time_ns: Ints | None
    received_ns: int
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    segment: int
    continues: bool


@dataclass
class Seen:
    """What a first pass over the messages of a stream has found. Channels are united where they changed."""

    device_ns: list[int] = field(default_factory=list)
    received_ns: list[int] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    channels: dict[str, tuple[float, float]] = field(default_factory=dict)  # smallest and largest sample
    channel_sets: dict[tuple[str, ...], None] = field(default_factory=dict)
    undecodable: int = 0

    @property
    def samples(self) -> int:
        """All samples, those of repeated messages among them."""
        return sum(self.counts)

    def add(self, raw: RawMessage) -> None:
        self.device_ns.append(raw.device_ns)
        self.received_ns.append(raw.received_ns)
        self.counts.append(len(raw.samples))
        self.channel_sets[raw.channels] = None
        low, high = _extremes(raw.samples)
        for name, a, b in zip(raw.channels, low, high, strict=True):
            before = self.channels.get(name, (math.inf, -math.inf))
            self.channels[name] = (min(before[0], a), max(before[1], b))

    def rate_hz(self) -> float:
        """Samples over time of the stamps, gaps and resets left out; 0 where that cannot be known."""
        stamps = np.array(self.device_ns if all(self.device_ns) else self.received_ns, np.int64)
        steps, counts = np.diff(stamps) * 1e-9, np.array(self.counts[1:], float)
        good = steps > 0
        if good.sum() < 2:
            return 0.0
        per_sample = steps[good] / counts[good]
        usual = np.sort(per_sample)[(len(per_sample) - 1) // 2]
        steady = np.abs(per_sample / usual - 1) < STEADY
        return float(counts[good][steady].sum() / steps[good][steady].sum())


@dataclass(frozen=True)
class Stream:
    """One stream. metadata: what the registry said of it; empty where the recording holds nothing."""

    name: StreamName
    metadata: dict[str, Any]
    seen: Seen
    clock: ClockFit | None
    raws: Callable[[], Iterator[RawMessage]]

    @property
    def key(self) -> str:
        """`p1/ecg/h10_1`."""
        return "/".join(self.name)

    @property
    def channels(self) -> tuple[str, ...]:
        """All channels that ever came, in order of appearance."""
        return tuple(self.seen.channels)

    @property
    def sampling_frequency_hz(self) -> float:
        """The declared rate, else the measured one; 0 = irregular."""
        declared = self.metadata.get("sampling_frequency_hz")
        return float(declared) if declared is not None and math.isfinite(declared) else self.seen.rate_hz()

    @property
    def measured_rate_hz(self) -> float:
        """Samples over time of the stamps, gaps left out; 0 where that cannot be known."""
        return self.seen.rate_hz()

    @property
    def unit(self) -> str:
        """Unit of the samples; empty = unknown."""
        return str(self.metadata.get("unit", ""))

    @property
    def transport_delay_s(self) -> float:
        """The known part of the link's delay; 0 where nothing is known."""
        delay = float(self.metadata.get("transport_delay_s") or 0.0)
        return delay if math.isfinite(delay) else 0.0

    def blocks(self) -> Iterator[Block]:
        """The samples message by message, in order of receipt; repeated messages left out. Memory: one message."""
        clock = SampleClock(self.sampling_frequency_hz)
        delay_ns = round(self.transport_delay_s * 1e9)
        segment_of = self.clock.segment_of.get(self.key) if self.clock else None
        timed = 0
        for raw in self.raws():
            number = -1
            if raw.device_ns and self.clock is not None and segment_of is not None:
                number, timed = int(segment_of[timed]), timed + 1
            placed = clock.place(Chunk(raw.channels, raw.samples, raw.device_ns or None, raw.received_ns))
            if placed.break_ is Break.DUPLICATE:
                continue
            if number >= 0 and self.clock is not None:
                time_ns = self.clock.segments[number].ros_ns(placed.times_ns)
                device: Ints | None = placed.times_ns
            else:
                time_ns, device = placed.times_ns - delay_ns, None
            yield Block(time_ns, device, raw.received_ns, raw.channels, raw.samples, number + 1, placed.break_ is None)

    def tables(self, rows: int = 100_000) -> Iterator[pd.DataFrame]:
        """The samples as tables of about so many rows, each with all channels of the stream."""
        waiting: list[Block] = []
        size = 0
        for block in self.blocks():
            waiting.append(block)
            size += len(block.time_ns)
            if size >= rows:
                yield self._join(waiting)
                waiting, size = [], 0
        if waiting:
            yield self._join(waiting)

    def frame(self) -> pd.DataFrame:
        """All samples: index the corrected time (UTC), one column per channel, both raw stamps beside them."""
        tables = list(self.tables())
        frame = pd.concat(tables, ignore_index=True) if tables else self._join([])
        frame.index = pd.to_datetime(frame.pop("time_ns"), utc=True).rename("time")
        return frame

    def arrays(self) -> tuple[Ints, NDArray[np.float64]]:
        """(time_ns, samples): corrected ROS time (n,) and samples (n, channels)."""
        frame = pd.concat(list(self.tables()), ignore_index=True) if self.seen.samples else self._join([])
        return frame["time_ns"].to_numpy(np.int64), frame[list(self.channels)].to_numpy(np.float64)

    def _join(self, blocks: list[Block]) -> pd.DataFrame:
        n = [len(block.time_ns) for block in blocks]
        edges = np.concatenate([[0], np.cumsum(n)]).astype(int)
        samples = np.full((edges[-1], len(self.channels)), np.nan)
        device = np.zeros(edges[-1], np.int64)
        timed = np.zeros(edges[-1], bool)
        place = {name: i for i, name in enumerate(self.channels)}
        for block, low, high in zip(blocks, edges[:-1], edges[1:], strict=True):
            samples[low:high, [place[name] for name in block.channels]] = block.samples
            if block.device_time_ns is not None:
                device[low:high], timed[low:high] = block.device_time_ns, True
        columns: dict[str, Any] = {
            "time_ns": np.concatenate([np.empty(0, np.int64), *(block.time_ns for block in blocks)]),
            **{name: samples[:, i] for name, i in place.items()},
            "device_time_ns": pd.arrays.IntegerArray(device, ~timed),
            "received_ns": np.repeat(np.array([block.received_ns for block in blocks], np.int64), n),
            "segment": np.repeat(np.array([block.segment for block in blocks], np.int32), n),
        }
        return pd.DataFrame(columns)


def _extremes(samples: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    finite = np.isfinite(samples)
    return (
        np.where(finite, samples, np.inf).min(axis=0).tolist(),
        np.where(finite, samples, -np.inf).max(axis=0).tolist(),
    )
