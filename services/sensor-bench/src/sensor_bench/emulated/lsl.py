"""A sender of LSL streams by its emulator's file.

The file has `OUTLETS`, by what follows the stream's name (empty for the one that is called so): content type, sensor
type of its samples, rate in Hz (0 = irregular), and label, unit and type of each channel. And `VirtualDevice` with
`send(time_s)`: what it has sampled since the last call, each row with its outlet and when that was; times in s since
it was switched on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensor_bench.device import DeviceKeys, Kind
from sensor_bench.emulated.file import loaded
from sensor_bench.lsl.feeds import Taken
from sensor_bench.lsl.machine import Outlet
from sensor_bench.lsl.sender import Sender
from sensor_bench.room import Room

ROUNDING_S = 1e-9  # of the end of one span and the beginning of the next


@dataclass(frozen=True, kw_only=True)
class EmulatedLslKeys(DeviceKeys):
    """One sender; name: of its stream; emulator: path of its file; session: LSL's SessionID."""

    name: str
    emulator: str
    session: str = ""


class EmulatedFeed:
    """What an emulator samples, on its outlets; what it samples while its machine is off is never taken."""

    def __init__(self, keys: EmulatedLslKeys) -> None:
        file = loaded(keys.emulator, "OUTLETS", "VirtualDevice")
        self._emulator, self._names = file.VirtualDevice(), tuple(file.OUTLETS)
        self.types: Sequence[tuple[str, ...]] = tuple((each[1],) for each in file.OUTLETS.values())
        self.outlets: Sequence[Outlet] = tuple(
            Outlet(
                f"{keys.name} {own}".strip(),
                content_type,
                f"bench-{keys.sensor}-{own}".rstrip("-"),
                float(rate_hz),
                "float32",
                tuple(channels),
            )
            for own, (content_type, _, rate_hz, channels) in file.OUTLETS.items()
        )

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        sampled = [each for each in self._emulator.send(to_s) if each[1] >= from_s - ROUNDING_S]
        found = []
        for number, name in enumerate(self._names):
            if mine := [(at_s, row) for outlet, at_s, row in sampled if outlet == name]:
                times_s, rows = zip(*mine, strict=True)
                found.append(Taken(number, np.array(times_s, np.float64), np.array(rows, np.float64)))
        return found


def make(room: Room, keys: EmulatedLslKeys) -> Sender:
    """A sender on its own machine."""
    return Sender(room, keys, EmulatedFeed(keys), keys.session, 0.0)


LSL = Kind(
    ("EmulatedLsl",),
    EmulatedLslKeys,
    make,
    'name (required, of its stream), emulator (required: the driver\'s emulator.py, see emulated/lsl.py), session ""',
)
