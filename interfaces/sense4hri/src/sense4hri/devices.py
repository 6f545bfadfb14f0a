"""What a driver says of the devices it knows: the rows of docs/devices.md. Imports no ROS.

Each driver's `config.py` has `DEVICES`, a tuple of these; `make generate` writes the page, and a contract test holds
each row against what the driver declares of its streams.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sense4hri.device import Stream
from sense4hri.modalities import check_unit

ANY = "any signal"
"""Stands for the sensor type where a device may carry any."""
NO_CLOCK = "none: host"


class Offered(NamedTuple):
    """One kind of samples of a device: canonical unit, slowest and fastest rate in Hz.

    One rate alone: `Offered("uV", 130)`; 0 = irregular. NaN: any rate (the device's own configuration says it).
    """

    unit: str
    lowest_hz: float
    highest_hz: float = math.nan

    @property
    def rates(self) -> str:
        """The rates in words, as in `26 to 416 Hz`."""
        if math.isnan(self.lowest_hz):
            return "any rate"
        if math.isnan(self.highest_hz) or self.highest_hz == self.lowest_hz:
            return f"{self.lowest_hz:g} Hz" if self.lowest_hz else "irregular"
        return f"{self.lowest_hz:g} to {self.highest_hz:g} Hz" if self.lowest_hz else f"up to {self.highest_hz:g} Hz"

    def includes(self, rate_hz: float) -> bool:
        """True for a rate that a device like this may stream at."""
        highest_hz = self.lowest_hz if math.isnan(self.highest_hz) else self.highest_hz
        return math.isnan(self.lowest_hz) or self.lowest_hz <= rate_hz <= highest_hz


@dataclass(frozen=True, kw_only=True)
class DeviceRow:
    """One device, or a family that behaves alike.

    streams: its raw samples by sensor type (`ANY`, any signal). reports: what it computes itself, as named in `device`
    messages. clock: what its time is, its resolution, when it wraps; `NO_CLOCK` where it has none. loss: how lost
    samples are noticed. link: how it is reached. seen_on: virtual, recordings, captured bytes, hardware. chosen_by:
    parameters of the driver with which it starts every stream of this row.
    """

    device: str
    vendor: str
    streams: Mapping[str, Offered]
    reports: tuple[str, ...] = ()
    clock: str
    loss: str
    link: str
    seen_on: str
    chosen_by: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("device", "clock", "loss", "link", "seen_on"):
            if not getattr(self, name):
                raise ValueError(f"device {self.device!r}: {name} is empty")
        if not (self.streams or self.reports):
            raise ValueError(f"device {self.device!r}: neither streams nor reports")
        for sensor_type, offered in self.streams.items():
            if sensor_type != ANY:
                check_unit(sensor_type, offered.unit)


def departures(row: DeviceRow, declared: Mapping[str, Stream]) -> list[str]:
    """Return a sentence for each thing that a row says otherwise than the driver declares.

    declared: what the driver's `streams_of` returns for the row's `chosen_by`. A rate of 0 may be reports alone.
    """
    said, found = row.streams, []
    for sensor_type, stream in declared.items():
        if sensor_type not in said:
            if stream.sampling_frequency_hz:
                found.append(f"{row.device}: {sensor_type} is declared and not in the row")
        elif stream.unit != said[sensor_type].unit:
            found.append(f"{row.device}: {sensor_type} is in {stream.unit}, the row says {said[sensor_type].unit}")
        elif not said[sensor_type].includes(stream.sampling_frequency_hz):
            rates = said[sensor_type].rates
            found.append(f"{row.device}: {sensor_type} has {stream.sampling_frequency_hz:g} Hz, the row says {rates}")
    return found + [f"{row.device}: {each} is in the row and not declared" for each in said if each not in declared]
