"""Runs the driver of one Shimmer3."""

import sys

from sense4hri.driver import run_driver

from driver_shimmer.config import ShimmerConfig, streams_of
from driver_shimmer.device import Shimmer
from driver_shimmer.transport import linked


def main() -> int:
    """Run the driver until it is told to stop; return the exit status."""
    return run_driver(
        "shimmer",
        ShimmerConfig,
        streams_of,
        lambda config, streams: Shimmer(config, streams, lambda: linked(config.port)),
    )


if __name__ == "__main__":
    sys.exit(main())
