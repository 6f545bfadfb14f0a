"""Parameters of driver-polar, and what each model offers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from sense4hri.device import Stream
from sense4hri.devices import DeviceRow, Offered
from sense4hri.gatt import BluetoothConfig
from sense4hri.schema import parameter

from driver_polar.protocol import RADIANS, STANDARD_GRAVITY, XYZ, Measurement

HEART_RATE, PP_INTERVAL = "heart_rate", "pp_interval"
MEASUREMENTS = {
    "ecg": Measurement.ECG,
    "ppg": Measurement.PPG,
    "accelerometer": Measurement.ACCELERATION,
    "gyroscope": Measurement.GYROSCOPE,
    "magnetometer": Measurement.MAGNETOMETER,
    PP_INTERVAL: Measurement.PP_INTERVAL,
}


class Model(NamedTuple):
    """What a model measures: default rate in Hz by sensor type, streams started by default, where HR belongs."""

    rates_hz: Mapping[str, float]
    default_streams: tuple[str, ...]
    heart_rate_under: str
    has_pp_interval: bool
    has_sdk_mode: bool


MODELS = {
    "H10": Model({"ecg": 130, "accelerometer": 50}, ("ecg", "accelerometer", HEART_RATE), "ecg", False, False),
    "VeritySense": Model(
        {"ppg": 55, "accelerometer": 52, "gyroscope": 52, "magnetometer": 50},
        ("ppg", "accelerometer", PP_INTERVAL),
        "ppg",
        True,
        True,
    ),
    "OH1": Model({"ppg": 135, "accelerometer": 50}, ("ppg", "accelerometer", PP_INTERVAL), "ppg", True, False),
}
_CLOCK = "ns since 2000-01-01, of each frame's last sample; an H10's restarts at 2019 off its strap"
_LOSS = "device time against the number of samples, exact"
_LINK = "Bluetooth LE, bluetoothd or a stand-in"
_SEEN_ON = "virtual; captured bytes"
_MOTION = {
    "accelerometer": Offered("m/s^2", 26, 416),
    "gyroscope": Offered("rad/s", 26, 416),
    "magnetometer": Offered("uT", 10, 100),
}
DEVICES = (
    DeviceRow(
        device="Polar H10",
        vendor="Polar",
        streams={"ecg": Offered("uV", 130), "accelerometer": Offered("m/s^2", 25, 200)},
        reports=("heart_rate", "rr_interval", "contact", "energy_expended"),
        clock=_CLOCK,
        loss=_LOSS,
        link=_LINK,
        seen_on=_SEEN_ON,
        chosen_by={"model": "H10", "name": "1A2B3C01"},
    ),
    DeviceRow(
        device="Polar Verity Sense",
        vendor="Polar",
        streams={"ppg": Offered("counts", 28, 176), **_MOTION},
        reports=("heart_rate", "pp_interval", "pp_error", "blocked", "contact"),
        clock=_CLOCK,
        loss=_LOSS,
        link=_LINK,
        seen_on=_SEEN_ON,
        chosen_by={"model": "VeritySense", "name": "1A2B3C01", "streams": ("ppg", *_MOTION)},
    ),
    DeviceRow(
        device="Polar OH1",
        vendor="Polar",
        streams={"ppg": Offered("counts", 135), "accelerometer": Offered("m/s^2", 50)},
        reports=("heart_rate", "pp_interval", "pp_error", "blocked", "contact"),
        clock=_CLOCK,
        loss=_LOSS,
        link=_LINK,
        seen_on=_SEEN_ON,
        chosen_by={"model": "OH1", "name": "1A2B3C01"},
    ),
)
# Rates some firmware offers under another number: an OH1 says 130 Hz and streams 135, a Verity Sense before 2.1.0
# says 135 Hz and streams 55 (polar-ble-sdk, known issues).
OFFERED_AS: dict[tuple[str, float], float] = {("OH1", 135): 130, ("VeritySense", 55): 135}


@dataclass(frozen=True, kw_only=True)
class PolarConfig(BluetoothConfig):
    """Which sensor, and what of it. Rates are the parameters `<sensor_type>.sampling_frequency_hz`."""

    vendor: str = parameter("Polar Electro Oy", help="who makes the device, as the sensor says", settable=True)
    model: str = parameter("H10", help="of the sensor", choices=tuple(MODELS))
    name: str = parameter(
        "",
        help="advertised name (Polar H10 1234ABCD), or the id at its end as printed on the sensor",
        example="Polar H10 00000000",
    )
    streams: tuple[str, ...] = parameter(
        (),
        help="what is started; empty = ecg, accelerometer, heart_rate on an H10; "
        "ppg, accelerometer, pp_interval on a Verity Sense or OH1",
        choices=(*MEASUREMENTS, HEART_RATE),
    )
    sdk_mode: bool = parameter(
        False, help="Verity Sense: more rates, but the device computes no heart rate and no intervals"
    )
    accelerometer_range_g: int = parameter(
        8, help="asked of the sensor, as it offers: 2, 4 or 8 on an H10", unit="g", choices=(2, 4, 8, 16)
    )
    gyroscope_range_dps: int = parameter(
        2000, help="asked of the sensor, as it offers", unit="degrees per s", choices=(250, 500, 1000, 2000)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_streams(MODELS[self.model])

    def _check_streams(self, model: Model) -> None:
        offered = (*model.rates_hz, HEART_RATE, *((PP_INTERVAL,) if model.has_pp_interval else ()))
        for stream in self.streams:
            if stream not in offered:
                raise ValueError(f"streams {stream!r}: model {self.model} has {', '.join(offered)}")
        if len(set(self.streams)) < len(self.streams):
            raise ValueError(f"streams {list(self.streams)}: each at most once")
        if self.sdk_mode and not model.has_sdk_mode:
            raise ValueError(f"sdk_mode: model {self.model} has none")
        if self.sdk_mode and set(self.streams) & {HEART_RATE, PP_INTERVAL}:
            raise ValueError(f"sdk_mode: in it the device computes no {HEART_RATE} and no {PP_INTERVAL}")

    @property
    def asks_rates(self) -> bool:
        """True: the sensor offers several, and refuses others."""
        return True

    @property
    def started(self) -> tuple[str, ...]:
        """What is started, in this order."""
        if self.streams:
            return self.streams
        return tuple(s for s in MODELS[self.model].default_streams if not (self.sdk_mode and s == PP_INTERVAL))

    @property
    def heart_rate_under(self) -> str:
        """The sensor type under which the device's own heart rate is reported."""
        return MODELS[self.model].heart_rate_under


def streams_of(config: PolarConfig) -> dict[str, Stream]:
    """Return what the driver declares of each raw stream; one that only reports a heart rate has the rate 0."""
    rates_hz = MODELS[config.model].rates_hz
    gravity = STANDARD_GRAVITY * config.accelerometer_range_g
    turn = RADIANS * config.gyroscope_range_dps
    shapes = {
        "ecg": ("uV", -20_000.0, 20_000.0, 14, ("ecg",)),
        "ppg": ("counts", -(2.0**21), 2.0**21 - 1, 22, ("ppg_0", "ppg_1", "ppg_2", "ambient")),
        "accelerometer": ("m/s^2", -gravity, gravity, 16, XYZ),
        "gyroscope": ("rad/s", -turn, turn, 16, XYZ),
        "magnetometer": ("uT", -5000.0, 5000.0, 16, XYZ),
    }
    declared = {kind for kind in config.started if kind in shapes}
    if {HEART_RATE, PP_INTERVAL} & set(config.started):
        declared.add(config.heart_rate_under)
    return {
        kind: Stream(float(rates_hz[kind]) if kind in config.started else 0.0, *shape)
        for kind, shape in shapes.items()
        if kind in declared
    }
