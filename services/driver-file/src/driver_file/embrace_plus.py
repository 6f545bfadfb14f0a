"""Empatica EmbracePlus, the Avro files of Empatica's cloud (schema 6), by fastavro: acceleration, pulse, skin, tags.

A file is one record of at most half an hour; each sensor has the UTC time of its first sample, in us, and a rate.
Field names and the conversion of acceleration are those of Empatica's published example script. The gyroscope is not
read: published scripts disagree about its scale. Steps and systolic peaks are not: they are made of what is read.
"""

import bz2
import functools
import lzma
import zlib
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import fastavro
import numpy as np
from fastavro.schema import SchemaParseException
from sense4hri.signal_files.content import Event, Sampled, Signal, SignalFile, UnreadableFileError, evenly

US_NS = 1000
MOST_BYTES = 1 << 24  # of a record, unpacked; half an hour has some 4 MB
XZ_BYTES = 1 << 28  # of memory that xz may ask for
UNPACKERS: Mapping[str, Callable[[], Any]] = {
    "deflate": lambda: zlib.decompressobj(-zlib.MAX_WBITS),  # without a head, as Avro has it
    "bzip2": bz2.BZ2Decompressor,
    "xz": lambda: lzma.LZMADecompressor(memlimit=XZ_BYTES),
}
FACTOR_SINCE = (6, 5, 0)
"""Schema from which the file says the acceleration's conversion factor, and no longer the ranges that make it."""
FIELDS = (
    ("accelerometer", "accelerometer", ("x", "y", "z"), "g"),
    ("bvp", "ppg", ("values",), "a.u."),
    ("eda", "eda", ("values",), "uS"),
    ("temperature", "temperature", ("values",), "degC"),
)
"""Name in the file, sensor type, its columns, unit."""
DAMAGES = (
    SchemaParseException,
    zlib.error,
    lzma.LZMAError,
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    EOFError,
    AttributeError,
)


def open_embrace_plus(path: Path) -> SignalFile:
    """Return what is in an Avro file. Raises UnreadableFileError: it holds nothing that an EmbracePlus measures."""
    try:
        with path.open("rb") as file:
            record = _record(file)
        raw, version = record["rawData"], tuple(record["schemaVersion"][part] for part in ("major", "minor", "patch"))
        signals = tuple(_signal(raw[each[0]], version, *each) for each in FIELDS if _holds(raw.get(each[0]), each[2]))
        events = tuple(Event(at * US_NS, "tag") for at in (raw.get("tags") or {}).get("tagsTimeMicros", ()))
    except DAMAGES as err:
        raise UnreadableFileError(f"{path}: no Avro file of an EmbracePlus: {type(err).__name__} {err}") from err
    if not signals:
        raise UnreadableFileError(f"{path}: nothing in {', '.join(each[0] for each in FIELDS)} of an EmbracePlus")
    return SignalFile(signals, events)


def _record(file: IO[bytes]) -> Any:
    """Return the first record of an Avro file, which is unpacked only as far as one may reach."""
    head = fastavro.reader(file)  # up to where the first block begins: its count of records, its length, its octets
    fastavro.schemaless_reader(file, "long", None)
    octets: Any = fastavro.schemaless_reader(file, "bytes", None)
    if head.codec != "null":
        octets = _unpacked(head.codec, octets)
    if len(octets) > MOST_BYTES:
        raise ValueError(f"its record unpacks to more than {MOST_BYTES} bytes")
    _check_items(head.writer_schema)
    return fastavro.schemaless_reader(BytesIO(octets), head.writer_schema, None)


def _unpacked(codec: str, octets: bytes) -> bytes:
    try:
        return bytes(UNPACKERS[codec]().decompress(octets, MOST_BYTES + 1))
    except OSError as err:  # so bzip2 calls damage; read again it is none the better
        raise ValueError(f"its {codec} is damaged: {err}") from err


def _check_items(schema: Any) -> None:
    """Raise ValueError where items of an array may take no bytes: no bound on the bytes would bound their number."""
    for part in _parts(schema):
        if isinstance(part, dict) and part.get("type") == "array" and not _has_width(part["items"], schema, ()):
            raise ValueError("an array of items that take no bytes")


def _parts(schema: Any) -> Iterator[Any]:
    """Yield a schema and all schemas in it."""
    yield schema
    inside = schema if isinstance(schema, list) else ()
    if isinstance(schema, dict):
        inside = [field["type"] for field in schema.get("fields", ())]
        inside += [schema[key] for key in ("items", "values", "type") if isinstance(schema.get(key), dict | list | str)]
    for part in inside:
        yield from _parts(part)


def _has_width(schema: Any, whole: Any, within: tuple[str, ...]) -> bool:
    """Whether a value of this schema takes a byte at least. within: names of the records that it is in."""
    if isinstance(schema, list):
        return True  # which of them it is
    if isinstance(schema, str):
        named = next((each for each in _parts(whole) if isinstance(each, dict) and each.get("name") == schema), None)
        return schema != "null" and (named is None or _has_width(named, whole, within))
    if schema["type"] == "record":
        name = schema["name"]
        return name in within or any(_has_width(each["type"], whole, (*within, name)) for each in schema["fields"])
    if schema["type"] == "fixed":
        return int(schema["size"]) > 0
    return schema["type"] in ("array", "map", "enum") or _has_width(schema["type"], whole, within)


def _holds(sensor: Mapping[str, Any] | None, columns: tuple[str, ...]) -> bool:
    """True where there are samples: what a study does not use is there and empty, its rate 0."""
    return bool(sensor and sensor[columns[0]])


def _signal(
    sensor: Mapping[str, Any], version: tuple[int, ...], name: str, kind: str, columns: tuple[str, ...], unit: str
) -> Signal:
    factor = _g_per_count(sensor["imuParams"], version) if "imuParams" in sensor else 1.0
    values = np.column_stack([np.asarray(sensor[column], np.float64) for column in columns]) * factor
    read = functools.partial(_read, float(sensor["samplingFrequency"]), sensor["timestampStart"] * US_NS, values)
    channels = columns if len(columns) > 1 else (name,)
    return Signal(channels, (unit,) * len(channels), read, kind)


def _read(fs_hz: float, start_ns: int, values: Any, wanted: tuple[int, ...]) -> Sampled:
    return evenly(fs_hz, values[:, list(wanted)], start_ns)


def _g_per_count(imu: Mapping[str, float], version: tuple[int, ...]) -> float:
    if version >= FACTOR_SINCE:
        return float(imu["conversionFactor"])
    return (imu["physicalMax"] - imu["physicalMin"]) / (imu["digitalMax"] - imu["digitalMin"])
