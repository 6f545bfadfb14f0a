"""What has come from every sensor stream: heart rates, the clock model, signs of life; pure."""

from __future__ import annotations

from collections.abc import Container, Mapping
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


def live_humans(worn: Mapping[tuple[str, str], int], time_ns: int, live_s: float) -> frozenset[str]:
    """Return who has a sensor with a sign of life in the live_s before; one that nobody wears makes none."""
    earliest_ns = time_ns - round(live_s * SECOND_NS)
    return frozenset({human_id for (_, human_id), sign_ns in worn.items() if sign_ns >= earliest_ns} - {UNASSIGNED})


@dataclass
class Stream:
    """What has come from one stream."""

    rates: dict[str, Newest[Rate]] = field(default_factory=dict)
    """By source: `features` and `device`."""
    model: ClockModel | None = None
    live: dict[str, Newest[None]] = field(default_factory=dict)
    """Its signs of life, by field."""
    ends: Newest[None] = field(default_factory=Newest)
    """When its driver said that it leaves."""
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

    def health(self, name: StreamName, receipt_ns: int, streaming: bool, ends: bool) -> bool:
        """Take what a driver says; return whether its stream begins."""
        stream = self._live(name, receipt_ns, "health") if streaming else self._streams.setdefault(name, Stream())
        if ends:
            stream.ends.put(receipt_ns, None)
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

    def worn(self, time_ns: int) -> dict[tuple[str, str], int]:
        """Return (sensor_id, human_id) and the newest sign of life: a sensor is on whom it spoke of last."""
        signs: dict[tuple[str, str], int] = {}
        newest: dict[str, int] = {}
        for name, stream in self._streams.items():
            end_ns, _ = stream.ends.at(time_ns) or (0, None)
            for said in stream.live.values():
                if sign := said.at(time_ns):
                    newest[name.sensor_id] = max(sign[0], newest.get(name.sensor_id, 0))
                    if sign[0] > end_ns:
                        wearer = name.sensor_id, name.human_id
                        signs[wearer] = max(sign[0], signs.get(wearer, 0))
        return {wearer: sign_ns for wearer, sign_ns in signs.items() if sign_ns == newest[wearer[0]]}

    def readings(self, human_id: str, time_ns: int, worn: Container[tuple[str, str]]) -> list[Reading]:
        """Return the newest heart rate of each source that a participant wears. worn: as at that time."""
        readings = []
        for name, stream in self._streams.items():
            wears = name.human_id == human_id and (name.sensor_id, human_id) in worn
            for source, rates in stream.rates.items() if wears else ():
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
