"""Parameters of fusion-affect; every one has a default."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter

SOURCES = ("features", "device", "auto")


@dataclass(frozen=True)
class Config(Schema):
    """Which tree decides, and where the heart rate comes from; every threshold is in the tree's file."""

    tree_file: str = parameter("", help="decision tree (YAML); empty = the one shipped, `src/fusion_affect/tree.yaml`")
    heart_rate_source: str = parameter(
        "auto",
        help="features = computed by the interpreters; device = the sensors' own; auto = computed, else the sensors'",
        choices=SOURCES,
    )
    baseline_s: float = parameter(
        0.0,
        help="heart rate at first sight of a person that becomes the resting baseline; "
        "0 = only between the markers baseline_start and baseline_end",
        unit="s",
        low=0,
    )
