"""Runs the driver of one Polar sensor."""

import sys

from sense4hri.driver import run_driver

from driver_polar.config import PolarConfig, streams_of
from driver_polar.device import Polar
from driver_polar.transport import radio


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("polar", PolarConfig, streams_of, lambda config, streams: Polar(config, streams, radio(config)))


if __name__ == "__main__":
    sys.exit(main())
