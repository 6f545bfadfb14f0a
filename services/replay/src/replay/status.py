"""What `GET /status` answers."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Played:
    """One topic: messages published so far, and who hears them."""

    published: int
    subscribers: int


@dataclass(frozen=True)
class Status:
    """How far the recording is; times in recorded s from its first message.

    state: idle, starting, playing, paused, or what comes after. late_s: by how much it was moved because it fell
    behind. unacknowledged: subscribers that did not say that they had everything. refused: topics that are not played,
    and why.
    """

    state: str = "idle"
    bag: str = ""
    rate: float = 0.0
    position_s: float = 0.0
    duration_s: float = 0.0
    rounds: int = 0
    published: int = 0
    late_s: float = 0.0
    unacknowledged: int = 0
    topics: dict[str, Played] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
