"""What the recorder says of itself over HTTP and on `/diagnostics`, and how it judges it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sense4hri import stamps
from sense4hri.recorder_status import AND, LEVELS, LOST, NAME, RecorderStatus


@dataclass(frozen=True)
class RecordedTopic:
    """One topic that was heard, with its counts in the newest recording; missed_at_start: sent before it was heard."""

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
    """How things stand. told: what is published of it, once it is judged; warn_minutes: of disk, fewer are told.

    problem: why nothing is written though it should be. unsafe: why it is not safe. doubts: other things to look at.
    lost_of: which topics the lost messages are of.
    """

    told: RecorderStatus
    warn_minutes: float = 0.0
    problem: str = ""
    unsafe: str = ""
    doubts: tuple[str, ...] = ()
    lost_of: str = ""

    @property
    def space_warning(self) -> str:
        """How long the disk lasts, where that is too short."""
        minutes_left = self.told.minutes_left
        if not self.told.recording or minutes_left is None or minutes_left >= self.warn_minutes:
            return ""
        return f"the disk lasts {minutes_left:.0f} more minutes"

    def judged(self) -> RecorderStatus:
        """What is told, with its level and one sentence."""
        level, text = self._judgement()
        return replace(self.told, level=level, message=text)

    def message(self) -> DiagnosticArray:
        """Return the message for `/diagnostics`."""
        judged = self.judged()
        status = DiagnosticStatus(
            level=bytes([LEVELS.index(judged.level)]), name=NAME, message=judged.message, hardware_id=judged.node
        )
        status.values = [KeyValue(key=key, value=value) for key, value in judged.values().items()]
        array = DiagnosticArray(status=[status])
        stamps.set_time(array.header.stamp, time.time_ns())
        return array

    def _judgement(self) -> tuple[str, str]:
        if self.problem:
            return "error", f"NOT RECORDING: {self.problem}"
        of = f" ({self.lost_of})" if self.lost_of else ""
        doubts = [f"{self.told.lost} {LOST}{of}"] if self.told.lost else []
        doubts += [*filter(None, (self.unsafe, self.space_warning)), *self.doubts]
        if doubts:
            return "warning", AND.join(doubts)
        if not self.told.recording:
            return "ok", "waits for a session"
        return "ok", f"records session {self.told.session_id}" if self.told.session_id else "records"
