"""What the driver needs of a Bluetooth connection. `__main__` provides it; tests provide their own."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Protocol


class Link(Protocol):
    """One open connection. Every method raises DeviceLost when the link fails."""

    name: str
    rssi_dbm: float | None  # when the device was found; a connected device does not advertise
    mtu: int  # of ATT, bytes

    async def read(self, characteristic: str) -> bytes | None:
        """Return the value, None where the device has no such characteristic."""

    async def write(self, characteristic: str, value: bytes) -> None:
        """Write and wait for the acknowledgement."""

    async def subscribe(self, characteristic: str, receive: Callable[[bytes], None]) -> bool:
        """Hand every notification or indication to receive; False where there is no such characteristic."""


class Radio(Protocol):
    """Finds and connects the one sensor of this driver."""

    def connect(self, on_lost: Callable[[str], None]) -> AbstractAsyncContextManager[Link]:
        """Connect for the length of the context. on_lost(reason) is called when the link breaks.

        Raises DeviceLost that says why: no Bluetooth, sensor not found, in use by another driver.
        """
