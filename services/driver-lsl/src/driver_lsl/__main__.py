"""Runs the driver of one device."""

import sys

from sense4hri.driver import run_driver

from driver_lsl.config import Config, streams_of
from driver_lsl.device import Device


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("lsl", Config, streams_of, Device)


if __name__ == "__main__":
    sys.exit(main())
