"""What is wrong now with services and required streams, and so stands in a start's way. No ROS, no clock."""

from collections.abc import Collection, Mapping

from sense4hri.beats import TWINS
from sense4hri.waiting import STREAMS_NOT_LOOKED_AT, Waited

from session_coordinator.session import Note


class Hindrances:
    """What is wrong, by node and by topic or glob; what changes is returned as notes for a session that records."""

    def __init__(self) -> None:
        self._services: dict[str, str] = {}
        self._streams: dict[str, str] | None = None  # nobody has looked at them

    def services_are(self, troubles: Mapping[str, str], recorders: Collection[str]) -> list[Note]:
        """Take what is wrong with services now, node -> why; recorders: of whom it is said that they record again."""
        before, self._services = self._services, dict(troubles)
        notes = [Note(f"{name}: {why}") for name, why in sorted(troubles.items()) if before.get(name) != why]
        over = {name: _does(why, name in recorders) for name, why in before.items() if name not in troubles}
        return notes + [Note(f"{name}: {does} again") for name, does in sorted(over.items())]

    def streams_are(self, troubles: Mapping[str, str]) -> list[Note]:
        """Take what is wrong with required streams now, topic or glob -> why."""
        before, self._streams = self._streams or {}, dict(troubles)
        notes = [
            Note(f"required stream {topic}: {why}") for topic, why in sorted(troubles.items()) if topic not in before
        ]
        return notes + [Note(f"required stream {topic}: back") for topic in sorted(before.keys() - troubles.keys())]

    def waited(self, answering: Collection[str]) -> list[Waited]:
        """Return what is wrong now, but with services that are waited for already."""
        services = [Waited(name, why) for name, why in sorted(self._services.items()) if name not in answering]
        return services + [Waited(topic, why) for topic, why in sorted((self._streams or {}).items())]

    def unseen(self, required_streams: Collection[str]) -> list[Waited]:
        """Return what is waited for while nobody has looked at the required streams."""
        looked = self._streams is not None or not required_streams
        return [] if looked else [Waited(STREAMS_NOT_LOOKED_AT, "being looked at")]


def _does(trouble: str, records: bool) -> str:
    """Return what a service does again that was in this trouble."""
    if trouble == TWINS:
        return "is one node"
    return "records" if records else "lives"
