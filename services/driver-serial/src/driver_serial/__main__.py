"""Runs the driver of one board."""

import sys

from sense4hri.driver import run_driver

from driver_serial.config import SerialConfig
from driver_serial.device import Board


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("serial", SerialConfig, lambda config: {}, Board)


if __name__ == "__main__":
    sys.exit(main())
