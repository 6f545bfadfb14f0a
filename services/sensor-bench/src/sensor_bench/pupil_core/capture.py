"""What a Pupil Capture says over time; pure: no socket, no clock of its own.

Two eye cameras see simulated gaze (`signals.nine`), which Capture publishes with the fields of version 3.5. True time
is in s since power-on; what is in the messages is Pupil time, which this one's `DeviceClock` shows.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sensor_bench.clock import DeviceClock
from sensor_bench.pupil_core.matching import Datum, Matcher
from sensor_bench.pupil_core.msgpack import Packed, pack
from sensor_bench.signals import nine

FIELD_DEG = (60.0, 40.0)  # that the scene camera sees
PX_PER_MM = 12.0
VERSION = "3.5.1"
Message = tuple[bytes, bytes]


@dataclass
class Counts:
    """Of one kind of message: how many there were, and how many of them never left."""

    made: int = 0
    lost: int = 0


@dataclass
class VirtualCapture:
    """One run of Pupil Capture; `restart` begins another with a clock of its own.

    clock: of Pupil time, in ns, against true time in ns, of which start_ns is second 0. phases_s: when each eye's
    camera takes its pictures. model: whether the 3d model is fitted. calibrated: whether there is gaze. loss: share of
    pupil and gaze messages that get lost on the network; `counts` are exact.
    """

    clock: DeviceClock
    start_ns: int = 0
    seed: int = 1
    eye_hz: float = 120.0
    phases_s: tuple[float, float] = (0.0, 0.003)
    model: bool = True
    calibrated: bool = True
    loss: float = 0.0
    counts: dict[str, Counts] = field(default_factory=lambda: {"gaze": Counts(), "pupil": Counts()})
    annotations: list[bytes] = field(default_factory=list)
    """What others have sent to be recorded."""

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self._matcher = Matcher(1 / self.eye_hz)
        self._until_s, self._shut = 0.0, False
        self._outbox: list[Message] = []

    def send(self, time_s: float) -> list[Message]:
        """Return all that is published up to that true time since the last call, as topic and payload."""
        sent, self._outbox = self._outbox, []
        pictures = sorted((at_s, eye) for eye in (0, 1) for at_s in self._pictures_s(eye, time_s))
        for at_s, eye in pictures:
            sent += self._picture(at_s, eye)
        sent += self._events(time_s)
        self._until_s = max(self._until_s, time_s)
        return sent

    def begin(self, time_s: float) -> None:
        """Publish nothing of what was before that true time."""
        self._until_s = time_s

    def answer(self, parts: list[bytes], time_s: float) -> bytes:
        """Return Capture's answer to a request; a request of several parts is published as it is."""
        if len(parts) > 1:
            self._outbox.append((parts[0], parts[1]))
            self.annotations += parts[1:] if parts[0] == b"annotation" else []
            return b"Message forwarded."
        if parts[0] == b"t":
            return repr(self._pupil_s(time_s)).encode()
        return VERSION.encode() if parts[0] == b"v" else b"Unknown command."

    def say(self, topic: str, content: dict[str, Any]) -> None:
        """Publish a message of one's own, with the next ones."""
        self._outbox.append((topic.encode(), pack(content)))

    def annotate(self, label: str, time_s: float) -> None:
        """Somebody presses a key at Capture's window."""
        stamp = {"timestamp": self._pupil_s(time_s), "duration": 0.0, "added_in_capture": True}
        self.say("annotation", {"topic": "annotation", "label": label, **stamp})

    def record(self, on: bool, time_s: float) -> None:
        """Somebody begins or ends a recording."""
        subject = "recording.started" if on else "recording.stopped"
        about = {"rec_path": "/recordings/000", "session_name": "pilot", "start_time_synced": self._pupil_s(time_s)}
        self.say(f"notify.{subject}", {"subject": subject, **about, "topic": f"notify.{subject}"})

    def restart(self, host_ns: int, device_ns: int) -> None:
        """Capture is closed and opened again: its clock begins anew."""
        self.clock.reset(host_ns, device_ns)
        self._matcher = Matcher(1 / self.eye_hz)

    def pupil_ns(self, time_s: float) -> int:
        """Return Pupil time at a true time, in ns."""
        return self.clock.read_ns(self.start_ns + round(time_s * 1e9))

    def _pupil_s(self, time_s: float) -> float:
        return self.pupil_ns(time_s) / 1e9

    def _pictures_s(self, eye: int, time_s: float) -> list[float]:
        phase_s = self.phases_s[eye]
        first = int(np.floor((self._until_s - phase_s) * self.eye_hz)) + 1
        last = int(np.floor((time_s - phase_s) * self.eye_hz))
        return [number / self.eye_hz + phase_s for number in range(max(first, 1), last + 1)]

    def _picture(self, at_s: float, eye: int) -> list[Message]:
        """Return what one picture of an eye leads to: the pupil by 2d, by 3d, and gaze."""
        times_s = np.array([at_s])
        shut = bool(nine.shut(times_s)[0])
        mm = float(nine.pupil_mm(times_s)[0]) + (0.05 if eye else -0.05)
        sent = [self._message("pupil", f"pupil.{eye}.2d", self._pupil(at_s, eye, mm, shut, False))]
        if self.model:
            sent.append(self._message("pupil", f"pupil.{eye}.3d", self._pupil(at_s, eye, mm, shut, True)))
        datum = {"id": eye, "timestamp": self._pupil_s(at_s), "confidence": 0.0 if shut else 0.98, "at_s": at_s}
        for base in self._matcher.push(datum) if self.calibrated else ():
            topic = f"gaze.3d.{''.join(str(each['id']) for each in base)}."
            sent.append(self._message("gaze", topic, self._gaze(topic, base)))
        return [each for each in sent if each is not None]

    def _message(self, kind: str, topic: str, content: dict[str, Any]) -> Message | None:
        """Return the message, None where it gets lost. A pupil is counted by the kind that a driver takes."""
        counted = kind == "gaze" or topic.endswith(".3d" if self.model else ".2d")
        self.counts[kind].made += counted
        if counted and self.loss and self._random.random() < self.loss:
            self.counts[kind].lost += 1
            return None
        return topic.encode(), pack(content)

    def _pupil(self, at_s: float, eye: int, mm: float, shut: bool, model: bool) -> dict[str, Any]:
        middle = [96.0 + 4 * eye, 92.0]
        px = 0.0 if shut else mm * PX_PER_MM
        ellipse = {"center": middle, "axes": [0.97 * px, px], "angle": 12.0}
        datum = {
            "id": eye,
            "topic": f"pupil.{eye}.{'3d' if model else '2d'}",
            "method": "pye3d 0.3.0 real-time" if model else "2d c++",
            "norm_pos": [middle[0] / 192, 1 - middle[1] / 192],
            "diameter": px,
            "confidence": 0.0 if shut else 0.98,
            "timestamp": self._pupil_s(at_s),
            "ellipse": ellipse,
        }
        if model:
            sphere = {"center": [-0.9, 2.0, 40.1], "radius": 10.39}
            circle = {"center": [-2.0, 1.0, 30.9], "normal": [-0.1, -0.1, -0.99], "radius": mm / 2}
            datum |= {"sphere": sphere, "circle_3d": circle, "diameter_3d": 0.0 if shut else mm}
            datum |= {"theta": 1.67, "phi": -1.68, "model_confidence": 1.0}
        return datum

    def _gaze(self, topic: str, base: list[Datum]) -> dict[str, Any]:
        at_s = sum(each["at_s"] for each in base) / len(base)
        turned_deg = nine.gaze_deg(np.array([at_s]))[0]
        x, y = (0.5 + turned / field_deg for turned, field_deg in zip(turned_deg, FIELD_DEG, strict=True))
        return {
            "topic": topic,
            "norm_pos": [float(x), float(y)],
            "gaze_point_3d": [float(600 * np.tan(np.deg2rad(turned))) for turned in turned_deg] + [600.0],
            "eye_centers_3d": {0: [20.0, 15.0, -20.0], 1: [-40.0, 15.0, -20.0]},
            "confidence": min(each["confidence"] for each in base),
            "timestamp": sum(each["timestamp"] for each in base) / len(base),
            "base_data": [Packed(pack({"id": each["id"], "timestamp": each["timestamp"]})) for each in base],
        }

    def _events(self, time_s: float) -> list[Message]:
        """Return blinks as the Blink Detector finds them, and fixations: each told twice, the second time longer."""
        sent = []
        shut = bool(nine.shut(np.array([time_s]))[0])
        if shut != self._shut:
            self._shut = shut
            stamp = {"timestamp": self._pupil_s(time_s), "confidence": 0.9}
            sent.append((b"blinks", pack({"topic": "blinks", "type": "onset" if shut else "offset", **stamp})))
        for told_s in (0.3, 0.6):
            number = int((time_s - told_s) // nine.FIXATION_S)
            if self.calibrated and number >= 0 and int((self._until_s - told_s) // nine.FIXATION_S) < number:
                sent.append((b"fixations", pack(self._fixation(number, told_s))))
        return sent

    def _fixation(self, number: int, told_s: float) -> dict[str, Any]:
        begin_s = number * nine.FIXATION_S
        turned_deg = nine.gaze_deg(np.array([begin_s]))[0]
        place = [float(0.5 + turned / wide) for turned, wide in zip(turned_deg, FIELD_DEG, strict=True)]
        about = {"dispersion": 0.4, "method": "3d gaze", "confidence": 0.97, "id": number}
        stamp = {"timestamp": self._pupil_s(begin_s), "duration": 1000 * told_s}
        return {"topic": "fixations", "norm_pos": place, **about, **stamp, "base_data": []}
