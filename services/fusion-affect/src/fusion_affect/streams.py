"""What has come from every sensor stream: heart rates, the clock model, signs of life; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sense4hri.names import UNASSIGNED, StreamName

from fusion_affect.align import SECOND_NS, ClockModel, Newest, corrected_ns, seconds
from fusion_affect.heart_rate import NAN, Reading


class Rate(NamedTuple):
    """A heart rate as a message brings it; quality NaN = not known."""

    bpm: float
    quality: float = NAN
    reasons: tuple[str, ...] = ()


def reported(values: Mapping[str, float]) -> Rate:
    """Return what a sensor itself reports; a rate without skin contact is the last one it had, or noise."""
    return Rate(NAN, NAN, ("no skin contact",)) if values.get("contact") == 0 else Rate(values["heart_rate"])


@dataclass
class Stream:
    """What has come from one stream."""

    rates: dict[str, Newest[Rate]] = field(default_factory=dict)
    """By source: `features` and `device`."""
    model: ClockModel | None = None
    live: dict[str, Newest[None]] = field(default_factory=dict)
    """Its signs of life, by field."""
    streaming: bool = False
    """As its driver's health said last."""


class Streams:
    """All streams by name; times are ROS time in ns."""

    def __init__(self) -> None:
        self._streams: dict[StreamName, Stream] = {}

    def afresh(self) -> Streams:
        """Return what holds whatever the time is: the clock models."""
        kept = Streams()
        kept._streams = {name: Stream(model=stream.model) for name, stream in self._streams.items()}
        return kept

    def rate(self, name: StreamName, source: str, rate: Rate, receipt_ns: int, device_ns: int) -> None:
        """Keep a heart rate at its corrected time."""
        stream = self._live(name, receipt_ns, source)
        time_ns = corrected_ns(device_ns, receipt_ns, stream.model)
        stream.rates.setdefault(source, Newest()).put(time_ns, rate)

    def clock(self, name: StreamName, model: ClockModel) -> None:
        """Place by this model what comes after it."""
        self._streams.setdefault(name, Stream()).model = model

    def health(self, name: StreamName, receipt_ns: int, streaming: bool) -> bool:
        """Take what a driver says; return whether its stream begins."""
        stream = self._live(name, receipt_ns, "health") if streaming else self._streams.setdefault(name, Stream())
        begins, stream.streaming = streaming and not stream.streaming, streaming
        return begins

    def vanished(self, name: StreamName, field_: str) -> None:
        """Forget a field that is no longer on the graph; with the last sign of life the stream.

        The clock model of one that lives goes on without clock-sync.
        """
        if stream := self._streams.get(name):
            stream.rates.pop(field_, None)
            stream.live.pop(field_, None)
            if not stream.live:
                del self._streams[name]

    def humans(self, time_ns: int, live_s: float) -> frozenset[str]:
        """Return who has a stream with a sign of life in the live_s before; a sensor that nobody wears makes none."""
        earliest_ns = time_ns - round(live_s * SECOND_NS)
        live = {
            name.human_id
            for name, stream in self._streams.items()
            if any(sign and sign[0] >= earliest_ns for sign in [signs.at(time_ns) for signs in stream.live.values()])
        }
        return frozenset(live - {UNASSIGNED})

    def readings(self, human_id: str, time_ns: int) -> list[Reading]:
        """Return the newest heart rate of each source that a participant wears."""
        readings = []
        for name, stream in self._streams.items():
            for source, rates in stream.rates.items() if name.human_id == human_id else ():
                if newest := rates.at(time_ns):
                    age_s, rate = seconds(time_ns, newest[0]), newest[1]
                    topic = name.topic(source)
                    readings.append(
                        Reading(
                            name.sensor_type, name.sensor_id, source, rate.bpm, rate.quality, age_s, rate.reasons, topic
                        )
                    )
        return readings

    def _live(self, name: StreamName, receipt_ns: int, source: str) -> Stream:
        stream = self._streams.setdefault(name, Stream())
        stream.live.setdefault(source, Newest()).put(receipt_ns, None)
        return stream
