"""What recorder.json says about the session and the software, from messages and the environment."""

import os
import platform
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier
from sense4hri.stamps import to_ns
from sense4hri.strict_json import parse
from sense4hri.version import software_version
from sense4hri_msgs.msg import SessionState


def distro() -> str:
    """The ROS distribution whose formats are written."""
    return os.environ.get("ROS_DISTRO", "jazzy")


def software() -> dict[str, str]:
    """Versions of what records."""
    return {
        "recorder": software_version("recorder"),
        "ros_distro": distro(),
        "rmw": get_rmw_implementation_identifier(),
        "python": platform.python_version(),
    }


def session(state: SessionState) -> dict[str, Any]:
    """A session as in recorder.json."""
    return {
        "session_id": state.session_id,
        "study": state.study,
        "task": state.task,
        "human_ids": list(state.human_ids),
        "required_streams": list(state.required_streams),
        "metadata": _object(state.metadata_json),
        "start_at_ns": to_ns(state.start_at) or None,
        "stop_at_ns": to_ns(state.stop_at) or None,
    }


def _object(text: str) -> dict[str, Any]:
    """Free-form metadata; what is no JSON object is kept as text."""
    try:
        content = parse(text, "metadata_json")
    except ValueError:
        content = None
    return content if isinstance(content, dict) else {"text": text}
