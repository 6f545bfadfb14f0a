"""Parameters of the ECG interpreter; rate, unit and channels of a stream come from its driver."""

from dataclasses import dataclass

from sense4hri.interpreter_config import CardiacConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(CardiacConfig):
    """The same for every stream."""

    min_quality: float = parameter(0.5, help="signal quality below which heart rate is withheld", low=0, high=1)
    hrv_min_quality: float = parameter(
        0.7,
        help="signal quality below which variability is withheld and beats do not enter it",
        low=0,
        high=1,
    )
    channel: str = parameter("", help="name of the lead to use; empty = the first one")
