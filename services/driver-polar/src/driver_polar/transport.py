"""How a Polar sensor is reached: its services and characteristics over the kit's Bluetooth LE link."""

from sense4hri.bluetooth_le import BleakRadio

from driver_polar.config import PolarConfig
from driver_polar.session import PMD_DATA

POLAR_SERVICES = ("180d", "feee", "fb005c80-02e7-f387-1cad-8acd2d8df0c8")


def radio(config: PolarConfig) -> BleakRadio:
    """Return what finds and connects the configured sensor."""
    return BleakRadio(config, POLAR_SERVICES, (PMD_DATA,))
