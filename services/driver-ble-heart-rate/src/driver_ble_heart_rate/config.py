"""Parameters of driver-ble-heart-rate, and what it says of the devices it knows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from sense4hri.device import Stream
from sense4hri.devices import NO_CLOCK, DeviceRow
from sense4hri.gatt import BluetoothConfig
from sense4hri.schema import parameter


class Kind(NamedTuple):
    """A kind of device: the sensor type its reports stand under, and its GATT service."""

    sensor_type: str
    service: str


KINDS = {"strap": Kind("ecg", "180d"), "watch": Kind("ppg", "180d"), "oximeter": Kind("ppg", "1822")}
HEART_RATE_REPORTS = ("heart_rate", "rr_interval", "contact", "energy_expended")
_LINK = "Bluetooth LE, bluetoothd or a stand-in"
_UNCOUNTED = "not noticed: reports carry no number"
DEVICES = (
    DeviceRow(
        device="any chest strap with the Heart Rate service: Garmin, Wahoo, Coospo, Movesense, ...",
        vendor="",
        streams={},
        reports=HEART_RATE_REPORTS,
        clock=NO_CLOCK,
        loss=_UNCOUNTED,
        link=_LINK,
        seen_on="virtual",
        chosen_by={"kind": "strap", "name": "HRM 0001"},
    ),
    DeviceRow(
        device="any watch or arm band with the Heart Rate service",
        vendor="",
        streams={},
        reports=HEART_RATE_REPORTS,
        clock=NO_CLOCK,
        loss=_UNCOUNTED,
        link=_LINK,
        seen_on="virtual",
        chosen_by={"kind": "watch", "name": "HRM 0001"},
    ),
    DeviceRow(
        device="any pulse oximeter with the Pulse Oximeter service",
        vendor="",
        streams={},
        reports=("spo2", "heart_rate", "pulse_amplitude_index", "contact"),
        clock="none for continuous measurements; 1 s of a spot check's date and time, where it is set",
        loss=_UNCOUNTED,
        link=_LINK,
        seen_on="virtual",
        chosen_by={"kind": "oximeter", "name": "Oximeter 0001"},
    ),
)


@dataclass(frozen=True, kw_only=True)
class Config(BluetoothConfig):
    """Which device, and what it is."""

    kind: str = parameter(
        "strap",
        help="strap: reports under ecg; watch, or any optical sensor, and oximeter: under ppg",
        choices=tuple(KINDS),
    )
    name: str = parameter(
        "", help="advertised name, or the id at its end as printed on the sensor", example="HRM-Dual 000000"
    )

    @property
    def reported_types(self) -> tuple[str, ...]:
        """Return the one sensor type that everything is reported under."""
        return (KINDS[self.kind].sensor_type,)


def streams_of(config: Config) -> Mapping[str, Stream]:
    """Return the raw streams: none, these devices only report."""
    return {}
