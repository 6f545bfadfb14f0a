"""Runs the driver of one strap, watch or oximeter."""

import sys

from sense4hri.driver import run_driver

from driver_ble_heart_rate.config import Config, streams_of
from driver_ble_heart_rate.device import Device
from driver_ble_heart_rate.transport import radio


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("ble_heart_rate", Config, streams_of, lambda config, _: Device(config, radio(config)))


if __name__ == "__main__":
    sys.exit(main())
