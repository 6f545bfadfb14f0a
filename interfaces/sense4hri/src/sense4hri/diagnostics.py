"""A service's heartbeat as a message: a status named `<node>: service` on `/diagnostics`, as ROS nodes speak there."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from sense4hri.beats import Beat
from sense4hri.recorder_status import count

TOPIC = "/diagnostics"
SUFFIX = ": service"


def message(beat: Beat) -> DiagnosticArray:
    """Return a beat as published; level ERROR where something is wrong."""
    level = DiagnosticStatus.ERROR if beat.trouble else DiagnosticStatus.OK
    status = DiagnosticStatus(level=level, name=beat.service + SUFFIX, hardware_id=beat.service)
    status.message = beat.trouble or ("ends" if beat.ended else "lives")
    values = {"run": beat.run, "ended": str(beat.ended).lower(), "missing": beat.missing, "dropped": str(beat.dropped)}
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[status])


def beats(told: DiagnosticArray) -> list[Beat]:
    """Return the beats in a message; whatever else is in it is left out."""
    return [_beat(status) for status in told.status if status.name == status.hardware_id + SUFFIX]


def _beat(status: DiagnosticStatus) -> Beat:
    values = {entry.key: entry.value for entry in status.values}
    trouble = "" if status.level == DiagnosticStatus.OK else status.message
    run, ended, dropped = values.get("run", ""), values.get("ended") == "true", count(values.get("dropped")) or 0
    return Beat(status.hardware_id, run, trouble, ended, values.get("missing", ""), dropped)
