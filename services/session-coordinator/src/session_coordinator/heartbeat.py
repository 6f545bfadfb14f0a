"""Whether those who record still do: each says so once a second on `/diagnostics`. Pure."""

from collections.abc import Iterable, Mapping

from sense4hri.beats import SILENT_S
from sense4hri.recorder_status import RecorderStatus

OTHER_S = 3.0  # until who records says the session that it was told of


class Heartbeats:
    """The newest beat of everybody who records, by the node's name. Who has never said anything is not judged."""

    def __init__(self) -> None:
        self._beats: dict[str, tuple[RecorderStatus, float]] = {}
        self._right_s: dict[str, float] = {}  # when it last said that it writes the session that runs

    def take(self, beat: RecorderStatus, now_s: float) -> None:
        """Take in one beat. now_s: any steady clock."""
        self._beats[beat.node] = beat, now_s

    def troubles(self, names: Iterable[str], session_id: str, since_s: float, now_s: float) -> Mapping[str, str]:
        """What is wrong with each of these, by name. session_id: what all are to write, and since when."""
        found = {name: self._trouble(name, session_id, since_s, now_s) for name in names if name in self._beats}
        return {name: why for name, why in found.items() if why}

    def _trouble(self, name: str, session_id: str, since_s: float, now_s: float) -> str:
        beat, at_s = self._beats[name]
        if now_s - at_s > SILENT_S:
            return f"no heartbeat for more than {SILENT_S:g} s: what comes now may not be recorded"
        if beat.level == "error":
            return beat.message
        if beat.recording and beat.session_id == session_id:
            self._right_s[name] = now_s
        if now_s - max(since_s, self._right_s.get(name, since_s)) > OTHER_S:
            return "says that it does not record this session"
        return ""
