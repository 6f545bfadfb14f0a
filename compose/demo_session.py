"""The session of `make demo`: asked for, followed in sentences, marked, ended, and its report waited for."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from rclpy.client import Client
from sense4hri import qos
from sense4hri.stamps import from_ns, to_ns
from sense4hri_msgs.msg import Marker, SessionState
from sense4hri_msgs.srv import StartSession, StopSession
from short_names import short
from study_file import Study
from study_watch import StudyWatch

ANSWER_S = 20.0  # which only one that hangs takes
WRITTEN_S = 25.0  # the coordinator gives everybody 10 s to finish and then the recorder another 10 s
SAY_EVERY_S = 1.0
MOST_SAID = 4
OVER = (SessionState.IDLE, SessionState.FAILED)


class DemoSession:
    """One session of a study. say: prints a line."""

    def __init__(self, watch: StudyWatch, say: Callable[[str], None]) -> None:
        self._watch, self._say = watch, say
        node = watch.node
        self._starts = node.create_client(StartSession, "/study/start_session")
        self._stops = node.create_client(StopSession, "/study/stop_session")
        self._markers = node.create_publisher(Marker, "/study/markers", qos.MARKERS)
        watch.hear(SessionState, "/study/session", self._hear, qos.SESSION)
        self.session_id = ""
        self.directory = ""
        """Where the recorder writes it, "" as long as it has not said so."""
        self.start_ns = 0
        """The common start in ROS time, 0 before it is announced."""
        self.problem = ""
        """Why it was refused or failed."""
        self.over = False
        self._heard = False
        self._latest: SessionState | None = None
        self._waiting: tuple[str, ...] = ()
        self._said: tuple[str, ...] = ()
        self._said_at_s = 0.0

    def start(self, study: Study) -> None:
        """Ask for a session of this study."""
        wish = StartSession.Request(
            study=study.name,
            task=study.task,
            human_ids=list(study.participants),
            required_streams=list(study.required_streams),
            allow_warmup=True,
        )
        answer = self._ask(self._starts, wish)
        if answer is None or not answer.success:
            self.over, self.problem = True, answer.message if answer else "no session-coordinator answers"
            self._say(f"no session: {self.problem}")
            return
        self.session_id = answer.session_id
        self._say(f"session {self.session_id}: preparing, {len(study.required_streams)} streams are required")
        if self._latest is not None:  # where all is ready at once it records before the answer is here
            self._hear(self._latest)

    def look(self) -> None:
        """Say what the session waits for, where that has changed; not more than once a second."""
        if self._waiting == self._said or time.monotonic() - self._said_at_s < SAY_EVERY_S:
            return
        self._said, self._said_at_s = self._waiting, time.monotonic()
        if self._waiting:
            more = len(self._waiting) - MOST_SAID
            entries = "; ".join(self._waiting[:MOST_SAID]) + (f"; and {more} more" if more > 0 else "")
            self._say(f"session {self.session_id}: waiting for {entries}")

    def mark(self, name: str) -> None:
        """Set a marker now."""
        marker = Marker(name=name, session_id=self.session_id, source="demo", uncertainty_s=float("nan"))
        marker.header.stamp = from_ns(time.time_ns())
        self._markers.publish(marker)
        self._say(f"marker {name}")

    def stop(self, given_up: Callable[[], bool]) -> None:
        """End it and wait until everything is written."""
        if self.over:
            return
        answer = self._ask(self._stops, StopSession.Request(session_id=self.session_id))
        if answer is None or not answer.success:
            self.problem = answer.message if answer else "no session-coordinator answers"
            return
        if not self._until(lambda: self.over or given_up(), WRITTEN_S):
            self.problem = f"not written within {WRITTEN_S:.0f} s, waiting for {'; '.join(self._waiting)}"

    def _hear(self, state: SessionState) -> None:
        self._latest = state
        self._heard = self._heard or (bool(self.session_id) and state.session_id == self.session_id)
        if not self._heard or state.session_id not in ("", self.session_id) or self.over:
            return  # the end of an earlier session, which the coordinator still tells
        self.directory = state.directory or self.directory
        recording = state.phase == SessionState.RECORDING
        self._waiting = tuple(short(entry) for entry in state.waiting_for) if not recording else ()
        if recording and not self.start_ns:
            self.start_ns = to_ns(state.start_at)
            self._say(f"session {self.session_id}: records, into {self.directory or 'a folder not yet known'}")
        if state.phase in OVER:
            self.over = True
            self._say(state.detail)
            self.problem = state.detail if state.phase == SessionState.FAILED else ""

    def _ask(self, client: Client, wish: Any) -> Any:
        """Return the coordinator's answer, None where none comes."""
        if not self._until(client.service_is_ready, ANSWER_S):
            return None
        future = client.call_async(wish)
        return future.result() if self._until(future.done, ANSWER_S) else None

    def _until(self, condition: Callable[[], bool], seconds: float) -> bool:
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._watch.spin(0.05)
            self.look()
        return True


def recorded(directory: str) -> dict[str, Any]:
    """Return how many messages a finished recording holds, by its own metadata.yaml."""
    try:
        known = yaml.safe_load((Path(directory) / "metadata.yaml").read_text("utf-8"))
    except OSError:
        return {"directory": directory}
    return {"directory": directory, "messages": known["rosbag2_bagfile_information"]["message_count"]}
