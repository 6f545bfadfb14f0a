"""A sender of one LSL stream by its emulator's file.

The file has `CONTENT_TYPE`, `RATE_HZ`, `CHANNELS` (label, unit and type of each), `SENSOR_TYPE`, and `VirtualDevice`
with `rows(first, count)`: a list of rows, of the samples from number `first` on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensor_bench.device import DeviceKeys, Kind
from sensor_bench.emulated.file import loaded
from sensor_bench.lsl.feeds import Taken, within
from sensor_bench.lsl.machine import Outlet
from sensor_bench.lsl.sender import Sender
from sensor_bench.room import Room


@dataclass(frozen=True, kw_only=True)
class EmulatedLslKeys(DeviceKeys):
    """One sender; name: of its stream; emulator: path of its file; session: LSL's SessionID."""

    name: str
    emulator: str
    session: str = ""


class EmulatedFeed:
    """The rows of an emulator, at its rate."""

    def __init__(self, keys: EmulatedLslKeys) -> None:
        file = loaded(keys.emulator, "CONTENT_TYPE", "RATE_HZ", "CHANNELS", "SENSOR_TYPE", "VirtualDevice")
        self._emulator, self._rate_hz = file.VirtualDevice(), float(file.RATE_HZ)
        channels = tuple(file.CHANNELS)
        source_id = f"bench-{keys.sensor}"
        self.outlets: Sequence[Outlet] = (
            Outlet(keys.name, file.CONTENT_TYPE, source_id, self._rate_hz, "float32", channels),
        )
        self.types: Sequence[tuple[str, ...]] = ((file.SENSOR_TYPE,),)

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        index = within(from_s, to_s, self._rate_hz)
        if not len(index):
            return []
        rows = np.array(self._emulator.rows(int(index[0]), len(index)), np.float64)
        return [Taken(0, index / self._rate_hz, rows)]


def make(room: Room, keys: EmulatedLslKeys) -> Sender:
    """A sender on its own machine."""
    return Sender(room, keys, EmulatedFeed(keys), keys.session, 0.0)


LSL = Kind(
    ("EmulatedLsl",),
    EmulatedLslKeys,
    make,
    'name (required, of its stream), emulator (required: the driver\'s emulator.py, see emulated/lsl.py), session ""',
)
