"""What each Polar model offers: measurement types, settings, frame types, GATT extras. Facts, no behaviour."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from sensor_bench.polar.pmd import Measurement, Setting

Offer = Mapping[Setting, tuple[float, ...]]

POLAR_COMPANY_ID: Final = 0x006B
MTU: Final = 232
"""The ATT MTU the sensors offer and need."""
FRAME_BUDGET: Final = MTU - 3 - 10
"""Content bytes of one data notification: MTU less ATT and frame headers; 73 raw ECG samples."""


@dataclass(frozen=True)
class Stream:
    """One PMD stream of a model."""

    measurement: Measurement
    name: str
    """Name in the bench's truth and in a device's `play` table."""
    channels: int
    frame_type: int
    sample_bytes: int
    """Bytes per value, in a raw frame or in the reference sample of a compressed one."""
    compressed: bool
    offer: Offer
    sdk_offer: Offer | None = None
    frame_samples: int = 0
    """Samples of a raw frame; 0 = as many as fit."""
    factor: float | None = None
    """Sent in the start response; values are counts times this."""
    reserved_byte: int | None = None
    """One meaningless byte at the end of the start response, as an H10 sends."""


@dataclass(frozen=True)
class Model:
    advertised: str
    """The middle word of the advertised name, `Polar <advertised> <id>`."""
    model_number: str
    streams: tuple[Stream, ...]
    body_location: int
    """Characteristic 2A38: 1 chest, 2 wrist, 0 other."""
    firmware: str
    has_rr: bool
    """Whether heart-rate notifications carry RR intervals."""
    sdk_mode: bool
    contact_supported: bool

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        kinds = tuple(stream.measurement for stream in self.streams)
        return (*kinds, Measurement.SDK_MODE) if self.sdk_mode else kinds

    def stream(self, measurement: int) -> Stream | None:
        return next((stream for stream in self.streams if stream.measurement == measurement), None)


def _motion_offer(rates: tuple[float, ...], ranges: tuple[float, ...]) -> Offer:
    return {Setting.RATE: rates, Setting.RESOLUTION: (16,), Setting.RANGE: ranges, Setting.CHANNELS: (3,)}


ECG = Stream(
    Measurement.ECG,
    "ecg",
    channels=1,
    frame_type=0,
    sample_bytes=3,
    compressed=False,
    offer={Setting.RATE: (130,), Setting.RESOLUTION: (14,)},
    frame_samples=73,
    reserved_byte=0,
)
H10_ACC = Stream(
    Measurement.ACC,
    "accelerometer",
    channels=3,
    frame_type=1,
    sample_bytes=2,
    compressed=False,
    offer={Setting.RATE: (25, 50, 100, 200), Setting.RESOLUTION: (16,), Setting.RANGE: (2, 4, 8)},
    frame_samples=36,
    reserved_byte=1,
)
VERITY_ACC = Stream(
    Measurement.ACC,
    "accelerometer",
    channels=3,
    frame_type=0,
    sample_bytes=2,
    compressed=True,
    offer=_motion_offer((52,), (8,)),
    sdk_offer=_motion_offer((26, 52, 104, 208, 416), (2, 4, 8, 16)),
    factor=2.44e-4,
)
VERITY_PPG = Stream(
    Measurement.PPG,
    "ppg",
    channels=4,
    frame_type=0,
    sample_bytes=3,
    compressed=True,
    offer={Setting.RATE: (55,), Setting.RESOLUTION: (22,), Setting.CHANNELS: (4,)},
    sdk_offer={Setting.RATE: (28, 44, 55, 135, 176), Setting.RESOLUTION: (22,), Setting.CHANNELS: (4,)},
)
OH1_PPG = Stream(
    Measurement.PPG,
    "ppg",
    channels=4,
    frame_type=0,
    sample_bytes=3,
    compressed=False,
    offer={Setting.RATE: (130,), Setting.RESOLUTION: (22,)},
    frame_samples=18,
)
OH1_ACC = Stream(
    Measurement.ACC,
    "accelerometer",
    channels=3,
    frame_type=1,
    sample_bytes=2,
    compressed=False,
    offer={Setting.RATE: (50,), Setting.RESOLUTION: (16,), Setting.RANGE: (8,)},
    frame_samples=36,
)
VERITY_GYRO = Stream(
    Measurement.GYRO,
    "gyroscope",
    channels=3,
    frame_type=0,
    sample_bytes=2,
    compressed=True,
    offer=_motion_offer((52,), (2000,)),
    sdk_offer=_motion_offer((26, 52, 104, 208, 416), (250, 500, 1000, 2000)),
    factor=2000 / 32768,
)
VERITY_MAG = Stream(
    Measurement.MAG,
    "magnetometer",
    channels=3,
    frame_type=0,
    sample_bytes=2,
    compressed=True,
    offer=_motion_offer((10, 20, 50, 100), (50,)),
    sdk_offer=_motion_offer((10, 20, 50, 100), (50,)),
    factor=50 / 32768,
)
PPI = Stream(Measurement.PPI, "ppi", channels=1, frame_type=0, sample_bytes=6, compressed=False, offer={})

MODELS: Final[Mapping[str, Model]] = {
    "H10": Model("H10", "H10", (ECG, H10_ACC), 1, "5.0.0", has_rr=True, sdk_mode=False, contact_supported=True),
    "VeritySense": Model(
        "Sense",
        "4J",
        (VERITY_PPG, VERITY_ACC, PPI, VERITY_GYRO, VERITY_MAG),
        2,
        "2.2.6",
        has_rr=False,
        sdk_mode=True,
        contact_supported=False,
    ),
    "OH1": Model(
        "OH1", "2L", (OH1_PPG, OH1_ACC, PPI), 2, "3.0.0", has_rr=False, sdk_mode=False, contact_supported=False
    ),
}
