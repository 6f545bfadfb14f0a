"""`sense4hri-session start|stop|status|mark`: a session from the command line, over ROS."""

import argparse
import os
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from sense4hri import qos
from sense4hri.line import ANSWER_S, Line
from sense4hri.plain_text import plain
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import Marker, SessionState
from sense4hri_msgs.srv import StartSession, StopSession

from session_coordinator.markers import TOPIC
from session_coordinator.request import MarkerWish, press
from session_coordinator.wire import marker_message

SESSION = "/study/session"
FIND_S, SETTLED_S = 10.0, 0.3
GONE = "no session-coordinator any more; the session goes on where one is started within its time"
PHASES = {getattr(SessionState, name): name for name in ("IDLE", "PREPARING", "RECORDING", "STOPPING", "FAILED")}


class SessionLine(Line):
    """Hears the session, too."""

    def __init__(self) -> None:
        super().__init__("sense4hri-session", "session-coordinator")
        self.state: SessionState | None = None
        self.node.create_subscription(SessionState, SESSION, self._hear, qos.SESSION)

    def _hear(self, state: SessionState) -> None:
        self.state = state


def start(line: SessionLine, options: argparse.Namespace) -> int:
    """Ask for a session and say what it waits for, until it records."""
    wish = StartSession.Request(
        study=options.study,
        session_id=options.session,
        task=options.task,
        metadata_json=options.metadata,
        human_ids=options.human,
        required_streams=options.require,
        allow_warmup=options.allow_warmup,
    )
    before = line.until(lambda: line.state, ANSWER_S)
    answer = line.ask(StartSession, "/study/start_session", wish)
    _tell(answer)
    if options.no_wait or not answer.success:
        return 0 if answer.success else 1
    state = _follow(line, answer.session_id, {SessionState.RECORDING}, before)
    return 0 if state.phase == SessionState.RECORDING else 1


def stop(line: SessionLine, options: argparse.Namespace) -> int:
    """End the session and wait until everything is written."""
    answer = line.ask(StopSession, "/study/stop_session", StopSession.Request(session_id=options.session))
    _tell(answer)
    if options.no_wait or not answer.success:
        return 0 if answer.success else 1
    state = _follow(line, options.session, set())
    if state.directory:
        print(plain(state.directory))
    return 0 if state.phase == SessionState.IDLE else 1


def _tell(answer: StartSession.Response | StopSession.Response) -> None:
    print(plain(answer.message), file=sys.stdout if answer.success else sys.stderr, flush=True)


def status(line: SessionLine, options: argparse.Namespace) -> int:
    """Say where the session is."""
    if line.until(lambda: line.state, ANSWER_S) is None:
        print("no session-coordinator", file=sys.stderr)
        return 1
    print(_said(line.state))
    return 0


def mark(line: SessionLine, options: argparse.Namespace) -> int:
    """Set a marker at the moment the command was entered."""
    asked = press(MarkerWish(options.name, options.value, options.human))
    publisher = line.node.create_publisher(Marker, TOPIC, qos.MARKERS)
    found = line.until(_everybody(line, publisher), FIND_S)
    session_id = line.state.session_id if line.state else ""
    marker = marker_message(
        options.pressed_ns, session_id, asked.name, asked.value, asked.human_id, "sense4hri-session", float("nan")
    )
    publisher.publish(marker)
    if not publisher.get_subscription_count():
        print(f"nobody listens to {TOPIC}", file=sys.stderr)
        return 1
    if not publisher.wait_for_all_acked(Duration(seconds=FIND_S)) or (line.state is not None and not found):
        print("the marker was sent, but not everybody, perhaps not the recorder, is known to have it", file=sys.stderr)
        return 1
    return 0


def _everybody(line: SessionLine, publisher: Publisher) -> Callable[[], bool]:
    """Return a condition: all who listen are connected, nobody new for SETTLED_S, the recorder among them in a session.

    What is published before somebody is connected never reaches them.
    """
    count, since = 0, time.monotonic()

    def settled() -> bool:
        nonlocal count, since
        listeners = line.node.get_subscriptions_info_by_topic(TOPIC)
        connected = publisher.get_subscription_count()
        if connected != count or connected != len(listeners):
            count, since = connected, time.monotonic()
        if line.state is None or not count:
            return False
        recorded = any("recorder" in each.node_name for each in listeners)
        return time.monotonic() - since >= SETTLED_S and (recorded or line.state.phase != SessionState.RECORDING)

    return settled


def _follow(line: SessionLine, session_id: str, until: set[int], before: SessionState | None = None) -> SessionState:
    """Print every change of the session until it is over or in one of the phases.

    before: the state from before it was asked for, which says nothing of it.
    """
    said, ends = "", until | {SessionState.IDLE, SessionState.FAILED}
    while True:
        state = line.state
        if state is not before and state is not None and (not session_id or state.session_id in ("", session_id)):
            known = state.phase in ends or line.node.count_publishers(SESSION)
            if (text := _said(state) if known else GONE) != said:
                said = text
                print(text, flush=True)
            if state.phase in ends:
                return state
        line.until(_differs_from(line, state), 0.5)


def _differs_from(line: SessionLine, state: SessionState | None) -> Callable[[], bool]:
    return lambda: line.state is not state


def _said(state: SessionState) -> str:
    parts = [PHASES.get(state.phase, str(state.phase)), state.session_id, state.detail]
    begins = state.phase == SessionState.RECORDING and time.time_ns() < to_ns(state.start_at)
    if state.phase == SessionState.RECORDING:
        at = time.strftime("%H:%M:%S", time.localtime(to_ns(state.start_at) / 1e9))
        parts.append(f"begins at {at}" if begins else f"since {at}")
    if state.waiting_for and not begins:  # until then everybody has only been told, and nobody has answered yet
        parts.append("waiting for " + "; ".join(state.waiting_for))
    return plain("  ".join(part for part in parts if part))


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="sense4hri-session", description="Start, stop and mark a session.")
    commands = parser.add_subparsers(required=True, metavar="start|stop|status|mark")
    one = commands.add_parser("start", help="start a session and say what is missing")
    one.add_argument("--study", required=True)
    one.add_argument("--session", default="", help="its id; made from the time unless given")
    one.add_argument("--task", default="")
    one.add_argument("--metadata", default="", help="a JSON object")
    one.add_argument(
        "--human", action="append", default=[], help="a participant's pseudonym; may be given several times"
    )
    one.add_argument("--require", action="append", default=[], metavar="TOPIC", help="topic or glob that must be alive")
    one.add_argument("--allow-warmup", action="store_true", help="begin before every clock is locked")
    one.add_argument("--no-wait", action="store_true", help="return once it is accepted")
    one.set_defaults(act=start)
    one = commands.add_parser("stop", help="stop the session and say where its recording lies")
    one.add_argument("--session", default="", help="its id; whichever runs unless given")
    one.add_argument("--no-wait", action="store_true", help="return once it is accepted")
    one.set_defaults(act=stop)
    one = commands.add_parser("status", help="say where the session is")
    one.set_defaults(act=status)
    one = commands.add_parser("mark", help="set a marker now")
    one.add_argument("name")
    one.add_argument("value", nargs="?", default="")
    one.add_argument("--human", default="", help="whom it concerns; everybody unless given")
    one.set_defaults(act=mark)
    return parser.parse_args(arguments)


def _running_ns() -> int:
    """Return since when this process runs: importing ROS takes it half a second. To a kernel tick, 10 ms."""
    started_ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    ticks_ns = started_ticks * 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    return max(time.clock_gettime_ns(time.CLOCK_BOOTTIME) - ticks_ns, 0)


def main(arguments: list[str] | None = None) -> int:
    """Do one command; return the exit status."""
    options = _options(arguments)
    options.pressed_ns = time.time_ns() - _running_ns()
    try:
        with closing(SessionLine()) as line:
            return int(options.act(line, options))
    except ValueError as err:
        print(err, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("the session goes on", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
