"""What a virtual sensor is: what it says of itself, and who wears it."""

from collections.abc import Mapping
from dataclasses import dataclass

from sensor_bench.polar.models import Model
from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.sources import Source, Wearing


@dataclass
class Identity:
    """What a device says about itself."""

    device_id: str
    """The eight characters at the end of the advertised name."""
    serial_number: str
    model: Model

    @property
    def name(self) -> str:
        return f"Polar {self.model.advertised} {self.device_id}"


@dataclass
class Body:
    """Who wears the device and what it measures there."""

    heart: Rhythm
    wearing: Wearing
    sources: Mapping[str, Source]
    """By the name of the stream (`ecg`, `ppg`, `accelerometer`..)."""
    pulse_delay_s: float = 0.0
    """From the R peak to the beat as this device sees it."""
