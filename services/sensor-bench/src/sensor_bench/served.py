"""A virtual device that is a server on the network: switched off, it is no longer there."""

from typing import Protocol

from sensor_bench.device import DeviceKeys, VirtualDevice
from sensor_bench.room import Room


class Server(Protocol):
    """What listens. starts_total: how often it was started."""

    starts_total: int

    async def start(self) -> None: ...

    async def stop(self) -> None: ...


class ServedDevice(VirtualDevice):
    """What is the same for all of them; a kind makes the server."""

    def __init__(self, room: Room, keys: DeviceKeys, server: Server) -> None:
        super().__init__(room, keys)
        self.server, self.down = server, False

    async def start(self) -> None:
        await self.server.start()

    async def stop(self) -> None:
        await self.server.stop()

    def link(self) -> tuple[bool, int]:
        return not self.down, self.server.starts_total

    async def switch_off(self, down: bool) -> None:
        """Close it, or open it again; its clock goes on."""
        if down and not self.down:
            await self.server.stop()
        elif self.down and not down:
            await self.server.start()
        self.down = down
