"""The study's services as their heartbeats tell of them. Pure."""

from sense4hri.beats import Beat, Beats
from sense4hri.stamps import SECOND_NS

from web_gui.lately import Increase

MOST = 500


class Services:
    """Who lives, who is not ready, who drops messages."""

    def __init__(self) -> None:
        self.nodes: set[str] = set()
        """Every node on the graph."""
        self.expected: set[str] = set()
        """The nodes that take part in sessions."""
        self._beats = Beats()
        self._drops: dict[str, Increase] = {}

    def take(self, beat: Beat, now_ns: int) -> None:
        """Take what one says of itself."""
        self._beats.take(beat, now_ns / SECOND_NS)
        if beat.service in self._drops or len(self._drops) < MOST:
            self._drops.setdefault(beat.service, Increase()).take(beat.dropped, now_ns)

    def troubles(self, now_ns: int) -> dict[str, str]:
        """Return who hangs, was stopped or killed, each with a sentence."""
        return self._beats.troubles(now_ns / SECOND_NS)

    def afresh(self, now_ns: int) -> list[str]:
        """Return who was killed or failed and is back since a moment ago."""
        return self._beats.afresh(now_ns / SECOND_NS)

    def twins(self, now_ns: int) -> list[str]:
        """Return under whose name two live."""
        return self._beats.twins(now_ns / SECOND_NS)

    def not_ready(self, now_ns: int) -> dict[str, str]:
        """Return who lives and is not ready, and why."""
        return {beat.service: beat.missing for beat in self._newest(now_ns) if beat.missing}

    def dropped(self, now_ns: int) -> dict[str, int]:
        """Return who has dropped messages within the last minute, and how many."""
        grown = {name: round(drops.lately(now_ns)) for name, drops in self._drops.items()}
        return {name: count for name, count in grown.items() if count}

    def answering(self, now_ns: int) -> set[str]:
        """Return whom something has been heard of lately."""
        return {beat.service for beat in self._newest(now_ns)}

    def _newest(self, now_ns: int) -> list[Beat]:
        return self._beats.newest(now_ns / SECOND_NS)
