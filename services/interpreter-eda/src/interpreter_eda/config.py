"""Parameters of the EDA interpreter; each has a default that suits a seated participant."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit, range and channels come from its driver."""

    window_s: float = parameter(60.0, help="span of level, counts, means and quality", unit="s", low=10, high=600)
    scr_threshold_us: float = parameter(
        0.01,
        help="least amplitude of a response; 0.05 where responses are compared with hand-scored ones",
        unit="uS",
        low=0.001,
        high=10,
    )
    least_level_us: float = parameter(
        0.2,
        help="conductance below which an electrode is taken for loose or dry; 0.05 for dry electrodes at the wrist",
        unit="uS",
        low=0,
        high=10,
    )
