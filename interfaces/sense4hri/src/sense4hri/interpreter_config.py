"""Parameters that interpreters share because the contract fixes what they mean (sections 3 and 4). Imports no ROS."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter


@dataclass(frozen=True)
class InterpreterConfig(Schema):
    """Base of every interpreter's Config."""

    update_interval_s: float = parameter(
        1.0,
        help="sample time between two feature messages; above 1 s events may come later than 2 s",
        unit="s",
        low=0.2,
        high=10,
    )


@dataclass(frozen=True)
class CardiacConfig(InterpreterConfig):
    """Base of the Config of an interpreter that gives heart rate and variability."""

    window_s: float = parameter(10.0, help="span of rate, count, amplitude and quality", unit="s", low=4, high=60)
    hrv_window_s: float = parameter(300.0, help="longest span of variability", unit="s", low=30, high=3600)
