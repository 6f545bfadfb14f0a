"""Parameters of the motion interpreter; each has a default that suits a sensor at the trunk."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit, range, channels and place on the body come from its driver."""

    window_s: float = parameter(10.0, help="span of intensity, step rate and quality", unit="s", low=5, high=60)
    least_step: float = parameter(
        0.7, help="least rise of a step above what is round it", unit="m/s^2", low=0.1, high=10
    )
    upright_axis: str = parameter(
        "",
        help="axis that points up while the wearer stands; empty: learned while the wearer walks",
        choices=("", "x", "-x", "y", "-y", "z", "-z"),
    )
    trunk: str = parameter(
        "chest,sternum,trunk,back,waist,hip,belt",
        help="places, of which one is in a driver's `body_location` where the sensor tells the posture of its wearer",
    )
