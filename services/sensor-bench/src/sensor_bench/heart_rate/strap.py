"""A virtual chest strap or watch: the Heart Rate service (0x180D)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bumble.gatt import Characteristic

from sensor_bench.ble.peripheral import READ, READABLE
from sensor_bench.ble.values import heart_rate_measurement
from sensor_bench.device import Kind, knob
from sensor_bench.heart_rate.beats import Beats
from sensor_bench.heart_rate.reporter import NOTES, Reporter, ReporterKeys, ReporterKnobs
from sensor_bench.room import Room

CHEST, WRIST = 1, 2
ENERGY_EVERY = 10
"""The energy is in every tenth report, as the service suggests."""
KJ_PER_REPORT = 0.1


@dataclass(frozen=True)
class StrapKnobs(ReporterKnobs):
    """The knobs of a strap or watch."""

    rr: bool | None = knob("reports carry RR intervals")


class Strap(Reporter):
    """Rate, contact, RR intervals where it has them, and energy."""

    knobs = StrapKnobs
    service, characteristic = 0x180D, "2A37"

    def __init__(self, room: Room, keys: ReporterKeys, beats: Beats, location: int, rr: bool) -> None:
        super().__init__(room, keys, beats, Characteristic("2A38", READ, READABLE, bytes([location])))
        self.rr, self._reported = rr, 0

    def report(self, since_s: float, now_s: float) -> bytes:
        self._reported += 1
        known = self.beats.known(since_s, now_s) if self.contact and self.rr else []
        return heart_rate_measurement(
            self.beats.rate_bpm(now_s) if self.contact else 0,
            [min(0xFFFF, round(beat.rr_s * 1024)) for beat in known],
            self.contact,
            None if self._reported % ENERGY_EVERY else round(self._reported * KJ_PER_REPORT),
        )

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {**super().turns(), "rr": lambda on: setattr(self, "rr", on)}


def make_strap(room: Room, keys: ReporterKeys) -> Strap:
    """A chest strap with RR intervals."""
    return Strap(room, keys, Beats(room, keys.participant), CHEST, rr=True)


def make_watch(room: Room, keys: ReporterKeys) -> Strap:
    """A watch, which sees pulses and sends no intervals."""
    transit_s = room.participants[keys.participant].pulse_transit_s
    return Strap(room, keys, Beats(room, keys.participant, transit_s), WRIST, rr=False)


STRAP = Kind(("HeartRateStrap",), ReporterKeys, make_strap, NOTES)
WATCH = Kind(("HeartRateWatch",), ReporterKeys, make_watch, NOTES)
