"""What a board sends, as its YAML file describes it; everything wrong in it is named with its place."""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from sense4hri.device import Stream
from sense4hri.errors import ConfigError, Refusal
from sense4hri.modalities import check_unit
from sense4hri.schema import parameter
from sense4hri.serial_port import BAUD_RATES
from sense4hri.shapes import read

from driver_serial.checksums import CHECKSUMS

TYPES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "f32": "f", "f64": "d"}
TYPES |= dict.fromkeys(("u24", "i24"), "3s")  # `struct` knows no numbers of three bytes: their octets
ONE_BYTE_EACH = "latin-1"  # of what is written to a board: U+0000 to U+00FF are the bytes 00 to ff
TICKS_HZ = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
TEXT, BINARY = ("csv", "pairs", "json"), ("struct", "cobs")


@dataclass(frozen=True)
class Time:
    """The field with the board's own time of the sample."""

    field: str
    unit: str = parameter("ms", help="of a tick", choices=tuple(TICKS_HZ))
    bits: int = parameter(
        32, help="after which it begins again; Arduino's millis() and micros() have 32", low=8, high=64
    )


@dataclass(frozen=True)
class Counter:
    """The field that counts frames."""

    field: str
    bits: int = parameter(8, help="after which it begins again", low=1, high=32)


@dataclass(frozen=True)
class Channel:
    """value = field * scale + offset, in the stream's unit."""

    field: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Described:
    """One stream: every frame that holds all fields of its channels is a sample of it."""

    rate_hz: float = parameter(help="of its samples; 0 = irregular", low=0, high=100_000)
    unit: str = parameter(help="of its values, canonical")
    range: tuple[float, ...] = parameter(help="smallest and largest value, in the unit")
    bits: int = parameter(help="of the converter", low=1, high=64)
    channels: dict[str, Channel] = field(default_factory=dict)


@dataclass(frozen=True)
class Description:
    """One board. fields: of a csv line in order; of binary frames each with its type, as in `gsr u16`."""

    format: str = parameter(help="of a frame", choices=(*TEXT, *BINARY))
    streams: dict[str, Described] = field(default_factory=dict)
    fields: tuple[str, ...] = ()
    separator: str = ","
    begins: str = parameter(
        "",
        help="of a struct frame: its first bytes, hexadecimal",
        matches=r"([0-9A-Fa-f]{2} ?)*",
        form="bytes in two hexadecimal digits each",
    )
    byte_order: str = parameter("little", help="of binary numbers", choices=("little", "big"))
    checksum: str = parameter(
        "none", help="at the end; of text two or four hexadecimal digits after `*`", choices=tuple(CHECKSUMS)
    )
    time: Time | None = None
    counter: Counter | None = None
    baud_rate: int = parameter(115200, help="of a serial port", choices=tuple(sorted(BAUD_RATES)))
    start: str = parameter("", help="written once the board is connected")
    start_after_s: float = parameter(0.0, help="how long before; an Arduino boots for 2 s", low=0, high=30)
    stop: str = parameter("", help="written when the driver ends")
    vendor: str = ""
    model: str = ""

    @property
    def first_octets(self) -> bytes:
        """What begins a struct frame."""
        return bytes.fromhex(self.begins)

    @property
    def layout(self) -> str:
        """Format of a binary frame without beginning and checksum, for `struct`."""
        return ("<" if self.byte_order == "little" else ">") + "".join(TYPES[entry.split()[1]] for entry in self.fields)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields in order."""
        return tuple(entry.split()[0] for entry in self.fields)

    @property
    def of_three_bytes(self) -> dict[str, bool]:
        """Fields of 24 bits, and whether they have a sign."""
        entries = [entry.split() for entry in self.fields] if self.format in BINARY else []
        return {name: kind[0] == "i" for name, kind in entries if kind in ("u24", "i24") and name != "_"}

    @property
    def wanted(self) -> set[str]:
        """Names of the fields that become something."""
        channels = [channel.field for own in self.streams.values() for channel in own.channels.values()]
        return {*channels, *(each.field for each in (self.time, self.counter) if each)}

    def stream(self, sensor_type: str) -> Stream:
        """Return what the driver declares of a stream."""
        own = self.streams[sensor_type]
        return Stream(own.rate_hz, own.unit, own.range[0], own.range[1], own.bits, tuple(own.channels))


def load(path: str) -> Description:
    """Return what a file describes. Raises ConfigError with the place, or where there is no such file."""
    try:
        return parse(Path(path).read_text("utf-8"))
    except OSError as err:
        raise ConfigError(f"board: {path} cannot be read: {err.strerror}") from err
    except ValueError as err:
        raise ConfigError(f"board: {path}: {err}") from err


def parse(text: str) -> Description:
    """Return what a text describes. Raises ValueError with the place: a line, or keys as in `streams.eda.rate_hz`."""
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as err:
        raise ValueError(f"no YAML: {' '.join(str(err).split())}") from err
    try:
        found: Description = read(Description, content)
    except Refusal as err:
        raise ValueError(err.args[0]) from err
    for wrong in _mistakes(found):
        raise ValueError(wrong)
    return found


def _mistakes(found: Description) -> Any:
    """Yield what is wrong between several keys."""
    if found.format in BINARY and found.checksum == "nmea":
        yield "checksum is 'nmea', which is of text alone"
    yield from _field_mistakes(found)
    if not found.separator:
        yield "separator is empty"
    for key, command in (("start", found.start), ("stop", found.stop)):
        if any(ord(each) > 0xFF for each in command):
            yield f"{key} is {command!r}, must be of characters up to U+00FF, one a byte"
    yield from _frame_mistakes(found)
    if not found.streams:
        yield "streams is missing: at least one"
    for sensor_type, own in found.streams.items():
        yield from _stream_mistakes(f"streams.{sensor_type}", sensor_type, own)
    for place, name in _used_fields(found).items():
        if name and found.fields and (name == "_" or name not in found.names):
            yield f"{place} is {name!r}, which is not among the fields {', '.join(found.names)}"
    if found.format in BINARY:
        yield from _width_mistakes(found)


def _field_mistakes(found: Description) -> Any:
    kinds, also = "", ""
    if found.format in BINARY:
        kinds, also = f" ({'|'.join(TYPES)})", f" and one of {', '.join(TYPES)}"
    for index, entry in enumerate(found.fields):
        if not re.fullmatch(rf"\w+{kinds}", entry):
            yield f"fields[{index}] is {entry!r}, must be a name{also}"
    for index, again in enumerate(found.names):
        if again != "_" and again in found.names[:index]:
            yield f"fields[{index}] is {again!r}, as an earlier one: which of the two is meant?"


def _frame_mistakes(found: Description) -> Any:
    """Yield why frames could not be told apart, or their fields."""
    if not found.fields and found.format not in ("pairs", "json"):
        yield f"fields is missing: a frame of format {found.format} needs them in order"
    if found.format == "struct" and not found.begins:
        yield "begins is missing: nothing else shows where a struct frame begins; or send them as cobs"
    if found.format == "struct" and found.checksum == "none" and len(found.first_octets) == 1:
        yield f"begins is {found.begins!r}: without a checksum one byte is too little to know a frame by, at least two"


def _used_fields(found: Description) -> dict[str, Any]:
    """The field that each key names, by the key's place."""
    used = {"time.field": found.time and found.time.field, "counter.field": found.counter and found.counter.field}
    for sensor_type, own in found.streams.items():
        used |= {f"streams.{sensor_type}.channels.{name}.field": each.field for name, each in own.channels.items()}
    return used


def _width_mistakes(found: Description) -> Any:
    """A count that begins again before `bits` says so looks like a reset each time, a time below zero is none."""
    for key, wraps in (("time", found.time), ("counter", found.counter)):
        entry = next((each for each in found.fields if wraps and each.split()[0] == wraps.field), "_ f64")
        kind = entry.split()[1]
        if kind[0] == "i" and key == "time":
            yield f"time.field is {entry!r}, must be of a type without a sign: u{kind[1:]}"
        if wraps and kind[0] != "f" and wraps.bits > int(kind[1:]):
            yield f"{key}.bits is {wraps.bits}, must be at most the {kind[1:]} of its field {entry}"


def _stream_mistakes(place: str, sensor_type: str, own: Described) -> Any:
    if not re.fullmatch(r"[a-z][a-z0-9_]*", sensor_type):
        yield f"{place}: a sensor type is small letters, digits and _"
    if not own.channels:
        yield f"{place}.channels is missing: at least one"
    for name, each in own.channels.items():
        if not (math.isfinite(each.scale) and math.isfinite(each.offset)):
            yield f"{place}.channels.{name}: scale {each.scale:g} and offset {each.offset:g} must be finite"
    if len(own.range) != 2 or not -math.inf < own.range[0] < own.range[1] < math.inf:
        yield f"{place}.range is {list(own.range)}, must be a smaller and a larger number"
    try:
        check_unit(sensor_type, own.unit)
    except ValueError as err:
        yield f"{place}.unit: {err}"
