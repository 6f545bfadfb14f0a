"""What may be asked of the bench over HTTP; what is not given stays as it is. Knobs are of the kind of device."""

from dataclasses import dataclass

from sensor_bench.device import knob


@dataclass(frozen=True)
class AdapterWish:
    """The Bluetooth adapter of the host."""

    present: bool | None = knob("plugged in")
    powered: bool | None = knob("switched on")


@dataclass(frozen=True)
class FaceWish:
    """What the robot's camera sees of one face."""

    expression: str | None = knob("a constant of hri_msgs/Expression")
    confidence: float | None = knob("of the recognition", 0, 1)
    person: str | None = knob("whose face it is; empty: not recognised")
    visible: bool | None = knob("in the picture")


@dataclass(frozen=True)
class Turned:
    """The knobs of a sensor that were turned, and where to."""

    sensor: str
    set: dict[str, bool | float | str]


@dataclass(frozen=True)
class Switched:
    """What the adapter will be."""

    set: dict[str, bool]
