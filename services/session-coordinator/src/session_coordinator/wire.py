"""The state machine's session <-> messages and what HTTP answers."""

from dataclasses import dataclass

from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import Marker, SessionState

from session_coordinator.session import Session


def state_message(session: Session, now_ns: int) -> SessionState:
    """Return the session as `/study/session` says it."""
    message = SessionState(
        session_id=session.session_id,
        study=session.study,
        task=session.task,
        metadata_json=session.metadata_json,
        phase=int(session.phase),
        start_at=from_ns(session.start_ns),
        stop_at=from_ns(session.stop_ns),
        human_ids=list(session.human_ids),
        required_streams=list(session.required_streams),
        expected_services=list(session.expected),
        waiting_for=list(session.waiting_for),
        directory=session.directory,
        detail=session.detail,
    )
    message.header.stamp = from_ns(now_ns)
    return message


@dataclass(frozen=True)
class Told:
    """What `GET /session` answers; times in ns of ROS time, null = not set."""

    phase: str
    session_id: str
    study: str
    task: str
    metadata_json: str
    human_ids: tuple[str, ...]
    required_streams: tuple[str, ...]
    expected_services: tuple[str, ...]
    waiting_for: tuple[str, ...]
    start_at_ns: int | None
    stop_at_ns: int | None
    directory: str
    detail: str
    present_services: tuple[str, ...]


def told(session: Session, present: tuple[str, ...]) -> Told:
    """Return the session as `GET /session` answers it; present: who would take part in one that started now."""
    return Told(
        session.phase.name,
        session.session_id,
        session.study,
        session.task,
        session.metadata_json,
        session.human_ids,
        session.required_streams,
        session.expected,
        session.waiting_for,
        session.start_ns or None,
        session.stop_ns or None,
        session.directory,
        session.detail,
        present,
    )


def marker_message(
    stamp_ns: int, session_id: str, name: str, value: str, human_id: str, source: str, uncertainty_s: float
) -> Marker:
    """Return a marker whose event was at stamp_ns of ROS time."""
    marker = Marker(
        uncertainty_s=uncertainty_s, session_id=session_id, human_id=human_id, name=name, value=value, source=source
    )
    marker.header.stamp = from_ns(stamp_ns)
    return marker
