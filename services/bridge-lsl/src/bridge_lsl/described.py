"""What an outlet says of itself, and what a features message holds as channels. Pure."""

import math
from typing import Any, NamedTuple

from sense4hri import lsl
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo

UNITS = {"uV": "microvolts", "1": "normalized"}
"""As XDF's conventions write them; other units stay as they are. MNE-LSL takes a bare number for a power of ten."""
NOT_CHANNELS = ("header", "device_timestamp", "window_s")
STATED = {"vendor": "manufacturer", "model": "model", "serial_number": "serial_number", "body_location": "location"}
"""Parameters of a driver, as the XML calls them."""


class Outlet(NamedTuple):
    """One outlet; channels: label, unit, type of each; rate 0 = irregular. about: further words of its description."""

    name: str
    content_type: str
    source_id: str
    rate_hz: float
    form: str
    channels: tuple[tuple[str, str, str], ...]
    about: dict[str, str]


def of_raw(info: StreamInfo, channels: tuple[str, ...]) -> Outlet:
    """Return the outlet of a raw stream with these channels."""
    name = info.name
    kind = lsl.CONTENT_TYPES.get(name.sensor_type, name.sensor_type)
    about = {tag: str(info.parameters[key]) for key, tag in STATED.items() if info.parameters.get(key)}
    described = tuple((channel, _unit(info, channel), kind) for channel in channels)
    return Outlet(
        _name(name), kind, _source(*name, "raw"), info.sampling_frequency_hz, "double64", described, about | _who(name)
    )


def of_features(name: StreamName, labels: tuple[str, ...]) -> Outlet:
    """Return the outlet of a stream's features, which come irregularly."""
    described = tuple((label, "", "Feature") for label in labels)
    return Outlet(
        f"{_name(name)} features", "Features", _source(*name, "features"), 0.0, "double64", described, _who(name)
    )


def of_markers() -> Outlet:
    """Return the outlet of the study's markers: name, value, human_id."""
    described = tuple((label, "", "Marker") for label in ("name", "value", "human_id"))
    return Outlet("sense4hri markers", "Markers", _source("markers"), 0.0, "string", described, {})


def numbers(message: Any, prefix: str = "") -> dict[str, float]:
    """Return every number of a features message by its field's name, those within another message as `hrv.sdnn_ms`.

    Lists (events, channels) have no fixed length and are left out.
    """
    found: dict[str, float] = {}
    for field, kind in message.get_fields_and_field_types().items():
        value = getattr(message, field)
        if field in NOT_CHANNELS:
            continue
        if kind in ("double", "float") or (kind.startswith(("int", "uint")) and "[" not in kind) or kind == "boolean":
            found[prefix + field] = float(value)
        elif "/" in kind and "<" not in kind and "[" not in kind and not kind.startswith("builtin"):
            found |= numbers(value, f"{prefix}{field}.")
    return found


def row(values: dict[str, float], labels: tuple[str, ...]) -> list[float]:
    """Return the values in the order of the labels; NaN where one is missing."""
    return [values.get(label, math.nan) for label in labels]


def _unit(info: StreamInfo, channel: str) -> str:
    """Return the unit of one channel: that of the samples, but a `confidence` is a share (contract, section 2)."""
    unit = "1" if channel == "confidence" else info.unit
    return UNITS.get(unit, unit)


def _name(name: StreamName) -> str:
    return f"{name.human_id} {name.sensor_type} {name.sensor_id}"


def _source(*parts: str) -> str:
    """Return a source_id that no other study's outlets have: an inlet whose outlet goes takes up one that has its."""
    return f"{lsl.OURS}{'-'.join((lsl.domain(), *parts))}"


def _who(name: StreamName) -> dict[str, str]:
    return {"human_id": name.human_id, "sensor_id": name.sensor_id, "sensor_type": name.sensor_type}
