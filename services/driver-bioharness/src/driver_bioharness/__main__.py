"""Runs the driver of one BioHarness."""

import sys

from sense4hri.driver import run_driver

from driver_bioharness.config import BioHarnessConfig, streams_of
from driver_bioharness.device import BioHarness
from driver_bioharness.transport import linked


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver(
        "bioharness",
        BioHarnessConfig,
        streams_of,
        lambda config, streams: BioHarness(config, streams, lambda: linked(config.port)),
    )


if __name__ == "__main__":
    sys.exit(main())
