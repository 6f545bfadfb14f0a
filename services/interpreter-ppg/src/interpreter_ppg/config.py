"""Parameters of the PPG interpreter; each has a default that suits rest and light activity."""

from dataclasses import dataclass, field

POLARITIES = {"auto": 0, "normal": 1, "inverted": -1}


@dataclass(frozen=True)
class Config:
    """The parameter schema."""

    update_interval_s: float = field(default=1.0, metadata={"help": "Sample time between two updates, s (0.2 to 10)."})
    window_s: float = field(default=10.0, metadata={"help": "Span of rate, count, amplitude and quality, s (4 to 60)."})
    hrv_window_s: float = field(default=300.0, metadata={"help": "Longest span of pulse-rate variability, s."})
    min_quality: float = field(
        default=0.5, metadata={"help": "Signal quality (0..1) below which heart rate and variability are withheld."}
    )
    polarity: str = field(
        default="auto",
        metadata={"help": "normal: blood volume raises the signal; inverted: lowers it; auto: found from its shape."},
    )

    def __post_init__(self) -> None:
        for name, low, high in (
            ("update_interval_s", 0.2, 10.0),
            ("window_s", 4.0, 60.0),
            ("hrv_window_s", 30.0, 3600.0),
            ("min_quality", 0.0, 1.0),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}, must be {low:g} to {high:g}")
        if self.polarity not in POLARITIES:
            raise ValueError(f"polarity is {self.polarity!r}, must be one of {', '.join(POLARITIES)}")
