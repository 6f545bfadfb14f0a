"""Parameters of the EEG interpreter; rate, unit and channels of a stream come from its driver."""

from dataclasses import dataclass
from itertools import pairwise

from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.schema import parameter

EDGES = 6


@dataclass(frozen=True)
class Config(InterpreterConfig):
    """The same for every stream."""

    window_s: float = parameter(
        20.0, help="span over which spectra are averaged, artefacts counted and quality told", unit="s", low=4, high=300
    )
    segment_s: float = parameter(
        2.0, help="length of one spectrum; half of it is the overlap (Welch)", unit="s", low=1, high=4
    )
    band_edges_hz: tuple[float, ...] = parameter(
        (1.0, 4.0, 8.0, 13.0, 30.0, 45.0),
        help="edges of delta, theta, alpha, beta, gamma: six rising numbers",
        unit="Hz",
        low=0.5,
        high=100,
    )
    reference: str = parameter(
        "none",
        help="average: of the good electrodes, from 8 on; linked: both ears or mastoids; none: as recorded",
        choices=("none", "average", "linked"),
    )
    blink_uv: float = parameter(50.0, help="least height of a blink at the forehead", unit="uV", low=10, high=1000)
    min_quality: float = parameter(
        0.25, help="channels below are called bad: no band powers, no part in any index", low=0, high=1
    )

    def __post_init__(self) -> None:
        """Raise ValueError for band edges that are not six rising numbers, or a window of less than two segments."""
        super().__post_init__()
        edges = self.band_edges_hz
        if len(edges) != EDGES or any(low >= high for low, high in pairwise(edges)):
            raise ValueError(f"parameter 'band_edges_hz' is {list(edges)}, must be six rising numbers")
        if self.window_s < 2 * self.segment_s:
            raise ValueError(f"parameter 'window_s' is {self.window_s:g}, must be at least twice segment_s")
