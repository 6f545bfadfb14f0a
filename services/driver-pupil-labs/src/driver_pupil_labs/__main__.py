"""Runs the driver of one eye tracker."""

import sys
from collections.abc import Mapping

from sense4hri.device import Device, Stream
from sense4hri.driver import run_driver

from driver_pupil_labs.companion_device import Companion
from driver_pupil_labs.config import PupilConfig
from driver_pupil_labs.device import Core


def make_device(config: PupilConfig, streams: Mapping[str, Stream]) -> Device:
    """Return the eye tracker of the configured model."""
    return Core(config, streams) if config.model == "Core" else Companion(config, streams)


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver("pupil_labs", PupilConfig, lambda config: {}, make_device)


if __name__ == "__main__":
    sys.exit(main())
