"""What recorder.json says about the session and the software, from messages and the environment."""

import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier
from sense4hri.stamps import to_ns
from sense4hri.strict_json import parse
from sense4hri.version import software_version
from sense4hri_msgs.msg import SessionState
from sense4hri_recording import recorder_json
from sense4hri_recording.layout import REPAIRED
from sense4hri_recording.parts import parts
from sense4hri_recording.recorder_json import COMPLETE, INTERRUPTED, RecorderJson


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


def away_before(directory: Path) -> str:
    """For how long nobody recorded before this part of a session; empty for the first part."""
    own = recorder_json.read(directory)
    others = [(path, recorder_json.read(path)) for path in parts(directory)]
    ends = [_last_written_ns(path, told) for path, told in others if (told.opened_ns or 0) < (own.opened_ns or 0)]
    if not ends:
        return ""
    if not all(ends) or own.opened_ns is None:
        return "nobody recorded before this part, for a time that is not known"
    end_s, begin_s = max(filter(None, ends)) / 1e9, own.opened_ns / 1e9
    return f"nobody recorded from {_clock(end_s)} to {_clock(begin_s)} UTC ({begin_s - end_s:.1f} s)"


def _last_written_ns(folder: Path, told: RecorderJson) -> int | None:
    """When a part was last written to: as its recorder said, or as the files of one that is not recovered yet say."""
    if told.state in (COMPLETE, INTERRUPTED) and told.last_written_ns:
        return told.last_written_ns
    files = [file for file in folder.glob("*.mcap") if not file.stem.endswith(REPAIRED)]
    try:
        return max((file.stat().st_mtime_ns for file in files), default=None)
    except OSError:
        return None


def _clock(seconds: float) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC):%H:%M:%S}"


def _object(text: str) -> dict[str, Any]:
    """Free-form metadata; what is no JSON object, or could not be written again, is kept as text."""
    try:
        content = parse(text, "metadata_json")
    except ValueError:
        content = None
    return content if isinstance(content, dict) else {"text": text.encode(errors="replace").decode()}
