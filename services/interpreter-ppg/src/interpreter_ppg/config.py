"""Parameters of the PPG interpreter; each has a default that suits rest and light activity."""

from dataclasses import dataclass

from sense4hri.interpreter_config import CardiacConfig
from sense4hri.schema import parameter

POLARITIES = {"auto": 0, "normal": 1, "inverted": -1}


@dataclass(frozen=True)
class Config(CardiacConfig):
    """The same for every stream; rate, unit, range and channels come from its driver."""

    min_quality: float = parameter(
        0.5, help="signal quality below which heart rate and variability are withheld", low=0, high=1
    )
    polarity: str = parameter(
        "auto",
        help="normal: blood volume raises the signal; inverted: lowers it; auto: found from its shape",
        choices=tuple(POLARITIES),
    )
