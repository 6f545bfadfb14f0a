"""Parameters of clock-sync."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Config:
    """The parameter schema."""

    publish_interval_s: float = field(
        default=0.5, metadata={"help": "time of the message stamps between two models of a device, in s; at most 1"}
    )
    latency_alarm_s: float = field(default=1.0, metadata={"help": "a device's queue longer than this is logged, in s"})

    def __post_init__(self) -> None:
        if not 0.0 <= self.publish_interval_s <= 1.0:
            raise ValueError(f"publish_interval_s is {self.publish_interval_s}, must be 0 to 1")
        if not self.latency_alarm_s > 0.0:
            raise ValueError(f"latency_alarm_s is {self.latency_alarm_s}, must be above 0")
