"""What really happened, for whoever checks the services: clocks, beats, samples. Times are in ns."""

from dataclasses import dataclass

from sensor_bench.bench import Bench
from sensor_bench.device import Happened
from sensor_bench.room import Room
from sensor_bench.signals.playback import RecordedHeart


@dataclass(frozen=True)
class Wearer:
    """A heart; `beats_host_ns` are its R peaks on the host's clock."""

    source: str
    heart_rate_bpm: float
    respiration_hz: float
    pulse_transit_s: float
    beats_host_ns: list[int]


@dataclass(frozen=True)
class Truth:
    """State of all clocks now, counts since the start, beats of the last `window_s`, none of the future."""

    host_ns: int
    start_ns: int
    wall_minus_host_ns: int
    window_s: float
    participants: dict[str, Wearer]
    devices: dict[str, Happened]


def truth(bench: Bench, window_s: float) -> Truth:
    """What really happened, with the beats of the last window_s."""
    room = bench.room
    host_ns = room.host.now_ns()
    return Truth(
        host_ns,
        room.start_ns,
        room.host.wall_offset_ns(),
        window_s,
        {name: _wearer(room, name, host_ns, window_s) for name in room.hearts},
        {name: device.happened(host_ns, window_s) for name, device in bench.devices.items()},
    )


def _wearer(room: Room, name: str, host_ns: int, window_s: float) -> Wearer:
    heart = room.hearts[name]
    recorded = isinstance(heart, RecordedHeart)
    return Wearer(
        "recording, beats found by neurokit2" if recorded else "simulation",
        heart.heart_rate_bpm,
        heart.respiration_hz,
        room.participants[name].pulse_transit_s,
        room.beats_ns(name, host_ns, window_s),
    )
