"""What is known about a sensor, merged from its driver's parameters; pure."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from sense4hri.names import is_human_id

NAN = float("nan")
LONGEST_PARAMETERS = 1 << 16
"""Characters of JSON, of all parameters or of the channels' names; a driver has some thousand, a stranger megabytes."""
_DRIVER = ("vendor", "model", "serial_number", "firmware_version", "body_location")


@dataclass(frozen=True)
class Sensor:
    """One stream of one device: the fields of `SensorInfo`, NaN or empty where its driver does not say."""

    sensor_id: str
    sensor_type: str
    human_id: str
    node: str = ""
    host: str = ""
    vendor: str = ""
    model: str = ""
    serial_number: str = ""
    firmware_version: str = ""
    body_location: str = ""
    unit: str = ""
    sampling_frequency_hz: float = NAN
    range_min: float = NAN
    range_max: float = NAN
    resolution_bits: int = 0
    transport_delay_s: float = 0.0
    channel_names: tuple[str, ...] = field(default=())
    online: bool = False
    parameters_json: str = "{}"

    @property
    def key(self) -> tuple[str, str]:
        """What is unique in a study: a device, and what it measures."""
        return self.sensor_id, self.sensor_type


def describe(known: Sensor, parameters: Mapping[str, Any]) -> Sensor:
    """`known`, with what its driver's parameters say; what they do not say, or not in a usable way, stays as it was."""
    said: dict[str, Any] = {name: parameters[name] for name in _DRIVER if isinstance(parameters.get(name), str)}
    delay = _number("transport_delay_s", parameters.get("transport_delay_s"))
    said |= delay if all(map(math.isfinite, delay.values())) else {}
    stream = {
        name.partition(".")[2]: value
        for name, value in parameters.items()
        if name.partition(".")[0] == known.sensor_type
    }
    for name in ("sampling_frequency_hz", "range_min", "range_max"):
        said |= _number(name, stream.get(name))
    if isinstance(stream.get("unit"), str):
        said["unit"] = stream["unit"]
    bits = stream.get("resolution_bits")
    if isinstance(bits, int) and not isinstance(bits, bool) and 0 <= bits < 2**32:
        said["resolution_bits"] = bits
    names = stream.get("channel_names")
    if isinstance(names, list | tuple) and all(isinstance(name, str) for name in names) and _is_short(names):
        said["channel_names"] = tuple(names)
    return replace(known, **said, parameters_json=parameters_json(parameters) if parameters else known.parameters_json)


def wearer(sensor: Sensor) -> str:
    """On whom a sensor's parameters were read: they say so themselves; where they do not, as its topics were called."""
    told = json.loads(sensor.parameters_json).get("human_id")
    return told if isinstance(told, str) and is_human_id(told) else sensor.human_id


def parameters_json(parameters: Mapping[str, Any]) -> str:
    """A driver's parameters as a JSON object in a steady order; NaN and infinity, which JSON has not, become null."""
    text = json.dumps({name: _plain(parameters[name]) for name in sorted(parameters)}, allow_nan=False)
    if len(text) <= LONGEST_PARAMETERS:
        return text
    return json.dumps({"!too_long": f"{len(text)} characters of parameters, at most {LONGEST_PARAMETERS} are kept"})


def _number(name: str, value: Any) -> dict[str, float]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {name: float(value)}
    return {}


def _is_short(value: Any) -> bool:
    return len(json.dumps(value)) <= LONGEST_PARAMETERS


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value


class Claim(NamedTuple):
    """One node's claim to be the driver of a sensor_id."""

    sensor_id: str
    node: str
    """Full name of the node."""
    instance: str
    """Which run of the node it is: the DDS participant."""


class Duplicates:
    """Finds sensor_ids that two drivers claim at the same time.

    Two runs of one node are seen side by side for a while after a crash, because DDS forgets a process that vanished
    only when its lease ends (20 s); so the same node twice counts only when both last longer.
    """

    OTHER_NODE_S = 1.0
    SAME_NODE_S = 30.0

    def __init__(self) -> None:
        self._since_s: dict[Claim, float] = {}

    def find(self, claims: Iterable[Claim], now_s: float) -> dict[str, tuple[str, ...]]:
        """The nodes that claim one sensor_id together, by sensor_id; `now_s` is any monotonic clock."""
        self._since_s = {claim: self._since_s.get(claim, now_s) for claim in set(claims)}
        settled: dict[str, set[str]] = {}
        twice: dict[str, list[str]] = {}
        for claim, since_s in sorted(self._since_s.items()):
            if now_s - since_s >= self.OTHER_NODE_S:
                settled.setdefault(claim.sensor_id, set()).add(claim.node)
            if now_s - since_s >= self.SAME_NODE_S:
                twice.setdefault(claim.sensor_id, []).append(claim.node)
        found = {sensor_id: tuple(nodes) for sensor_id, nodes in twice.items() if len(nodes) > 1}
        return found | {sensor_id: tuple(sorted(nodes)) for sensor_id, nodes in settled.items() if len(nodes) > 1}
