"""`python -m sensor_bench.alone`: the virtual sensors without ROS, for BLE clients of any kind."""

import argparse
import asyncio
import logging
import signal
from pathlib import Path

from sensor_bench.bench import Bench
from sensor_bench.config import DEFAULT_DEVICES, Cast, parse


async def run(cast: Cast, socket: Path, seed: int) -> None:
    """Play until SIGINT or SIGTERM."""
    bench = Bench(cast, socket, seed)
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    try:
        await bench.start()
        print(f"DBUS_SYSTEM_BUS_ADDRESS={bench.bus.address}", flush=True)
        await stopped.wait()
    finally:
        await bench.stop()


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--socket", type=Path, default=Path("/tmp/sense4hri-bench/bus"), help="of the private D-Bus")
    options.add_argument("--devices", type=Path, help="YAML file with participants and devices (default: two pairs)")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--verbose", action="store_true")
    given = options.parse_args()
    logging.basicConfig(level=logging.INFO if given.verbose else logging.WARNING)
    cast = parse(given.devices.read_text() if given.devices else DEFAULT_DEVICES)
    asyncio.run(run(cast, given.socket, given.seed))


if __name__ == "__main__":
    main()
