"""Start the bench as a service: virtual devices, ROS4HRI side, HTTP interface."""

import asyncio
import sys
from pathlib import Path

from sense4hri.errors import ConfigError
from sense4hri.service import Service, run

from .api import Api
from .bench import Bench
from .bus import BusError
from .config import BenchConfig
from .recordings import UnreadableRecordingError
from .ros4hri import Ros4Hri
from .scene import Scene


async def play(service: Service[BenchConfig]) -> None:
    """Run the bench until the service is stopped."""
    config = service.config
    cast = config.cast()
    bench = Bench(cast, Path(config.socket_path), config.seed, config.adapter, config.device_timeout_s)
    try:
        if not await _started(bench, service.stopped):
            return
        await bench.bluez.set_present(config.adapter_present)
        await bench.bluez.set_powered(config.adapter_powered)
        scene = Scene(cast.participants)
        for method, path, handler in Api(bench, scene, config.truth_window_s).routes():
            service.http.route(method, path, handler)
        if config.ros4hri:
            Ros4Hri(service, scene)
        service.log.info(f"DBUS_SYSTEM_BUS_ADDRESS={bench.bus.address}")
        service.ready(True)
        await service.stopped.wait()
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
    except UnreadableRecordingError as error:
        raise ConfigError(f"devices: {error}") from error
    return True


def main() -> int:
    """Entry point."""
    return run("sensor_bench", BenchConfig, play)


if __name__ == "__main__":
    sys.exit(main())
