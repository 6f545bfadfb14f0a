"""Parameters of driver-lsl, and what it declares of its streams."""

from dataclasses import dataclass

from sense4hri.device import DriverConfig, Stream
from sense4hri.devices import DeviceRow, Offered
from sense4hri.schema import parameter

from driver_lsl.protocol import RATE_HZ

DEVICES = (
    DeviceRow(
        device="Driver lsl",
        vendor="",
        streams={"eda": Offered("uS", RATE_HZ)},
        clock="ms since it was switched on, 32 bits, of each frame's last sample",
        loss="device time against the number of samples",
        link="none yet",
        seen_on="its emulator",
    ),
)


@dataclass(frozen=True, kw_only=True)
class Config(DriverConfig):
    """Which device, and what of it."""

    address: str = parameter("virtual", help="where the device is; virtual = the one in emulator.py")


def streams_of(config: Config) -> dict[str, Stream]:
    """Return what the driver declares of each raw stream."""
    return {"eda": Stream(RATE_HZ, "uS", 0.0, 100.0, 16, ("eda",))}
