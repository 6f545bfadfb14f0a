"""Runs the driver of one eye tracker."""

import sys

from sense4hri.driver import run_driver

from driver_pupil_labs.config import PupilConfig
from driver_pupil_labs.device import Core


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("pupil_labs", PupilConfig, lambda config: {}, Core)


if __name__ == "__main__":
    sys.exit(main())
