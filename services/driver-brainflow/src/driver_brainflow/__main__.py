"""Runs the driver of one board."""

import sys

from sense4hri.driver import run_driver

from driver_brainflow.config import BrainflowConfig, streams_of
from driver_brainflow.device import Board


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("brainflow", BrainflowConfig, streams_of, Board)


if __name__ == "__main__":
    sys.exit(main())
