"""What the recorder says of itself over HTTP and on `/diagnostics`, and how it judges it."""

from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

NAME = "recorder: recording"


@dataclass(frozen=True)
class RecordedTopic:
    """One topic; lost: after it was there, missed_at_start: before the recorder was connected."""

    topic: str
    type: str
    messages: int
    lost: int
    missed_at_start: int


@dataclass(frozen=True)
class Recording:
    """What `GET /recording` answers; withheld: topics left out because they identify people."""

    directory: str
    recording: bool
    session_id: str
    messages: int
    lost: int
    topics: tuple[RecordedTopic, ...]
    withheld: tuple[str, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Status:
    """How things stand.

    problem: why nothing is written though it should be. unsafe: why it is not safe. doubts: other things to look at.
    minutes_left: until the disk is full, None where that is not known. report: path of the newest session's page.
    """

    recording: bool = False
    directory: str = ""
    session_id: str = ""
    messages: int = 0
    lost: int = 0
    written_bytes: int = 0
    free_bytes: int = 0
    minutes_left: float | None = None
    warn_minutes: float = 0.0
    report: str = ""
    problem: str = ""
    unsafe: str = ""
    doubts: tuple[str, ...] = ()

    @property
    def space_warning(self) -> str:
        """How long the disk lasts, where that is too short."""
        if not self.recording or self.minutes_left is None or self.minutes_left >= self.warn_minutes:
            return ""
        return f"the disk lasts {self.minutes_left:.0f} more minutes"

    def judged(self) -> tuple[bytes, str]:
        """Level and one sentence."""
        if self.problem:
            return DiagnosticStatus.ERROR, f"NOT RECORDING: {self.problem}"
        doubts = [f"{self.lost} messages lost"] if self.lost else []
        doubts += [*filter(None, (self.unsafe, self.space_warning)), *self.doubts]
        if doubts:
            return DiagnosticStatus.WARN, "; ".join(doubts)
        if not self.recording:
            return DiagnosticStatus.OK, "waits for a session"
        return DiagnosticStatus.OK, f"records session {self.session_id}" if self.session_id else "records"

    def message(self) -> DiagnosticArray:
        """As published."""
        level, text = self.judged()
        values = {
            "recording": "true" if self.recording else "false",
            "directory": self.directory,
            "session_id": self.session_id,
            "messages": str(self.messages),
            "lost": str(self.lost),
            "written_bytes": str(self.written_bytes),
            "free_bytes": str(self.free_bytes),
            "minutes_left": "" if self.minutes_left is None else f"{self.minutes_left:.1f}",
            "report": self.report,
        }
        status = DiagnosticStatus(level=level, name=NAME, message=text, hardware_id="recorder")
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        return DiagnosticArray(status=[status])
