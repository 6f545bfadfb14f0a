"""What all virtual devices share: true time, the participants with their hearts, one radio medium, all randomness."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from bumble.link import LocalLink

from sensor_bench.ble.stand_in import BluezStandIn
from sensor_bench.clock import HostClock
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.playback import RecordedHeart


@dataclass(frozen=True)
class Participant:
    """A person: one heart, and what the robot's camera sees of them."""

    heart_rate_bpm: float = 66.0
    respiration_hz: float = 0.25
    pulse_transit_s: float = 0.28
    """From R peak to the pulse's systolic peak at the wrist."""
    face: str = ""
    """Face id on the ROS4HRI side; empty = no camera sees this person."""
    expression: str = "neutral"


def seed_of(*parts: object) -> int:
    """A seed that depends on these parts alone, the same in every process."""
    return zlib.crc32(":".join(map(str, parts)).encode())


@dataclass
class Room:
    """Where the devices are; `hearts` by participant."""

    participants: Mapping[str, Participant]
    seed: int
    host: HostClock
    start_ns: int
    """True time at which the bench began: second 0 of all hearts and signals."""
    medium: LocalLink
    """The air between the Bluetooth devices."""
    bluez: BluezStandIn
    hearts: dict[str, Heart | RecordedHeart] = field(default_factory=dict)

    def seed_of(self, *parts: object) -> int:
        """A seed of the bench's own seed and these parts."""
        return seed_of(self.seed, *parts)

    def now_s(self) -> float:
        """True time since the start."""
        return (self.host.now_ns() - self.start_ns) * 1e-9

    def beats_ns(self, participant: str, host_ns: int, window_s: float, delay_s: float = 0.0) -> list[int]:
        """The beats of the last window_s, each delay_s after its R peak, on the host's clock; none of the future."""
        now_s = (host_ns - self.start_ns) * 1e-9
        beats = self.hearts[participant].beats(max(0.0, now_s - window_s) - delay_s, now_s - delay_s)
        return [self.start_ns + round((beat.time_s + delay_s) * 1e9) for beat in beats]
