"""The state machine's session <-> messages and JSON."""

from typing import Any

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


def state_json(session: Session) -> dict[str, Any]:
    """Return the session as `GET /session` answers it; times in ns of ROS time, null = not set."""
    return {
        "phase": session.phase.name,
        "session_id": session.session_id,
        "study": session.study,
        "task": session.task,
        "metadata_json": session.metadata_json,
        "human_ids": list(session.human_ids),
        "required_streams": list(session.required_streams),
        "expected_services": list(session.expected),
        "waiting_for": list(session.waiting_for),
        "start_at_ns": session.start_ns or None,
        "stop_at_ns": session.stop_ns or None,
        "directory": session.directory,
        "detail": session.detail,
    }


def marker_message(
    stamp_ns: int, session_id: str, name: str, value: str, human_id: str, source: str, uncertainty_s: float
) -> Marker:
    """Return a marker whose event was at stamp_ns of ROS time."""
    marker = Marker(
        uncertainty_s=uncertainty_s, session_id=session_id, human_id=human_id, name=name, value=value, source=source
    )
    marker.header.stamp = from_ns(stamp_ns)
    return marker
