"""A recorder made with rclpy and the messages alone: takes part in sessions, tells its state, writes a report.

Usage: fake_recorder.py DIRECTORY. Markers it hears go to DIRECTORY/markers.jsonl.
Commands are read from standard input, one per line:

    ready         from now on it acknowledges PREPARING; before, it says what it misses
    silent        it acknowledges nothing
    quit
"""

import json
import sys
import threading
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sense4hri_msgs.msg import Marker, SessionAck, SessionState

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
REPORT = "<!doctype html><title>Report</title><style>h1 { color: green }</style><h1>{session} is complete</h1>"
REPORT += "<script>document.title = 'owned'</script><img src='http://192.0.2.1/x.png' alt=''>"  # neither may happen


class Recorder:
    """Acknowledges every phase twice a second."""

    def __init__(self, directory: Path) -> None:
        self.node, self.directory = Node("recorder"), directory
        self.ready = self.silent = False
        self.state = SessionState()
        self.report = ""
        self.messages = 0
        self.acks = self.node.create_publisher(SessionAck, "/study/ack", 100)
        self.status = self.node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self.node.create_subscription(SessionState, "/study/session", self.hear, LATCHED)
        self.node.create_subscription(Marker, "/study/markers", self.keep, 100)
        self.node.create_timer(0.5, self.tell)

    def hear(self, state: SessionState) -> None:
        self.state = state
        self.tell()

    def keep(self, marker: Marker) -> None:
        """Write down a marker, one line of JSON each."""
        stamp = marker.header.stamp
        fields = {name: getattr(marker, name) for name in ("name", "value", "source", "session_id", "human_id")}
        fields |= {"at_ns": stamp.sec * 10**9 + stamp.nanosec, "uncertainty_s": marker.uncertainty_s}
        with (self.directory / "markers.jsonl").open("a") as file:
            file.write(json.dumps(fields) + "\n")

    def tell(self) -> None:
        """Publish the status, and the acknowledgement of a running session."""
        phase = self.state.phase
        recording = phase in (SessionState.RECORDING, SessionState.STOPPING)
        self.messages += 1234 if recording else 0
        if phase == SessionState.STOPPING and not self.report:
            folder = self.directory / "demo" / "p1-p2" / self.state.session_id
            folder.mkdir(parents=True)
            (folder / "report.html").write_text(REPORT.replace("{session}", self.state.session_id))
            self.report = str(folder / "report.html")
        if phase == SessionState.PREPARING:
            self.report = ""
        values = {
            "recording": "true" if recording else "false",
            "directory": str(self.directory),
            "session_id": self.state.session_id,
            "messages": str(self.messages),
            "lost": "0",
            "written_bytes": "1000",
            "free_bytes": "41300000000",
            "minutes_left": "312.4",
            "report": self.report if phase == SessionState.IDLE else "",
        }
        status = DiagnosticStatus(name="recorder: recording", level=b"\x00", message="all is well")
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        self.status.publish(DiagnosticArray(status=[status]))
        if phase != SessionState.IDLE and not self.silent:
            ok = self.ready or phase != SessionState.PREPARING
            detail = "" if ok else "the disk is not mounted"
            ack = SessionAck(session_id=self.state.session_id, service="recorder", phase=phase, ok=ok, detail=detail)
            ack.directory = str(self.directory / "demo")
            self.acks.publish(ack)


def main() -> None:
    """Run until `quit` or the end of standard input."""
    rclpy.init()
    recorder = Recorder(Path(sys.argv[1]))
    executor = SingleThreadedExecutor()
    executor.add_node(recorder.node)
    threading.Thread(target=executor.spin, daemon=True).start()
    for line in sys.stdin:
        if line.strip() == "quit":
            break
        recorder.ready, recorder.silent = line.strip() == "ready", line.strip() == "silent"
        print(f"is {line.strip()}", flush=True)
    executor.shutdown()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
