"""Parameters of the respiration interpreter; each has a default that suits rest and light activity."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit, range and channels come from its driver."""

    window_s: float = parameter(60.0, help="span of rate, counts, means and quality", unit="s", low=20, high=300)
    min_quality: float = parameter(
        0.25, help="signal quality below which rate, variability and amplitude are withheld", low=0, high=1
    )
