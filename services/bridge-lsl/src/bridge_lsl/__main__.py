"""Offers the graph's streams to the Lab Streaming Layer."""

import sys

from sense4hri.run import run
from sense4hri.service import Service

from bridge_lsl.bridge import Bridge
from bridge_lsl.config import Config
from bridge_lsl.outlets import configure


async def serve(service: Service[Config]) -> None:
    """Offer what is there until told to stop."""
    configure(service.config.session)
    Bridge(service)
    service.ready()
    await service.stopped.wait()


def main() -> int:
    """Run until stopped; return the exit status."""
    return run("bridge_lsl", Config, serve)


if __name__ == "__main__":
    sys.exit(main())
