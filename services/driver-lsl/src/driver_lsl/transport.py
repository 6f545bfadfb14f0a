"""How the device is reached; the only place that imports a vendor's or a radio's library."""

from typing import Protocol

from sense4hri.errors import DeviceLost

from driver_lsl.emulator import Emulator


class Link(Protocol):
    """A connection to the device."""

    def read(self) -> bytes | None:
        """Wait a moment for a frame; None where none came. Raises DeviceLost."""

    def close(self) -> None:
        """Let go of the device."""


def connect(address: str) -> Link:
    """Connect to the device at this address. Raises DeviceLost where it is not there."""
    if address == "virtual":
        return Emulator()
    raise DeviceLost(f"{address}: no way to reach it is written yet")
