"""Runs the driver of one device's LSL outlets."""

import sys

from sense4hri.driver import run_driver

from driver_lsl.config import LslConfig
from driver_lsl.device import LslDevice


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("lsl", LslConfig, lambda config: {}, LslDevice)


if __name__ == "__main__":
    sys.exit(main())
