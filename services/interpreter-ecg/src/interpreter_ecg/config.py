"""Parameters of the ECG interpreter; rate, unit and channels of a stream come from its driver."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter


@dataclass(frozen=True)
class Config(Schema):
    """The same for every stream."""

    update_interval_s: float = parameter(
        1.0,
        help="sample time between two feature messages; above 1 s beats come later than 2 s",
        unit="s",
        low=0.05,
        high=60,
    )
    window_s: float = parameter(10.0, help="span of heart rate, beat count and quality", unit="s", low=2, high=600)
    hrv_window_s: float = parameter(300.0, help="longest span of heart-rate variability", unit="s", low=30, high=3600)
    hrv_min_quality: float = parameter(
        0.7,
        help="signal quality below which variability is withheld and beats do not enter it",
        low=0,
        high=1,
    )
    channel: str = parameter("", help="name of the lead to use; empty = the first one")
