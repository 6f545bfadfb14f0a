"""How the device is reached: its services and characteristics over the kit's Bluetooth LE link."""

from sense4hri import gatt
from sense4hri.bluetooth_le import BleakRadio

from driver_ble_heart_rate.config import KINDS, Config
from driver_ble_heart_rate.device import CONTINUOUS, SPOT_CHECK


def radio(config: Config) -> BleakRadio:
    """Return what finds and connects the configured device."""
    return BleakRadio(config, (KINDS[config.kind].service,), (gatt.HEART_RATE, CONTINUOUS, SPOT_CHECK))
