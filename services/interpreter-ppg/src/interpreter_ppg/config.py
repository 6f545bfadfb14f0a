"""Parameters of the PPG interpreter; each has a default that suits rest and light activity."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter

POLARITIES = {"auto": 0, "normal": 1, "inverted": -1}


@dataclass(frozen=True)
class Config(Schema):
    """The same for every stream; rate, unit, range and channels come from its driver."""

    update_interval_s: float = parameter(
        1.0,
        help="sample time between two feature messages; above 1.2 s pulses come later than 2 s",
        unit="s",
        low=0.2,
        high=10,
    )
    window_s: float = parameter(10.0, help="span of pulse rate, count, amplitude and quality", unit="s", low=4, high=60)
    hrv_window_s: float = parameter(300.0, help="longest span of pulse-rate variability", unit="s", low=30, high=3600)
    min_quality: float = parameter(
        0.5, help="signal quality below which heart rate and variability are withheld", low=0, high=1
    )
    polarity: str = parameter(
        "auto",
        help="normal: blood volume raises the signal; inverted: lowers it; auto: found from its shape",
        choices=tuple(POLARITIES),
    )
