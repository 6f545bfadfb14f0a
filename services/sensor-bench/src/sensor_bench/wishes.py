"""What may be asked of the bench over HTTP: one dataclass per request. What is not given stays as it is."""

from dataclasses import dataclass
from typing import Any

from sense4hri.schema import parameter


def _knob(text: str, low: float | None = None, high: float | None = None) -> Any:
    return parameter(None, help=text, low=low, high=high)


@dataclass(frozen=True)
class Knobs:
    """The knobs of one virtual sensor."""

    latency_s: float | None = _knob("delay of every packet", 0, 10)
    jitter_s: float | None = _knob("mean of a further, exponential delay", 0, 5)
    connection_interval_s: float | None = _knob("packets arrive on this grid only; 0: off", 0, 4)
    loss: float | None = _knob("probability that a data frame is thrown away", 0, 1)
    stall_s: float | None = _knob("nothing arrives that long, then everything at once", 0, 60)
    drop: bool | None = _knob("true: end the link")
    down: bool | None = _knob("switched off: no link, no advertisement")
    contact: bool | None = _knob("worn on skin")
    battery_percent: float | None = _knob("state of the battery", 0, 100)
    rssi_dbm: float | None = _knob("strength of its signal", -127, 20)
    skew_ppm: float | None = _knob("how much its clock gains on the host's", -10_000, 10_000)
    clock_reset: bool | str | None = _knob("true: as after an empty battery; or an ISO date and time")
    heart_rate_bpm: float | None = _knob("of a simulated participant", 25, 240)
    abort_connects: float | None = _knob("so many attempts to connect will fail", 0, 1000)
    garbled_frames: float | None = _knob("so many frames will be garbled", 0, 1000)
    stop_stream: str | None = _knob("a stream the firmware ends by itself")


@dataclass(frozen=True)
class AdapterWish:
    """The Bluetooth adapter of the host."""

    present: bool | None = _knob("plugged in")
    powered: bool | None = _knob("switched on")


@dataclass(frozen=True)
class FaceWish:
    """What the robot's camera sees of one face."""

    expression: str | None = _knob("a constant of hri_msgs/Expression")
    confidence: float | None = _knob("of the recognition", 0, 1)
    person: str | None = _knob("whose face it is; empty: not recognised")
    visible: bool | None = _knob("in the picture")


@dataclass(frozen=True)
class Turned:
    """The knobs of a sensor that were turned, and where to."""

    sensor: str
    set: dict[str, bool | float | str]


@dataclass(frozen=True)
class Switched:
    """What the adapter will be."""

    set: dict[str, bool]
