"""Runs the driver of one recording."""

import sys

from sense4hri.driver import run_driver

from driver_file.config import FileConfig
from driver_file.device import FilePlayer


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("file", FileConfig, lambda config: {}, FilePlayer)


if __name__ == "__main__":
    sys.exit(main())
