"""How the belt is reached: Vernier's service over the kit's Bluetooth LE link."""

from sense4hri.bluetooth_le import BleakRadio

from driver_vernier.config import Config
from driver_vernier.device import NOTIFY

SERVICE = "d91714ef-28b9-4f91-ba16-f0d9a604f112"


def radio(config: Config) -> BleakRadio:
    """Return what finds and connects the configured belt."""
    return BleakRadio(config, (SERVICE,), (NOTIFY,))
