"""Parameters of the EOG interpreter; each has a default that suits electrodes round the eyes."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit, range and channels come from its driver."""

    window_s: float = parameter(60.0, help="span of counts, rates, means and quality", unit="s", low=10, high=300)
    least_blink_uv: float = parameter(40.0, help="least height of a blink", unit="uV", low=5, high=1000)
    least_saccade_uv: float = parameter(
        30.0, help="least amplitude of a saccade; 10 to 20 uV are a degree", unit="uV", low=5, high=1000
    )
    baseline_s: float = parameter(
        30.0, help="past whose median is the zero of horizontal_uv and vertical_uv", unit="s", low=5, high=300
    )
    min_quality: float = parameter(0.25, help="quality of a channel below which nothing is told of it", low=0, high=1)
