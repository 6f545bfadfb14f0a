"""Parameters of the EMG interpreter; each has a default that suits surface electrodes."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit, range and channels come from its driver."""

    window_s: float = parameter(
        1.0,
        help="span of amplitudes, frequencies and quality; no shorter than `update_interval_s`",
        unit="s",
        low=0.2,
        high=10,
    )
    onset_ratio: float = parameter(
        1.9, help="amplitude over that of rest from which a muscle is active", low=1.2, high=20
    )
    offset_ratio: float = parameter(
        1.35, help="amplitude over that of rest below which it is so no more; below `onset_ratio`", low=1.05, high=20
    )
    mvc_s: float = parameter(
        5.0, help="time after a marker `mvc` in which the greatest effort is looked for", unit="s", low=1, high=60
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.offset_ratio >= self.onset_ratio:
            raise ValueError("parameter 'offset_ratio' must be below 'onset_ratio'")
        if self.window_s < self.update_interval_s:
            raise ValueError("parameter 'window_s' must be no shorter than 'update_interval_s'")
