"""Whether a session is over of which nobody tells any more, for its coordinator has left the graph. Pure."""

from sense4hri.beats import SILENT_S
from sense4hri.recorder_status import RecorderStatus

LOOK_EVERY_S = 1.0
MOST_RECORDERS = 100
_MOST_BETWEEN_S = 2 * LOOK_EVERY_S


class Deserted:
    """How long a study has been without a coordinator, and what its recorders say meanwhile.

    A session is over once no coordinator has been on the graph for over_after_s, which is as long as one may be away
    and go on with it, while a recorder is heard and none says that it records that session. Where none is heard, it may
    still be recorded where this graph does not reach: it is not over. now_s: any clock that goes on.
    """

    def __init__(self, over_after_s: float) -> None:
        self._over_after_s = over_after_s
        self._gone_s, self._looked_s = 0.0, 0.0
        self._said: dict[str, tuple[str, float]] = {}  # which session each recorder is in, and when it said so

    def conducted(self) -> None:
        """A coordinator is there: what was heard without one counts no more."""
        self._gone_s, self._looked_s = 0.0, 0.0
        self._said.clear()

    def heard(self, recorder: RecorderStatus, now_s: float) -> None:
        """A recorder says in which session it is, be it that it cannot write just now."""
        if recorder.node in self._said or len(self._said) < MOST_RECORDERS:
            self._said[recorder.node] = recorder.session_id, now_s

    def looked(self, now_s: float) -> None:
        """No coordinator is there; time in which this process stood still itself is not counted."""
        if self._looked_s:
            self._gone_s += min(now_s - self._looked_s, _MOST_BETWEEN_S)
        self._looked_s = now_s

    def is_over(self, session_id: str, now_s: float) -> bool:
        """Whether this session is."""
        return self._gone_s >= self._over_after_s and self._is_unrecorded(session_id, now_s)

    def why_not(self, session_id: str, now_s: float) -> str:
        """Return why this session is not over, and what to do about it."""
        gone = "whose session-coordinator has left the graph"
        if session_id in (said for said, _ in self._said.values()):
            return f"{gone} and which a recorder still records: start the session-coordinator again, and stop it"
        if self._is_unrecorded(session_id, now_s):
            left_s = max(0.0, self._over_after_s - self._gone_s)
            return f"{gone}: no recorder records it, so in {left_s:.0f} s it is taken for over"
        return f"{gone} and no recorder says whether it records it: start one of them again"

    def _is_unrecorded(self, session_id: str, now_s: float) -> bool:
        """Whether a recorder is heard, and the last word of none is that it is in this session."""
        said = self._said.values()
        return any(now_s - at_s <= SILENT_S for _, at_s in said) and all(named != session_id for named, _ in said)
