"""What a recorder says of itself on `/diagnostics`: written by it, read by everybody else with one parser. Pure."""

import math
from dataclasses import dataclass
from typing import Any

NAME = "recorder: recording"
"""Name of the status; others may publish there too."""
LEVELS = ("ok", "warning", "error")
"""In the order of DiagnosticStatus.level; ERROR: it should record and cannot."""
LOST = "messages lost"
"""Words of a message that tells of losses: `3 messages lost (2 of /a, 1 of /b)`."""
AND = "; "
"""Between the parts of a message."""
VALUES = (
    *("recording", "directory", "session_id", "messages", "lost", "written_bytes"),
    *("free_bytes", "minutes_left", "report", "behind_s", "host"),
)


@dataclass(frozen=True)
class RecorderStatus:
    """How things stand; a number that is not known is None.

    node: name of the recorder's node. level: one of LEVELS, message: why, in one sentence. directory: of the recording,
    or of the last one; messages, lost, written_bytes are counted in it. session_id: empty outside of sessions.
    free_bytes: of the disk. minutes_left: until it is full. report: path of the newest session's page, empty until it
    is made. behind_s: how long the study's own messages waited to be taken in. host: that it
    runs on, and whose clock is the reference of a study on several.
    """

    node: str = ""
    level: str = "ok"
    message: str = ""
    recording: bool = False
    directory: str = ""
    session_id: str = ""
    messages: int | None = 0
    lost: int | None = 0
    written_bytes: int | None = 0
    free_bytes: int | None = 0
    minutes_left: float | None = None
    report: str = ""
    behind_s: float | None = None
    host: str = ""

    @property
    def lost_of(self) -> str:
        """Of which topics messages are lost, in the words of the message; empty where it names none."""
        return "".join(self._losses()).removeprefix(self._loss).strip(" ()")

    @property
    def besides(self) -> str:
        """What the message says besides losses."""
        losses = self._losses()
        return AND.join(part for part in self.message.split(AND) if part not in losses)

    @property
    def _loss(self) -> str:
        return f"{self.lost} {LOST}"

    def _losses(self) -> list[str]:
        return [part for part in self.message.split(AND) if part.startswith(self._loss)][:1]

    def values(self) -> dict[str, str]:
        """Return keys and values of the DiagnosticStatus: all of it is text."""
        return {name: _text(getattr(self, name)) for name in VALUES}

    @classmethod
    def parse(cls, status: Any) -> "RecorderStatus | None":
        """Return what a DiagnosticStatus says, None where it is not a recorder's."""
        if status.name != NAME:
            return None
        values = {entry.key: entry.value for entry in status.values}
        level = int.from_bytes(status.level, "little")
        return cls(
            node=status.hardware_id,
            level=LEVELS[level] if level < len(LEVELS) else "error",
            message=status.message,
            recording=values.get("recording") == "true",
            directory=values.get("directory", ""),
            session_id=values.get("session_id", ""),
            messages=count(values.get("messages")),
            lost=count(values.get("lost")),
            written_bytes=count(values.get("written_bytes")),
            free_bytes=count(values.get("free_bytes")),
            minutes_left=_real(values.get("minutes_left")),
            report=values.get("report", ""),
            behind_s=_real(values.get("behind_s")),
            host=values.get("host", ""),
        )


def _text(value: str | float | None) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.1f}" if isinstance(value, float) else str(value)


def count(text: str | None) -> int | None:
    """Return a whole number from 0 that a value on `/diagnostics` holds, None where it holds none."""
    return int(text) if text is not None and text.isascii() and text.isdecimal() and len(text) < 20 else None


def _real(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
