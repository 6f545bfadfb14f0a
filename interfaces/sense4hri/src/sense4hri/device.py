"""What a driver's device and the kit exchange: its parameters, what it declares, what it yields. Imports no ROS."""

import math
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sense4hri.chunk import Chunk
from sense4hri.errors import ConfigError, FrameError
from sense4hri.intake import LONGEST_NAME
from sense4hri.modalities import check_unit
from sense4hri.names import HUMAN_ID, HUMAN_ID_FORM, SENSOR_ID, SENSOR_ID_FORM, UNASSIGNED
from sense4hri.running_rate import RATE_TRUST
from sense4hri.schema import Rule, Schema, parameter

MESSAGE_S = 0.2
"""Of samples that a message holds where the driver may choose: sending it costs more than its samples do."""


@dataclass(frozen=True, kw_only=True)
class DriverConfig(Schema):
    """Parameters every driver has (contract, section 6); a driver's own schema inherits from it."""

    sensor_id: str = parameter(
        help="name of this sensor, unique in the study; part of every topic's name",
        matches=SENSOR_ID,
        form=SENSOR_ID_FORM,
        example="sensor_1",
    )
    human_id: str = parameter(
        UNASSIGNED,
        help="pseudonym of who wears it; settable at run time",
        matches=HUMAN_ID,
        form=HUMAN_ID_FORM,
        settable=True,
    )
    vendor: str = parameter("", help="who makes the device", settable=True)
    model: str = parameter("", help="name of the model", settable=True)
    serial_number: str = parameter("", help="empty = what the device says", settable=True)
    firmware_version: str = parameter("", help="empty = what the device says", settable=True)
    body_location: str = parameter("", help="where it is worn; empty = what the device says", settable=True)
    transport_delay_s: float = parameter(0.0, help="known part of the link's smallest delay", unit="s", low=0)

    @property
    def reported_types(self) -> tuple[str, ...]:
        """Sensor types that the device only reports under: their health is published from the start."""
        return ()

    @property
    def asks_rates(self) -> bool:
        """Whether only the connected device knows its rates: it is asked for those of a study, or tells its own then.

        It refuses what it cannot do, or declares what it does.
        """
        return False


def _of_stream(help: str, unit: str = "") -> Any:
    """Return a field that the driver alone sets; NaN = not known."""
    return field(metadata={"rule": Rule(help, unit, settable=True, nan=True)})


@dataclass(frozen=True)
class Stream:
    """What a driver says of one raw stream: rate in Hz (0 = irregular), unit, range in that unit, bits, channels."""

    sampling_frequency_hz: float = _of_stream("rate of the samples; 0 = they come irregularly", "Hz")
    unit: str = _of_stream("of the samples, as the contract spells it")
    range_min: float = _of_stream("smallest value that the device can give, in the unit; NaN = not known")
    range_max: float = _of_stream("largest value that the device can give, in the unit; NaN = not known")
    resolution_bits: int = _of_stream("of a sample as the device digitises it; 0 = not known", "bits")
    channel_names: tuple[str, ...] = _of_stream("in the order of the channels in a message")


class Samples(NamedTuple):
    """Samples of one stream of the device; of none at all nothing is published.

    times_ns: device time of every sample, shape (n,), where the device numbers or stamps each of them; the chunk may
    then have holes inside, and is published in parts that have none, that of a stream without a rate sample by sample.
    lost: of a device that counts instead of stamping, how many samples are missing before these; None = it does not
    count, and what is missing is known only where samples come at a rate and with device time.
    """

    sensor_type: str
    chunk: Chunk
    times_ns: NDArray[np.int64] | None = None
    lost: int | None = None


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


def number_text(value: float) -> str:
    """Return a number as the text of a marker, with every digit it has; whole ones without a point."""
    if float(value).is_integer():
        return str(int(value))
    single = np.float32(value)
    return str(single) if float(single) == value else repr(float(value))


class Marked(NamedTuple):
    """Something that the device says happened to its wearer: a button, a trigger, a recording's annotation.

    event_ns: on the host's clock, when it happened as far as known; device_ns: on the device's, None where it has none.
    """

    event_ns: int
    device_ns: int | None
    name: str
    value: str


class ClockMeasurement(NamedTuple):
    """The device's clock against the host's, measured over the link in both directions.

    At device_ns on the device's clock the host's wall clock showed device_ns + offset_ns. uncertainty_s: 95 % half
    width (at most half the round trip); NaN = not known. method: how it was measured, in a few words. received_ns: on
    the host's clock, when the measurement was complete.
    """

    received_ns: int
    device_ns: int
    offset_ns: int
    uncertainty_s: float
    method: str


class Declared(NamedTuple):
    """The raw streams of a device that says only once connected what it measures; by sensor type, all of them.

    Yielded before their first samples, and again after every reconnect. A stream's parameters given by the study win
    over what is declared here, except where the two contradict each other: see `check_stream`.
    """

    streams: Mapping[str, Stream]


class Status(NamedTuple):
    """News of the link; None = no news."""

    battery_percent: float | None = None
    rssi_dbm: float | None = None
    contact: float | None = None


class Identity(NamedTuple):
    """What the device says of itself; None = nothing. What the study has configured stays in any case."""

    vendor: str | None = None
    model: str | None = None
    serial_number: str | None = None
    firmware_version: str | None = None
    body_location: str | None = None


class Noted(NamedTuple):
    """Something about the device that whoever reads the log should know."""

    text: str


Item = Samples | Reported | Marked | ClockMeasurement | Declared | Status | Identity | Noted | FrameError


class Device(Protocol):
    """One physical sensor. Nothing in it knows about ROS."""

    def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, then yield until the link is lost: DeviceLost. ConfigError ends the driver."""


@runtime_checkable
class Hears(Protocol):
    """A device that also takes the study's markers, to keep them in a recording of its own."""

    def hear(self, marker: Marked) -> None:
        """Take a marker that concerns its wearer or everybody; none of its own comes back. Must not wait."""


def check_stream(sensor_type: str, own: Stream, stream: Stream) -> None:
    """Raise ConfigError that names the parameter where a stream's parameters cannot be.

    own: what the driver or its device says of the stream. stream: the same with the study's parameters in place of it.
    A study may rename channels, and correct range and resolution; the number of channels and the unit are the driver's.
    Only where own has no unit, because the device does not tell, the study must give it. The unit is a canonical one.
    """
    if not (math.isfinite(stream.sampling_frequency_hz) and stream.sampling_frequency_hz >= 0):
        raise ConfigError(
            f"parameter '{sensor_type}.sampling_frequency_hz' is {stream.sampling_frequency_hz:g}, "
            "must be 0 (irregular) or above"
        )
    if own.unit and stream.unit != own.unit:
        raise ConfigError(f"parameter '{sensor_type}.unit' is {stream.unit!r}, the driver sends {own.unit}")
    try:
        check_unit(sensor_type, stream.unit)
    except ValueError as err:
        raise ConfigError(f"parameter '{sensor_type}.unit': {err}") from err
    if len(stream.channel_names) != len(own.channel_names):
        raise ConfigError(f"parameter '{sensor_type}.channel_names' must name {len(own.channel_names)} channels")
    longest = max(stream.channel_names, key=len, default="")
    if len(longest) > LONGEST_NAME:  # whoever listens would refuse every message
        raise ConfigError(
            f"parameter '{sensor_type}.channel_names': a name of {len(longest)} characters, {longest[:20]!r}..; "
            f"at most {LONGEST_NAME} can be"
        )


def check_rate(sensor_type: str, own: Stream, stream: Stream) -> None:
    """Raise ConfigError where a study's rate is further from what the device says than `SampleClock` can correct."""
    own_hz, given_hz = own.sampling_frequency_hz, stream.sampling_frequency_hz
    if abs(given_hz - own_hz) > RATE_TRUST * own_hz:
        raise ConfigError(f"parameter '{sensor_type}.sampling_frequency_hz' is {given_hz:g}, the device has {own_hz:g}")
