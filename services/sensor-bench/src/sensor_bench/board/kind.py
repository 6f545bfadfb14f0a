"""Microcontrollers as a kind of the bench."""

from dataclasses import dataclass
from typing import ClassVar

from sensor_bench.board.firmware import FORMATS, Sketch
from sensor_bench.device import Kind
from sensor_bench.room import Room
from sensor_bench.signals.measures import measures
from sensor_bench.wired import Behind, WireDevice, WireKeys


@dataclass(frozen=True, kw_only=True)
class BoardKeys(WireKeys):
    """One board as the configuration describes it."""

    form: str = "csv"
    rate_hz: float = 50.0
    ticks_hz: int = 1000
    first_tick: int = 0
    """What its clock shows at power-on: near 2^32, and it wraps soon."""
    skew_ppm: float = 0.0
    waits: bool = True
    """For `s`; ends with `x`."""

    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        *WireKeys.ranges,
        ("rate_hz", 0.1, 2000),
        ("ticks_hz", 1, 1_000_000),
        ("first_tick", 0, 2**32 - 1),
        ("skew_ppm", -1e4, 1e4),
    )

    def check(self) -> None:
        super().check()
        if self.form not in FORMATS:
            raise ValueError(f"form: {self.form!r} is not one of {', '.join(FORMATS)}")


class Board(WireDevice):
    """One board."""

    def __init__(self, room: Room, keys: BoardKeys) -> None:
        transit_s = room.participants[keys.participant].pulse_transit_s
        self._own = keys
        self._measures = measures(room.hearts[keys.participant], room.seed_of(keys.sensor, "signals"), transit_s)
        super().__init__(room, keys)

    def power_on(self, on_s: float) -> Behind:
        own = self._own
        return Sketch(
            self._measures,
            self.frames,
            on_s,
            form=own.form,
            rate_hz=own.rate_hz,
            ticks_hz=own.ticks_hz,
            first_tick=own.first_tick,
            skew_ppm=own.skew_ppm,
            waits=own.waits,
        )


BOARD = Kind(
    ("Board",),
    BoardKeys,
    Board,
    "form csv (also pairs, json, struct, cobs), rate_hz 50, ticks_hz 1000 (of its clock), "
    "first_tick 0 (what that shows at power-on; it wraps at 2^32), skew_ppm 0, waits true (for an s)",
)
