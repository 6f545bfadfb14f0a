"""One recorded stream of raw samples, on the corrected timeline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sense4hri.cdr import RawMessage
from sense4hri.host_clocks import HostClocks, SensorHosts
from sense4hri.names import StreamName
from sense4hri.stream_info import can_be_rate

from sense4hri_session.blocks import Block, Ints, Timeline
from sense4hri_session.clock_fit import ClockFit
from sense4hri_session.seen import Seen

GAP_PERIODS = 1.5  # samples further apart than this are a gap
COLUMNS = ("time_s", "time_ns", "device_time_ns", "received_ns", "segment")  # of a table, beside those of the channels


class Rows(NamedTuple):
    """Samples in order, each array of shape (n,) but samples, (n, channels of the stream).

    samples: NaN where a message had not this channel. device_time_ns means something where timed is True.
    """

    time_ns: Ints
    samples: NDArray[np.float64]
    device_time_ns: Ints
    timed: NDArray[np.bool_]
    received_ns: Ints
    segment: NDArray[np.int32]


@dataclass(frozen=True, repr=False)
class Stream:
    """One stream. metadata: what the registry said of it; empty where nothing is known.

    hosts: of drivers, with their clocks. placed: where its blocks were kept, see `kept`; None: they come from
    the recording.
    """

    name: StreamName
    metadata: dict[str, Any]
    seen: Seen
    clock: ClockFit | None
    raws: Callable[[], Iterator[RawMessage]]
    hosts: SensorHosts = field(default_factory=lambda: SensorHosts(HostClocks()))
    placed: Callable[[], Iterator[Block]] | None = None

    def __repr__(self) -> str:
        return f"<Stream {self.key}: {', '.join(self.channels)}; {self.rate_in_words}; unit {self.unit or 'unknown'}>"

    @property
    def key(self) -> str:
        """`p1/ecg/h10_1`."""
        return "/".join(self.name)

    @property
    def channels(self) -> tuple[str, ...]:
        """All channels that ever came, in order of appearance."""
        return tuple(self.seen.channels)

    @cached_property
    def columns(self) -> dict[str, str]:
        """Channel -> its column in a table; `channel_` goes before a name that another column of the table has."""
        columns = {name: name for name in self.channels}
        for name in columns:
            while columns[name] in COLUMNS or (columns[name] != name and columns[name] in columns):
                columns[name] = f"channel_{columns[name]}"
        return columns

    @property
    def sampling_frequency_hz(self) -> float:
        """The declared rate, else the measured one; 0 = irregular."""
        declared = self.metadata.get("sampling_frequency_hz")
        return float(declared) if declared is not None and can_be_rate(declared) else self.measured_rate_hz

    @cached_property
    def measured_rate_hz(self) -> float:
        """Samples over time of the stamps, gaps left out; 0 where that cannot be known."""
        return self.seen.rate_hz()

    @property
    def rate_in_words(self) -> str:
        """The measured rate as a sidecar or header says it."""
        return f"{self.measured_rate_hz:.3f} Hz" if self.measured_rate_hz else "an unknown rate"

    @cached_property
    def true_rate_hz(self) -> float:
        """The rate by which samples are placed: the declared one, unless the stamps tell of quite another."""
        return self.seen.true_rate_hz(self.sampling_frequency_hz)

    @property
    def unit(self) -> str:
        """Unit of the samples; empty = unknown."""
        return str(self.metadata.get("unit", ""))

    def unit_of(self, channel: str) -> str:
        """Unit of one channel: that of the samples, but a `confidence` is a share (contract, section 2)."""
        return "1" if channel == "confidence" else self.unit

    @property
    def transport_delay_s(self) -> float:
        """The known part of the link's delay; 0 where nothing is known."""
        delay = float(self.metadata.get("transport_delay_s") or 0.0)
        return delay if math.isfinite(delay) else 0.0

    def blocks(self) -> Iterator[Block]:
        """The samples in order of receipt; repeated messages left out. Memory: one block."""
        return self.timeline().blocks(self.raws()) if self.placed is None else self.placed()

    def timeline(self) -> Timeline:
        """What gives the samples their times, message after message from the first one on."""

        def to_reference(host_ns: Ints) -> Ints:
            return self.hosts.reference_ns(self.name.sensor_id, host_ns)

        return Timeline(self.key, self.true_rate_hz, self.transport_delay_s, self.clock, to_reference)

    def tables(self, rows: int = 100_000) -> Iterator[pd.DataFrame]:
        """The samples as tables of at most so many rows, each with all channels of the stream."""
        return map(self._table, self.rows(rows))

    def frame(self) -> pd.DataFrame:
        """All samples: index the corrected time (UTC), one column per channel, both raw stamps beside them."""
        frame = self._table(self._whole())
        frame.index = pd.to_datetime(frame.pop("time_ns"), utc=True).rename("time")
        return frame

    def arrays(self) -> tuple[Ints, NDArray[np.float64]]:
        """(time_ns, samples): corrected ROS time (n,) and samples (n, channels)."""
        whole = self._whole()
        return whole.time_ns, whole.samples

    def rows(self, most: int = 100_000) -> Iterator[Rows]:
        """The samples, at most so many at a time."""
        waiting: list[Block] = []
        size = 0
        for block in self.blocks():
            if waiting and size + len(block.time_ns) > most:
                yield from _cut(self._joined(waiting), most)
                waiting, size = [], 0
            waiting.append(block)
            size += len(block.time_ns)
        if waiting:
            yield from _cut(self._joined(waiting), most)

    def _whole(self) -> Rows:
        return self._joined(list(self.blocks()))

    def _joined(self, blocks: list[Block]) -> Rows:
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
        time_ns = np.concatenate([np.empty(0, np.int64), *(block.time_ns for block in blocks)])
        received_ns = np.concatenate([np.empty(0, np.int64), *map(_received_ns, blocks)])
        segment = np.repeat(np.array([block.segment for block in blocks], np.int32), n)
        return Rows(time_ns, samples, device, timed, received_ns, segment)

    def _table(self, rows: Rows) -> pd.DataFrame:
        channels = zip(self.columns.values(), rows.samples.T, strict=True)
        return pd.DataFrame(
            {
                "time_ns": rows.time_ns,
                **dict(channels),
                "device_time_ns": pd.arrays.IntegerArray(rows.device_time_ns, ~rows.timed),
                "received_ns": rows.received_ns,
                "segment": rows.segment,
            }
        )


def _cut(rows: Rows, most: int) -> Iterator[Rows]:
    for low in range(0, len(rows.time_ns), most):
        yield Rows._make(values[low : low + most] for values in rows)


def _received_ns(block: Block) -> Ints:
    """The header stamp of every sample's message."""
    return np.repeat(block.received_ns, block.counts)
