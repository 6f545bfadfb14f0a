"""Offset, skew and uncertainty of every device clock on the graph."""

import sys

from sense4hri.run import run
from sense4hri.service import Service

from clock_sync.config import Config
from clock_sync.sync import ClockSync


async def serve(service: Service[Config]) -> None:
    """Keep the models until the service is told to stop."""
    ClockSync(service)
    service.ready()
    await service.stopped.wait()


def main() -> int:
    """Run until stopped."""
    return run("clock_sync", Config, serve)


if __name__ == "__main__":
    sys.exit(main())
