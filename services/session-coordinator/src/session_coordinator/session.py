"""What a session is, what happens to it and what follows: values of the handshake. No ROS, no clock."""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

SECOND_NS = 1_000_000_000


class Phase(IntEnum):
    """As in SessionState."""

    IDLE = 0
    PREPARING = 1
    RECORDING = 2
    STOPPING = 3
    FAILED = 4


ACTIVE = (Phase.PREPARING, Phase.RECORDING, Phase.STOPPING)


class Now(NamedTuple):
    """The time, twice: ROS time for what others read, for deadlines a clock nobody sets (`awake.AwakeClock`)."""

    ros_ns: int
    monotonic_s: float


@dataclass(frozen=True)
class Session:
    """What `/study/session` says; times in ns of ROS time, 0 = not set."""

    phase: Phase = Phase.IDLE
    session_id: str = ""
    study: str = ""
    task: str = ""
    metadata_json: str = ""
    human_ids: tuple[str, ...] = ()
    required_streams: tuple[str, ...] = ()
    expected: tuple[str, ...] = ()
    waiting_for: tuple[str, ...] = ()
    start_ns: int = 0
    stop_ns: int = 0
    directory: str = ""
    detail: str = ""


class Publish(NamedTuple):
    """Effect: publish and keep this session."""

    session: Session


class Note(NamedTuple):
    """Effect: a marker `note`, because something happened to a running session."""

    text: str


Effect = Publish | Note


class Ack(NamedTuple):
    """What a service says about one phase of one session."""

    session_id: str
    service: str
    phase: int
    ok: bool
    directory: str = ""
    detail: str = ""
    said_ns: int = 0
    """When, in ROS time of the service's host."""


class Outcome(NamedTuple):
    """The answer to a start or a stop, and what it brings about."""

    success: bool
    session_id: str
    directory: str
    message: str
    effects: list[Effect]
