"""Parameters of clock-sync."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter


@dataclass(frozen=True)
class Config(Schema):
    """The parameter schema."""

    publish_interval_s: float = parameter(
        0.5, help="time of the message stamps between two models of a device", unit="s", low=0, high=1
    )
    latency_alarm_s: float = parameter(
        1.0,
        help="a device whose data are later than this is logged, once, and once when it has caught up",
        unit="s",
        low=0.001,
    )
    host: str = parameter(
        "", help="name of this host; empty = SENSE4HRI_HOST, which a study file's `host` sets, else the machine's own"
    )
    reference_host: str = parameter("", help="host whose clock all others are measured against; empty = the recorder's")
