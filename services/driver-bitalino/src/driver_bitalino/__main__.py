"""Runs the driver of one BITalino."""

import sys

from sense4hri.driver import run_driver

from driver_bitalino.config import BitalinoConfig, streams_of
from driver_bitalino.device import Bitalino


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("bitalino", BitalinoConfig, streams_of, Bitalino)


if __name__ == "__main__":
    sys.exit(main())
