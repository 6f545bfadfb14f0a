"""Parameters of driver-shimmer, and what it declares of its streams."""

from collections.abc import Mapping
from dataclasses import dataclass

from sense4hri.device import DriverConfig, Stream
from sense4hri.devices import DeviceRow, Offered
from sense4hri.modalities import XYZ
from sense4hri.schema import parameter
from sense4hri.serial_port import ADDRESS, ADDRESS_FORM

from driver_shimmer.calibration import EXG_VOLTS
from driver_shimmer.protocol import TICKS_HZ, divider_of

MODELS: dict[str, tuple[str, ...]] = {  # what each measures, the streams started by default first
    "Shimmer3 GSR+": ("eda", "ppg", "accelerometer"),
    "Shimmer3 ECG": ("ecg", "accelerometer"),
    "Shimmer3 EMG": ("emg", "accelerometer"),
    "Shimmer3 IMU": ("accelerometer", "gyroscope", "magnetometer"),
}
MOTION = ("accelerometer", "gyroscope", "magnetometer")
USUAL_HZ = {"Shimmer3 GSR+": 128.0, "Shimmer3 ECG": 512.0, "Shimmer3 EMG": 1024.0, "Shimmer3 IMU": 51.2}
GYROSCOPE_DPS = (250, 500, 1000, 2000)
_GAINS = {"ecg": 4, "emg": 12}
_MOTION = {
    "accelerometer": Offered("m/s^2", 1, 1024),
    "gyroscope": Offered("rad/s", 1, 1024),
    "magnetometer": Offered("uT", 1, 1024),
}
_OWN = {
    "Shimmer3 GSR+": {"eda": Offered("uS", 1, 1024), "ppg": Offered("counts", 1, 1024)},
    "Shimmer3 ECG": {"ecg": Offered("uV", 1, 1024)},
    "Shimmer3 EMG": {"emg": Offered("uV", 1, 1024)},
    "Shimmer3 IMU": {},
}
DEVICES = tuple(
    DeviceRow(
        device=model,
        vendor="Shimmer",
        streams=_OWN[model] | _MOTION,
        reports=("gsr_range",) if model == "Shimmer3 GSR+" else (),
        clock="ticks of 1/32768 s since it was switched on, 24 bits unwrapped (512 s), of each sample",
        loss="device time of each sample against the period, exact",
        link="Bluetooth Classic or serial",
        seen_on="virtual",
        chosen_by={"model": model, "port": "/dev/rfcomm0", "streams": (*_OWN[model], *_MOTION)},
    )
    for model in MODELS
)


@dataclass(frozen=True, kw_only=True)
class ShimmerConfig(DriverConfig):
    """Which Shimmer, and what of it."""

    vendor: str = parameter("Shimmer", help="who makes the device", settable=True)
    model: str = parameter("Shimmer3 GSR+", help="which board is on it", choices=tuple(MODELS))
    port: str = parameter(
        help="where it is; a Shimmer is paired with the PIN 1234",
        matches=ADDRESS,
        form=ADDRESS_FORM,
        example="/dev/rfcomm0",
    )
    streams: tuple[str, ...] = parameter(
        (),
        help="what is sampled; empty = eda, ppg, accelerometer of a GSR+; ecg, accelerometer; emg, accelerometer; "
        "accelerometer, gyroscope, magnetometer of an IMU",
        choices=("eda", "ppg", "ecg", "emg", *MOTION),
    )
    rate_hz: float = parameter(
        0.0,
        help="of all streams; the device divides 32768 by a whole number; 0 = 128 (GSR+), 512 (ECG), 1024 (EMG), "
        "51.2 (IMU)",
        unit="Hz",
        low=0,
        high=1024,
    )
    gyroscope_range_dps: int = parameter(
        500, help="largest rotation it can tell", unit="degrees per s", choices=GYROSCOPE_DPS
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        offered = (*_OWN[self.model], *MOTION)
        for stream in self.streams:
            if stream not in offered:
                raise ValueError(f"streams {stream!r}: model {self.model} has {', '.join(offered)}")
        if len(set(self.streams)) < len(self.streams):
            raise ValueError(f"streams {list(self.streams)}: each at most once")
        if 0 < self.rate_hz < 1:
            raise ValueError(f"rate_hz is {self.rate_hz:g}, must be 0 or 1 to 1024 Hz")

    @property
    def sampled(self) -> tuple[str, ...]:
        """What is sampled."""
        return self.streams or MODELS[self.model]

    @property
    def divider(self) -> int:
        """Ticks of the device's clock between two samples."""
        return divider_of(self.rate_hz or USUAL_HZ[self.model])


def streams_of(config: ShimmerConfig) -> dict[str, Stream]:
    """Return what the driver declares of each raw stream."""
    rate_hz = TICKS_HZ / config.divider
    shapes: Mapping[str, tuple[str, float, float, int, tuple[str, ...]]] = {
        "eda": ("uS", 0.0, 125.0, 12, ("eda",)),
        "ppg": ("counts", 0.0, 4095.0, 12, ("ppg_0",)),
        "ecg": ("uV", *_span_uv("ecg"), 24, ("II", "I", "Vx")),
        "emg": ("uV", *_span_uv("emg"), 24, ("emg_1", "emg_2")),
        "accelerometer": ("m/s^2", -20.0, 20.0, 12, XYZ),
        "gyroscope": ("rad/s", *_turn(config), 16, XYZ),
        "magnetometer": ("uT", -190.0, 190.0, 16, XYZ),
    }
    return {each: Stream(rate_hz, *shapes[each]) for each in config.sampled}


def _span_uv(sensor_type: str) -> tuple[float, float]:
    span_uv = EXG_VOLTS * 1e6 / _GAINS[sensor_type]
    return (-span_uv, span_uv)


def _turn(config: ShimmerConfig) -> tuple[float, float]:
    turn = config.gyroscope_range_dps * 3.141592653589793 / 180
    return (-turn, turn)
