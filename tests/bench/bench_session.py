"""How long a session takes from start to RECORDING, and from stop to the end, with 20 services that are all ready."""

import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MEMBERS, PROCESSES, SESSIONS = 20, 2, 20
TOY = Path(__file__).resolve().parents[1] / "kit" / "toy_members.py"


def rows() -> list[dict]:
    """Everything measured here, for `make bench`."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(100, 200)))
    starts_s, stops_s = measure()
    return [
        _row(f"start asked for to RECORDING heard, {MEMBERS} services ready", 2.0, starts_s),
        _row(f"stop asked for to the end heard, {MEMBERS} services", None, stops_s),
    ]


def _row(what: str, target_s: float | None, took_s: list[float]) -> dict:
    measured = f"median {statistics.median(took_s):.2f} s, max {max(took_s):.2f} s of {len(took_s)}"
    ok = None if target_s is None else max(took_s) <= target_s
    return {"what": what, "target": f"<= {target_s:g} s" if target_s else "", "measured": measured, "ok": ok}


def measure() -> tuple[list[float], list[float]]:
    """Return the seconds of every start and of every stop; `start_at` lies `lead_s` = 1 s after RECORDING."""
    from sense4hri_msgs.msg import SessionState
    from sense4hri_msgs.srv import StartSession, StopSession
    from session_coordinator.cli import SessionLine

    each = MEMBERS // PROCESSES
    with tempfile.TemporaryDirectory() as folder:
        commands = [[sys.executable, str(TOY), str(n * each), str(each)] for n in range(PROCESSES)]
        state_file = f"state_file:={folder}/session.json"
        commands.append([sys.executable, "-m", "session_coordinator", "--ros-args", "-p", state_file])
        processes = [subprocess.Popen(command, stderr=subprocess.DEVNULL) for command in commands]
        line = SessionLine()
        starts_s, stops_s = [], []

        def reached(phase: int, session_id: str) -> bool:
            return line.state is not None and (line.state.phase, line.state.session_id) == (phase, session_id)

        try:
            assert line.until(lambda: _members(line) == MEMBERS, 60)
            line.until(lambda: False, 3.0)  # the coordinator finds them as we did
            for _ in range(SESSIONS):
                begun = time.monotonic()
                answer = line.ask(StartSession, "/study/start_session", StartSession.Request(study="bench"))
                assert line.until(lambda name=answer.session_id: reached(SessionState.RECORDING, name), 30)
                assert len(line.state.expected_services) == MEMBERS, line.state.expected_services
                starts_s.append(time.monotonic() - begun)
                begun = time.monotonic()
                line.ask(StopSession, "/study/stop_session", StopSession.Request())
                assert line.until(lambda: reached(SessionState.IDLE, ""), 30)
                stops_s.append(time.monotonic() - begun)
        finally:
            line.close()
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait(10)
    return starts_s, stops_s


def _members(line) -> int:
    infos = line.node.get_subscriptions_info_by_topic("/study/session")
    return len({info.node_name for info in infos if info.node_name.startswith("toy_member_")})


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} | {row['ok']} |")
