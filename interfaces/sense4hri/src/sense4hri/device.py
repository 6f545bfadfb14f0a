"""What a driver's device and the kit exchange: its parameters, what it declares, what it yields. Imports no ROS."""

import math
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from sense4hri.chunk import Chunk
from sense4hri.errors import FrameError
from sense4hri.names import UNASSIGNED, is_human_id, is_sensor_id


@dataclass(frozen=True, kw_only=True)
class DriverConfig:
    """Parameters every driver has (contract, section 6); a driver's own schema inherits from it."""

    sensor_id: str = field(metadata={"help": "name of this sensor, unique in the study"})
    human_id: str = field(
        default=UNASSIGNED, metadata={"help": "pseudonym of who wears it; settable at run time", "settable": True}
    )
    vendor: str = field(default="", metadata={"settable": True})
    model: str = field(default="", metadata={"settable": True})
    serial_number: str = field(default="", metadata={"settable": True})
    firmware_version: str = field(default="", metadata={"settable": True})
    body_location: str = field(default="", metadata={"settable": True})
    transport_delay_s: float = field(default=0.0, metadata={"help": "known part of the link's smallest delay, s"})

    def __post_init__(self) -> None:
        if not is_sensor_id(self.sensor_id):
            raise ValueError(
                f"sensor_id {self.sensor_id!r}: small letters, digits and single '_', a letter first, at most 63"
            )
        if not is_human_id(self.human_id):
            raise ValueError(f"human_id {self.human_id!r}: letters, digits and single '_', a letter first, at most 63")
        if not (math.isfinite(self.transport_delay_s) and self.transport_delay_s >= 0):
            raise ValueError(f"transport_delay_s is {self.transport_delay_s}, must be 0 or more")


@dataclass(frozen=True)
class Stream:
    """What a driver says of one raw stream: rate in Hz (0 = irregular), unit, range in that unit, bits, channels."""

    sampling_frequency_hz: float
    unit: str
    range_min: float
    range_max: float
    resolution_bits: int
    channel_names: tuple[str, ...]


class Samples(NamedTuple):
    """Samples of one stream of the device."""

    sensor_type: str
    chunk: Chunk


class Feature(NamedTuple):
    """A value, or several, that the device computed itself."""

    name: str
    unit: str
    values: tuple[float, ...]


class Reported(NamedTuple):
    """What the device reports; device_ns is None where it gives no time."""

    sensor_type: str
    received_ns: int
    device_ns: int | None
    features: tuple[Feature, ...]


class Status(NamedTuple):
    """News of the link; None = no news."""

    battery_percent: float | None = None
    rssi_dbm: float | None = None
    contact: float | None = None


class Identity(NamedTuple):
    """What the device says of itself; None = nothing, and the configured value stays."""

    vendor: str | None = None
    model: str | None = None
    serial_number: str | None = None
    firmware_version: str | None = None
    body_location: str | None = None


Item = Samples | Reported | Status | Identity | FrameError


class Device(Protocol):
    """One physical sensor. Nothing in it knows about ROS."""

    def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, then yield until the link is lost: DeviceLost. ConfigError ends the driver."""
