"""Parameters of fusion-affect; every one has a default."""

from dataclasses import dataclass, field

SOURCES = ("features", "device", "auto")


@dataclass(frozen=True)
class Config:
    """Which tree decides, and where the heart rate comes from; every threshold is in the tree's file."""

    tree_file: str = field(default="", metadata={"help": "decision tree (YAML); empty = the one shipped"})
    heart_rate_source: str = field(
        default="auto",
        metadata={
            "help": "features = computed here; device = the sensor's own; auto = computed, else the sensor's own"
        },
    )
    baseline_s: float = field(
        default=0.0,
        metadata={
            "help": "s of heart rate at first sight of a person that become the resting baseline; "
            "0 = only between the markers baseline_start and baseline_end"
        },
    )

    def __post_init__(self) -> None:
        if self.heart_rate_source not in SOURCES:
            raise ValueError(
                f"parameter 'heart_rate_source' is {self.heart_rate_source!r}, must be one of {', '.join(SOURCES)}"
            )
        if not 0 <= self.baseline_s < float("inf"):
            raise ValueError(f"parameter 'baseline_s' is {self.baseline_s}, must be 0 or more")
