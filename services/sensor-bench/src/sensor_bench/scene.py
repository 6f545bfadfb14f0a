"""What the robot's camera sees: faces, their expressions, and whose they are. No ROS here."""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sensor_bench.room import Participant

RECOGNISED = ("neutral", "happy", "surprised", "sad", "angry", "disgusted", "scared")
"""What hri_emotion_recognizer can say."""
EXPRESSIONS = frozenset(RECOGNISED) | {
    "pleading",
    "vulnerable",
    "despaired",
    "guilty",
    "disappointed",
    "embarrassed",
    "horrified",
    "skeptical",
    "annoyed",
    "furious",
    "suspicious",
    "rejected",
    "bored",
    "tired",
    "asleep",
    "confused",
    "amazed",
    "excited",
}
"""The constants of hri_msgs/Expression."""
FACE_ID = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass
class Face:
    """What the camera sees of one face, and whose it is."""

    expression: str = "neutral"
    confidence: float = 0.9
    person: str = ""
    """The person manager's person with this face; empty = not recognised."""
    visible: bool = True

    def __post_init__(self) -> None:
        if self.expression not in EXPRESSIONS:
            raise ValueError(f"expression: {self.expression!r} is none of {', '.join(sorted(EXPRESSIONS))}")
        if isinstance(self.confidence, bool) or not isinstance(self.confidence, int | float):
            raise ValueError(f"confidence: expected a number, got {self.confidence!r}")
        if not 0 <= self.confidence <= 1:
            raise ValueError(f"confidence: {self.confidence!r} is not within 0..1")
        if not isinstance(self.visible, bool):
            raise ValueError(f"visible: expected true or false, got {self.visible!r}")
        if not isinstance(self.person, str) or (self.person and not FACE_ID.fullmatch(self.person)):
            raise ValueError(f"person: {self.person!r} is no identifier")


class Scene:
    """The faces by id, and the persons that own one."""

    def __init__(self, participants: Mapping[str, Participant]) -> None:
        self.faces = {
            person.face: Face(person.expression, person=name) for name, person in participants.items() if person.face
        }

    def visible(self) -> dict[str, Face]:
        return {name: face for name, face in self.faces.items() if face.visible}

    def face_of_person(self) -> dict[str, str]:
        """Every person ever seen -> its visible face, or empty."""
        found = {face.person: "" for face in self.faces.values() if face.person}
        found.update({face.person: name for name, face in self.visible().items() if face.person})
        return found

    def update(self, changes: Mapping[str, Any]) -> None:
        """`{face: {expression, confidence, person, visible}}`: change these, add unknown ones; all or nothing."""
        known = {f.name for f in dataclasses.fields(Face)}
        updated = dict(self.faces)
        for name, values in changes.items():
            if not FACE_ID.fullmatch(name):
                raise ValueError(f"face {name!r} is no identifier")
            if not isinstance(values, dict):
                raise ValueError(f"{name}: expected keys and values, got {values!r}")
            if unknown := sorted(set(values) - known):
                raise ValueError(f"{name}: unknown key {unknown[0]!r}; known are {', '.join(sorted(known))}")
            try:
                updated[name] = dataclasses.replace(updated.get(name, Face()), **values)
            except ValueError as error:
                raise ValueError(f"{name}.{error}") from error
        self.faces = updated

    def show(self, count: int) -> None:
        """Let exactly `count` faces be visible, strangers `face_x1`.. added where there are too few."""
        for i in range(1, count - len(self.faces) + 1):
            self.faces[f"face_x{i}"] = Face()
        for i, face in enumerate(self.faces.values()):
            face.visible = i < count
