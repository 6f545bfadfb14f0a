"""Runs the driver of one belt."""

import sys

from sense4hri.driver import run_driver

from driver_vernier.config import Config, streams_of
from driver_vernier.device import Device
from driver_vernier.transport import radio


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("vernier", Config, streams_of, lambda config, streams: Device(config, streams, radio(config)))


if __name__ == "__main__":
    sys.exit(main())
