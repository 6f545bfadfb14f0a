"""What a recording is told by others: how its files are cut, and what recorder.json says besides counts."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sense4hri_recording.recorder_json import COMPLETE


@dataclass(frozen=True)
class Limits:
    """How files are cut. split_bytes, split_s: a new file after so much of either; 0: never."""

    compression: str = "zstd"
    split_bytes: int = 0
    split_s: float = 0.0
    distro: str = "jazzy"


@dataclass
class About:
    """What is told about a recording besides its messages; filled by whoever knows.

    session: as in recorder.json, None outside of sessions. surroundings: `refused`, `withheld` and `nodes` of
    recorder.json, as they are now.
    """

    session: dict[str, Any] | None = None
    software: dict[str, str] = field(default_factory=dict)
    surroundings: Callable[[], dict[str, Any]] = dict
    events: list[dict[str, Any]] = field(default_factory=list)
    before: str = ""
    """What was lost of the same before this recording was begun."""
    outcome: tuple[str, str] = (COMPLETE, "")
    """State and why, once it is closed."""

    def note(self, what: str) -> None:
        """Add an event, now."""
        self.events.append({"at_ns": time.time_ns(), "what": what})
