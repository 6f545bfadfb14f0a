"""Parameters of the pupil interpreter; each has a default that suits a seated participant in steady light."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit and channels come from its driver."""

    window_s: float = parameter(1.0, help="span of sizes, speed, missing share and quality", unit="s", low=0.5, high=60)
    baseline_s: float = parameter(
        60.0, help="span whose median is the baseline while no marker has set one", unit="s", low=10, high=600
    )
    longest_gap_s: float = parameter(
        0.6, help="a blink with its margins up to which the size is drawn through", unit="s", low=0.1, high=2
    )
    activity_s: float = parameter(60.0, help="span of the index of pupillary activity", unit="s", low=20, high=300)
    least_confidence: float = parameter(
        0.6, help="channel `confidence` below which there is no pupil, where a tracker has one", low=0, high=1
    )
