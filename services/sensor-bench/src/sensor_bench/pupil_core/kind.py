"""Pupil Core as a kind of the bench: its keys, its knobs, its truth."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sensor_bench.clock import DeviceClock
from sensor_bench.device import Counts, DeviceKeys, Happened, Kind, Knobs, knob
from sensor_bench.pupil_core.capture import VirtualCapture
from sensor_bench.pupil_core.server import CaptureServer
from sensor_bench.room import Room
from sensor_bench.served import ServedDevice

RESTARTED_NS = 1_000_000_000
"""What Pupil time is after a restart."""


@dataclass(frozen=True, kw_only=True)
class CoreKeys(DeviceKeys):
    """One Pupil Capture with two eye cameras as the configuration describes it."""

    port: int
    address: str = "127.0.0.1"
    """Of the machine it listens on."""
    eye_hz: float = 120.0
    phase_s: float = 0.003
    """By how much the left eye's camera is behind the right one's."""
    fitted: bool = True
    """Whether the 3d model of the eye is there, and with it sizes in mm."""
    calibrated: bool = True
    """Whether there is gaze."""
    pupil_time_s: float = 4000.0
    """What Capture's clock shows when the bench starts."""
    skew_ppm: float = 0.0

    unique: ClassVar[tuple[str, ...]] = (*DeviceKeys.unique, "port")
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        ("port", 1, 65535),
        ("eye_hz", 10, 200),
        ("phase_s", 0, 0.1),
        ("pupil_time_s", 0, 1e9),
        ("skew_ppm", -1e4, 1e4),
    )


@dataclass(frozen=True)
class CoreKnobs(Knobs):
    """What can be turned on a virtual Capture."""

    down: bool | None = knob("closed; opened again, its clock goes on")
    restart: bool | None = knob("closed and opened again with a clock that begins anew")
    loss: float | None = knob("share of messages of pupils and gaze that get lost", 0, 1)
    skew_ppm: float | None = knob("of Pupil time", -1e4, 1e4)
    fitted: bool | None = knob("the 3d model is there")
    calibrated: bool | None = knob("there is gaze")
    annotate: str | None = knob("somebody presses the key of an annotation with this label")
    record: bool | None = knob("somebody begins or ends a recording in Capture")


@dataclass(frozen=True, kw_only=True)
class CoreHappened(Happened):
    """A virtual Capture in `GET /truth`. messages: of gaze and pupils, made and lost; annotations: got from others."""

    pupil_time_ns: int
    skew_ppm: float
    resets: int
    messages: Mapping[str, Any]
    annotations: int


class CoreDevice(ServedDevice):
    """A virtual Capture at its port."""

    knobs: ClassVar[type[Knobs]] = CoreKnobs

    def __init__(self, room: Room, keys: CoreKeys) -> None:
        clock = DeviceClock(room.start_ns, round(keys.pupil_time_s * 1e9), keys.skew_ppm)
        self.capture = VirtualCapture(
            clock,
            room.start_ns,
            room.seed_of(keys.sensor, "network"),
            keys.eye_hz,
            (0.0, keys.phase_s),
            keys.fitted,
            keys.calibrated,
        )
        server = CaptureServer(self.capture, room.host, keys.address, keys.port)
        super().__init__(room, keys, server)
        self._now_s = server.now_s

    def standing(self) -> dict[str, Any]:
        capture = self.capture
        return {"down": self.down, "loss": capture.loss, "fitted": capture.model, "calibrated": capture.calibrated}

    def streams(self) -> dict[str, Any]:
        pupil = self.capture.counts["pupil"]
        rows = Counts(samples_sent=math.ceil(pupil.made / 2), frames_sent=pupil.made, frames_lost=pupil.lost)
        return {"pupillometry": vars(rows)}

    def happened(self, host_ns: int, window_s: float) -> CoreHappened:
        capture = self.capture
        segment = capture.clock.at(host_ns)
        return CoreHappened(
            **vars(super().happened(host_ns, window_s)),
            pupil_time_ns=segment.read_ns(host_ns),
            skew_ppm=segment.skew_ppm,
            resets=capture.clock.resets,
            messages={kind: vars(counts) for kind, counts in capture.counts.items()},
            annotations=len(capture.annotations),
        )

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        capture = self.capture
        return {
            **super().turns(),
            "down": self.switch_off,
            "restart": lambda on: self._restart() if on else None,
            "loss": lambda share: setattr(capture, "loss", share),
            "skew_ppm": lambda ppm: capture.clock.set_skew(self.room.host.now_ns(), ppm),
            "fitted": lambda on: setattr(capture, "model", on),
            "calibrated": lambda on: setattr(capture, "calibrated", on),
            "annotate": lambda label: capture.annotate(label, self._now_s()),
            "record": lambda on: capture.record(on, self._now_s()),
        }

    async def _restart(self) -> None:
        await self.switch_off(True)
        self.capture.restart(self.room.host.now_ns(), RESTARTED_NS)
        await self.switch_off(False)


CORE = Kind(
    ("PupilCore",),
    CoreKeys,
    CoreDevice,
    "port (required), address 127.0.0.1, eye_hz 120, phase_s 0.003 (between the eyes), fitted true (of the models), "
    "calibrated true, pupil_time_s 4000 (what its clock reads at first), skew_ppm 0",
)
