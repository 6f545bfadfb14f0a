"""Start the bench as a service: virtual devices, ROS4HRI side, HTTP interface."""

import asyncio
import sys
from pathlib import Path

from sense4hri.errors import ConfigError
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.signal_files.content import UnreadableFileError

from sensor_bench.api import Api
from sensor_bench.bench import Bench
from sensor_bench.ble.bus import BusError
from sensor_bench.config import BenchConfig
from sensor_bench.ros4hri import Ros4Hri
from sensor_bench.scene import Scene


async def play(service: Service[BenchConfig]) -> None:
    """Run the bench until the service is stopped."""
    service.http.hold()
    config = service.config
    cast = config.cast()
    bench = Bench(cast, Path(config.socket_path), config.seed, config.adapter, config.device_timeout_s)
    try:
        if not await _started(bench, service.stopped):
            return
        await bench.bluez.adapter.set_present(config.adapter_present)
        await bench.bluez.adapter.set_powered(config.adapter_powered)
        scene = Scene(cast.participants)
        Api(bench, scene, config.truth_window_s).serve(service.http)
        service.http.all_served()
        if config.ros4hri:
            Ros4Hri(service, scene)
        service.log.info(f"DBUS_SYSTEM_BUS_ADDRESS={bench.bus.address}")
        service.ready(True)
        keeping = service.start(bench.keep_bus())
        await service.stopped.wait()
        keeping.cancel()
    finally:
        await bench.stop()


async def _started(bench: Bench, stopped: asyncio.Event) -> bool:
    """Start the bench, which takes seconds, unless the service is stopped meanwhile."""
    start, stop = asyncio.ensure_future(bench.start()), asyncio.ensure_future(stopped.wait())
    await asyncio.wait({start, stop}, return_when=asyncio.FIRST_COMPLETED)
    stop.cancel()
    start.cancel()
    try:
        await start
    except asyncio.CancelledError:
        return False
    except BusError as error:
        raise ConfigError(f"socket_path: {error}") from error
    except UnreadableFileError as error:
        raise ConfigError(f"devices: {error}") from error
    return True


def main() -> int:
    """Run until stopped; return the exit status."""
    return run("sensor_bench", BenchConfig, play)


if __name__ == "__main__":
    sys.exit(main())
