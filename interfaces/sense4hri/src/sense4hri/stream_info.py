"""What is known of a raw stream (contract, section 6). Imports no ROS."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sense4hri.errors import Refused
from sense4hri.intake import LARGEST
from sense4hri.modalities import modality
from sense4hri.names import StreamName
from sense4hri.stamps import SECOND_NS

SENSOR_PARAMETERS = (
    "human_id",
    "sensor_id",
    "vendor",
    "model",
    "serial_number",
    "firmware_version",
    "body_location",
    "transport_delay_s",
)
STREAM_PARAMETERS = ("sampling_frequency_hz", "unit", "range_min", "range_max", "resolution_bits", "channel_names")
SLOWEST_HZ, FASTEST_HZ, LONGEST_DELAY_S, PERIODS = 1e-3, 1e6, 3600.0, 3
LONGEST_NAME, MOST_CHANNELS, SHOWN = 256, 1024, 40
NAN = float("nan")


@dataclass(frozen=True)
class StreamInfo:
    """What is known of one raw stream.

    sampling_frequency_hz: 0 = irregular. unit is empty and the ranges are NaN where unknown. source: `node`, `registry`
    or `data`. node: full name of the node that publishes `raw`. parameters: every sensor and stream parameter by its
    full name, as far as known; optional ones too (`eye_tracking.px_per_deg`). problem: why what was said of the stream
    cannot be used, in one sentence; nothing else of it is known then, and the stream cannot be interpreted.
    """

    name: StreamName
    sampling_frequency_hz: float
    unit: str = ""
    channel_names: tuple[str, ...] = ()
    range_min: float = NAN
    range_max: float = NAN
    transport_delay_s: float = 0.0
    source: str = "data"
    node: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    problem: str = ""

    def optional(self, parameter: str) -> float:
        """Return an optional number such as `px_per_deg`; NaN where the driver does not give it."""
        return _number(self.parameters.get(f"{self.name.sensor_type}.{parameter}"))


def info_of(name: StreamName, source: str, node: str, values: dict[str, Any]) -> StreamInfo | None:
    """Return what the values say of a stream; None where they do not even say its rate.

    Where one of them is none that a stream can have, the result says so in `problem`, and nothing else.
    """
    rate_hz = values.get(f"{name.sensor_type}.sampling_frequency_hz")
    if rate_hz is None or (isinstance(rate_hz, float) and math.isnan(rate_hz)):
        return None
    try:
        return _info(name, source, node, values)
    except Refused as err:
        return StreamInfo(name, 0.0, source=source, node=node, problem=f"{node or source} says {err}")


def _info(name: StreamName, source: str, node: str, values: dict[str, Any]) -> StreamInfo:
    """Return what the values say. Raises Refused that names the parameter."""
    prefix = f"{name.sensor_type}."
    for parameter in modality(name.sensor_type).parameters:
        _checked_number(values, prefix + parameter)
    for parameter in SENSOR_PARAMETERS[:-1]:
        _checked_text(values, parameter)
    return StreamInfo(
        name,
        _checked_rate(values, prefix + "sampling_frequency_hz"),
        _checked_text(values, prefix + "unit"),
        _checked_names(values, prefix + "channel_names"),
        _checked_number(values, prefix + "range_min"),
        _checked_number(values, prefix + "range_max"),
        _checked_delay(values, "transport_delay_s"),
        source,
        node,
        values,
    )


def long_s(least_s: float, nominal_hz: float) -> float:
    """Return so many seconds, or PERIODS of a slow stream's samples where these are longer. nominal_hz: 0 = no rate."""
    return max(least_s, PERIODS / nominal_hz) if nominal_hz > 0 else least_s


def can_be_rate(rate_hz: float) -> bool:
    """Return whether a stream can have this rate in Hz; 0 = irregular."""
    return rate_hz == 0 or SLOWEST_HZ <= rate_hz <= FASTEST_HZ


def _checked_rate(values: dict[str, Any], name: str) -> float:
    rate_hz = _checked_number(values, name)
    if not can_be_rate(rate_hz):
        raise Refused(f"{name} is {rate_hz:g}, must be 0 or within {SLOWEST_HZ:g} .. {FASTEST_HZ:g}")
    return rate_hz


def _checked_delay(values: dict[str, Any], name: str) -> float:
    delay_s = _checked_number(values, name)
    if abs(delay_s) > LONGEST_DELAY_S:
        raise Refused(f"{name} is {delay_s:g}, at most {LONGEST_DELAY_S:g} can be")
    return 0.0 if math.isnan(delay_s) else delay_s


def _checked_number(values: dict[str, Any], name: str) -> float:
    """Return a number; NaN where it is absent or NaN."""
    value = values.get(name)
    if value is None:
        return NAN
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > LARGEST:
        raise Refused(f"{name} is {_shown(value)}, must be a number up to {LARGEST:g}")
    return float(value)


def _checked_text(values: dict[str, Any], name: str) -> str:
    value = values.get(name, "")
    if value is None:
        return ""
    if not isinstance(value, str) or len(value) > LONGEST_NAME:
        raise Refused(f"{name} is {_shown(value)}, must be a text of at most {LONGEST_NAME} characters")
    return value


def _checked_names(values: dict[str, Any], name: str) -> tuple[str, ...]:
    value = values.get(name)
    if value is None:
        return ()
    if not isinstance(value, list | tuple) or len(value) > MOST_CHANNELS:
        raise Refused(f"{name} is {_shown(value)}, must be a list of at most {MOST_CHANNELS} names")
    return tuple(_checked_text({name: entry}, name) for entry in value)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def rate_of(stamps: list[tuple[int, int]]) -> float:
    """Return samples per second of (stamp of last sample in ns, samples) messages; 0 where that cannot be known."""
    if len(stamps) < 3:
        return 0.0
    times_ns, counts = (np.array(column, float) for column in zip(*stamps, strict=True))
    steps_s = np.diff(times_ns) / SECOND_NS
    good = (steps_s > 0) & (counts[1:] > 0)
    return float(1.0 / np.median(steps_s[good] / counts[1:][good])) if good.any() else 0.0


def _number(value: Any) -> float:
    """Return what a parameter says as a number, NaN where it says none: it comes from anybody on the graph."""
    return float(value) if isinstance(value, (int, float)) else NAN
