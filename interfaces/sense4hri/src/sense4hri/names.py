"""Names of topics and ids (contract, section 2)."""

import re
import unicodedata
from functools import lru_cache
from typing import NamedTuple

from sense4hri.modalities import MODALITIES

ROOT = "/humans/physiological"
UNASSIGNED = "unassigned"  # the human_id of a sensor nobody wears
SENSOR_TYPES = tuple(MODALITIES)
"""Those of the contract; a third party may bring others."""
HUMAN_ID = r"(?!.*__)[A-Za-z][A-Za-z0-9_]{0,62}"
HUMAN_ID_FORM = "letters, digits and single '_', a letter first, at most 63"
SENSOR_ID = r"(?!.*__)[a-z][a-z0-9_]{0,62}"
SENSOR_ID_FORM = "small letters, digits and single '_', a letter first, at most 63"


TAKEN = {
    UNASSIGNED: "a sensor that nobody wears",
    "nobody": "the folder of sessions without participants",
    "everyone": "all of them",
    "withdrawn": "one who was taken out",
}
"""What words mean that look like a pseudonym, in recordings, registry and page."""


def is_human_id(text: str) -> bool:
    """True for a pseudonym that may stand in a topic name."""
    return re.fullmatch(HUMAN_ID, text) is not None


def meaning(human_id: str) -> str:
    """Return what a word means that is given to no participant, in whatever letters; empty where it may be."""
    return TAKEN.get(human_id.lower(), "")


def is_sensor_id(text: str) -> bool:
    """True for a sensor_id that may stand in a topic name."""
    return re.fullmatch(SENSOR_ID, text) is not None


def sanitise_sensor_id(text: str) -> str:
    """Make a sensor_id from a serial number or address: `A0:9E:1A` becomes `s_a0_9e_1a`.

    Raises ValueError where nothing usable is left.
    """
    words = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    if not words:
        raise ValueError(f"{text!r} holds no letter or digit to make a sensor_id of")
    return f"s_{words}"[:63].rstrip("_")


def folder_name(text: str) -> str:
    """Return free text (a study's or task's name) as a part of a path: `Prüfung 1/b` becomes `Prufung_1_b`.

    Accents go, every run of anything but letters, digits and `-` becomes one `_`; at most 60 characters, `unnamed`
    where nothing is left.
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9-]+", "_", plain)[:60].strip("_-") or "unnamed"


class StreamName(NamedTuple):
    """One stream of one sensor on one person."""

    human_id: str
    sensor_type: str
    sensor_id: str

    def checked(self) -> "StreamName":
        """Return self; raise ValueError that names the part which breaks the contract."""
        if not is_human_id(self.human_id):
            raise ValueError(f"human_id {self.human_id!r}: letters, digits and single '_', a letter first, at most 63")
        if not is_sensor_id(self.sensor_type):
            raise ValueError(f"sensor_type {self.sensor_type!r}: small letters, digits and single '_', as in 'ecg'")
        if not is_sensor_id(self.sensor_id):
            raise ValueError(
                f"sensor_id {self.sensor_id!r}: small letters, digits and single '_', a letter first, at most 63"
            )
        return self

    def topic(self, field: str) -> str:
        """Return the full topic name of one field (`raw`, `features`, ...)."""
        return f"{ROOT}/{self.human_id}/{self.sensor_type}/{self.sensor_id}/{field}"

    def derived(self, sensor_type: str) -> "StreamName":
        """Return the stream of another type that is computed from this one; itself where the type is its own.

        Raises ValueError where its sensor_id, `<source id>_<source type>`, would be too long.
        """
        if sensor_type == self.sensor_type:
            return self
        return StreamName(self.human_id, sensor_type, f"{self.sensor_id}_{self.sensor_type}").checked()

    @property
    def fault(self) -> str:
        """What of this name breaks the contract, in a few words; empty where nothing does."""
        try:
            self.checked()
        except ValueError as err:
            return str(err)
        return ""

    @classmethod
    def loosely(cls, topic: str) -> "tuple[StreamName, str] | None":
        """Return (stream, field) of a topic of a stream's form, whose name may have a `fault`; None for any other."""
        parts = topic.split("/")
        if len(parts) != 7 or not topic.startswith(ROOT + "/") or not all(parts[1:]):
            return None
        return cls(*parts[3:6]), parts[6]

    @classmethod
    @lru_cache(4096)
    def parse(cls, topic: str) -> "tuple[StreamName, str] | None":
        """Return (stream, field) of a topic that follows the contract, None for any other topic."""
        found = cls.loosely(topic)
        return None if found is None or found[0].fault else found


def state_topic(human_id: str) -> str:
    """Return the topic of a person's fused state."""
    return f"{ROOT}/{human_id}/state"
