"""What is known of a raw stream (contract, section 6). Imports no ROS."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

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
NAN = float("nan")


@dataclass(frozen=True)
class StreamInfo:
    """What is known of one raw stream.

    sampling_frequency_hz: 0 = irregular. unit is empty and the ranges are NaN where unknown. source: `node`, `registry`
    or `data`. node: full name of the node that publishes `raw`. parameters: every sensor and stream parameter by its
    full name, as far as known; optional ones too (`eye_tracking.px_per_deg`).
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

    def optional(self, parameter: str) -> float:
        """Return an optional number such as `px_per_deg`; NaN where the driver does not give it."""
        return _number(self.parameters.get(f"{self.name.sensor_type}.{parameter}"))


def info_of(name: StreamName, source: str, node: str, values: dict[str, Any]) -> StreamInfo | None:
    """Return what the values say of a stream; None where they do not even say its rate."""
    stream: dict[str, Any] = {
        parameter: values.get(f"{name.sensor_type}.{parameter}") for parameter in STREAM_PARAMETERS
    }
    if math.isnan(_number(stream["sampling_frequency_hz"])):
        return None
    return StreamInfo(
        name,
        float(stream["sampling_frequency_hz"]),
        str(stream["unit"] or ""),
        tuple(stream["channel_names"] or ()),
        _number(stream["range_min"]),
        _number(stream["range_max"]),
        float(values.get("transport_delay_s") or 0.0),
        source,
        node,
        values,
    )


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
