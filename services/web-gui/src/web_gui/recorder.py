"""What the recorder says, and whether it can be believed: REC is what its own heartbeat and counts say. Pure."""

from dataclasses import replace

from sense4hri.recorder_status import RecorderStatus
from sense4hri.stamps import SECOND_NS

from web_gui.intake import shown
from web_gui.lately import Increase
from web_gui.rules import RULES

SILENT_NS = 3 * SECOND_NS  # it speaks once a second
BEGINS_NS = 3 * SECOND_NS  # from the announcement of a session until the recorder says that it records
FROZEN_NS = 4 * SECOND_NS  # without one more message counted, while signals arrive
FORGET_NS = 600 * SECOND_NS
LONGEST_PATH = 4096  # of the system
LOST = "what happens now may not be recorded"


class Recorder:
    """The recorder as heard on `/diagnostics`, and how long a session went on without it."""

    def __init__(self) -> None:
        self.doubt = ""
        """Why what happens now may not be recorded, empty where it is or where nothing has to be."""
        self.unrecorded_s = 0.0
        """For how long of the newest session there was a doubt."""
        self.lost = Increase(RULES["MessagesLost"].window_s)
        self._status: RecorderStatus | None = None
        self._heard_ns = self._counted_ns = self._wanted_ns = self._judged_ns = 0
        self._session = ""

    def take(self, status: RecorderStatus, now_ns: int) -> None:
        """Take what the recorder says."""
        if self._status is None or status.messages is None or status.messages != self._status.messages:
            self._counted_ns = now_ns
        self._status, self._heard_ns = _visible(status), now_ns
        if status.lost is not None:
            self.lost.take(status.lost, now_ns)

    def newest(self, now_ns: int) -> RecorderStatus | None:
        """Return what it said last, None where it has been silent since."""
        return self._status if now_ns - self._heard_ns <= SILENT_NS else None

    @property
    def report(self) -> str:
        """Path of the report it made last, or empty."""
        return self._status.report if self._status else ""

    def judge(self, phase: str, session_id: str, signals: bool, now_ns: int) -> None:
        """Look once a second at whether what must be recorded is. signals: some raw stream has just been heard."""
        wanted = phase in ("recording", "stopping")
        if wanted and session_id != self._session:
            self._session, self.unrecorded_s = session_id, 0.0
        if not wanted:
            self._wanted_ns = 0
        elif not self._wanted_ns:
            self._wanted_ns = now_ns
        before, self.doubt = self.doubt, self._doubt(wanted, phase, signals, now_ns)
        if wanted and self.doubt:
            since_ns = self._judged_ns if before else max(self._wanted_ns, min(self._heard_ns, self._counted_ns))
            self.unrecorded_s += (now_ns - since_ns) / SECOND_NS
        self._judged_ns = now_ns

    def _doubt(self, wanted: bool, phase: str, signals: bool, now_ns: int) -> str:
        status, settled = self._status, wanted and now_ns - self._wanted_ns > BEGINS_NS
        if status is None:
            return "no recorder is heard: nothing is recorded" if settled else ""
        silent_ns = now_ns - self._heard_ns
        if silent_ns > SILENT_NS:
            asked = wanted or (status.recording and silent_ns < FORGET_NS)
            return f"the recorder has said nothing for {_seconds(silent_ns)}: {LOST}" if asked else ""
        if not settled or phase == "stopping":
            return ""
        if not status.recording:
            return f"the session runs, but the recorder does not record: {status.message}"
        frozen_ns = now_ns - max(self._counted_ns, self._wanted_ns)
        if signals and frozen_ns > FROZEN_NS:
            return f"the recorder has counted no message for {_seconds(frozen_ns)} although signals arrive"
        return ""


def _visible(status: RecorderStatus) -> RecorderStatus:
    return replace(
        status,
        node=shown(status.node),
        message=shown(status.message),
        directory=shown(status.directory),
        session_id=shown(status.session_id),
        report=shown(status.report, LONGEST_PATH),  # to be opened, not read
    )


def _seconds(ns: int) -> str:
    return f"{ns / SECOND_NS:.0f} s"
