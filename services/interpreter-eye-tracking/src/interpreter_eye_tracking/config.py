"""Parameters of the eye tracking interpreter; each has a default that suits a tracker in front of a screen."""

from dataclasses import dataclass

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter

from interpreter_eye_tracking.areas import Area, read_areas


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream; rate, unit, channels and `px_per_deg` come from its driver."""

    window_s: float = parameter(60.0, help="span of counts, means, spread and quality", unit="s", low=10, high=600)
    least_fixation_s: float = parameter(0.05, help="a shorter rest is no fixation", unit="s", low=0.02, high=0.5)
    least_velocity_deg_per_s: float = parameter(
        30.0, help="no eye slower than this makes a saccade, however quiet the tracker", unit="deg/s", low=5, high=200
    )
    longest_blink_s: float = parameter(
        0.8, help="who is without gaze for longer does not blink: eyes closed, or away", unit="s", low=0.2, high=2
    )
    least_confidence: float = parameter(
        0.6, help="channel `confidence` below which there is no gaze, where a tracker has one", low=0, high=1
    )
    areas_file: str = parameter(
        "", help="YAML file of areas of interest, a list of `{name, rectangle}` or `{name, polygon}`; empty = none"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.areas()

    def areas(self) -> tuple[Area, ...]:
        """The areas of interest of the file; ValueError names the parameter and what is wrong in it."""
        try:
            return read_areas(self.areas_file) if self.areas_file else ()
        except ValueError as error:
            raise ValueError(f"areas_file: {error}") from error
