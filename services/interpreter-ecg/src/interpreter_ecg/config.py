"""Parameters of the ECG interpreter; rate, unit and channels of a stream come from its driver."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Config:
    """The same for every stream."""

    update_interval_s: float = field(default=1.0, metadata={"help": "s of sample time between two feature messages."})
    window_s: float = field(default=10.0, metadata={"help": "s of signal for heart rate, beat count and quality."})
    hrv_window_s: float = field(default=300.0, metadata={"help": "s of signal, at most, for heart-rate variability."})
    hrv_min_quality: float = field(
        default=0.7, metadata={"help": "Signal quality (0..1) below which beats do not enter the variability."}
    )
    channel: str = field(default="", metadata={"help": "Name of the lead to use; empty: the first one."})

    def __post_init__(self) -> None:
        for name, low, high in (
            ("update_interval_s", 0.05, 60.0),
            ("window_s", 2.0, 600.0),
            ("hrv_window_s", 30.0, 3600.0),
            ("hrv_min_quality", 0.0, 1.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"parameter {name!r} is {value}, must be {low:g} to {high:g}")
