"""`make demo`: the demo study as plain processes on this machine, without Docker, root or a sensor.

Starts the virtual sensors and every service, records a session through the handshake, says what it waits for, where the
page and the recording are and what flows. On Ctrl-C (or after --duration) it stops the session, waits for the report,
ends everything and sums up; a second Ctrl-C does not wait. Exit status 1 where anything in the chain stayed silent.
"""

import argparse
import contextlib
import json
import os
import random
import re
import shutil
import signal
import socket
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from children import Child, Children

if TYPE_CHECKING:
    from demo_session import DemoSession
    from study_watch import StudyWatch

ROOT = Path(__file__).resolve().parents[1]
STUDY = ROOT / "compose" / "studies" / "demo"
SENSORS = ("h10_1", "verity_1", "h10_2", "verity_2")
SERVICES = (
    "clock_sync",
    "interpreter_ecg",
    "interpreter_ppg",
    "metadata_registry",
    "fusion_affect",
    "session_coordinator",
)
READY_S = 90.0  # the beats of a recording are found first
STOP_S = 8.0
PROGRESS_S = 10.0
REPORT_S, REPORT_CTRL_C_S = 20.0, 3.0  # after a Ctrl-C all is to end within 10 s; the recorder, ending, finishes it
GUI_PORT, PORTS_TRIED = 8080, 50
MARKERS = ((0.1, "condition_start"), (0.9, "condition_end"))  # of a session of known length: when, as a share of it
SILENT_AFTER_S = 30.0  # a run shorter than this cannot say that the slower parts of the chain are silent


def main() -> int:
    """Run the demo; return the exit status."""
    options = _options()
    missing = _missing(options)
    if missing:
        print("\n".join(missing), file=sys.stderr)
        return 2
    options.port = _page_port(options.port)
    claim = _own_domain()
    try:
        return _run(options)
    finally:
        claim.close()


def _own_domain() -> socket.socket:
    """Set ROS_DOMAIN_ID, unless it is set, to one that no other demo on this machine holds; close to release it."""
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    if "ROS_DOMAIN_ID" in os.environ:
        return claim
    for domain in random.sample(range(1, 30), 29):
        with contextlib.suppress(OSError):
            claim.bind(f"\0sense4hri-demo-domain-{domain}")
            os.environ["ROS_DOMAIN_ID"] = str(domain)
            return claim
    raise SystemExit("29 demos run on this machine already; set ROS_DOMAIN_ID to run another one")


def _page_port(given: int | None) -> int:
    """Return the port of the page: the given one, else 8080 or the next one that is free."""
    if given is not None:
        return given
    for port in range(GUI_PORT, GUI_PORT + PORTS_TRIED):
        with contextlib.closing(socket.socket()) as probe, contextlib.suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
            if port != GUI_PORT:
                _say(f"port {GUI_PORT} is taken, the page is on {port}; PORT=... chooses another one")
            return port
    raise SystemExit(f"ports {GUI_PORT} to {GUI_PORT + PORTS_TRIED - 1} are all taken; set PORT to a free one")


def _run(options: argparse.Namespace) -> int:
    from study_watch import StudyWatch  # starts ROS, which reads the domain then

    work = Path(tempfile.mkdtemp(prefix="sense4hri-demo-"))
    recordings = options.recordings.resolve()
    children = Children(work)
    stop = _StopFlag()
    try:
        if not _start(children, options, work, recordings, stop):
            return 1
        watch = StudyWatch()
        try:
            return _watch(watch, children, options, stop)
        finally:
            watch.close()
    finally:
        children.end(STOP_S)
        shutil.rmtree(work, ignore_errors=True)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make demo", description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, metavar="S", help="stop by itself after recording so many seconds")
    parser.add_argument("--input", metavar="FILE", help="p1 plays this real recording (see services/sensor-bench)")
    parser.add_argument("--port", type=int, help="port of the page; 8080, or the next free one, unless given")
    parser.add_argument("--recordings", type=Path, default=ROOT / "recordings", help="folder for recordings")
    return parser.parse_args()


def _missing(options: argparse.Namespace) -> list[str]:
    lines = []
    if shutil.which("dbus-daemon") is None:
        lines.append("dbus-daemon is missing: the virtual sensors need it. Debian, Ubuntu: apt-get install dbus-daemon")
    if options.input is not None:
        try:
            with open(options.input, "rb"):
                pass
        except OSError as error:
            lines.append(f"INPUT={options.input} cannot be played: {error.strerror}")
    return lines


class _StopFlag:
    """Set by Ctrl-C and SIGTERM; by the second of them, waiting is over as well."""

    def __init__(self) -> None:
        self.set = self.impatient = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, frame: object) -> None:
        self.set, self.impatient = True, self.set


def _say(text: str) -> None:
    print(f"{datetime.now(UTC):%H:%M:%S}  {text}", flush=True)


def _start(children: Children, options: argparse.Namespace, work: Path, recordings: Path, stop: _StopFlag) -> bool:
    """Start everything, a line each; False where something did not come up."""
    _say(f"ROS domain {os.environ['ROS_DOMAIN_ID']}; logs in {work}")
    if options.input is not None:
        _say(f"p1 plays {options.input}")
    recorder = children.start("recorder", {"directory": str(recordings), "record_when": "session"})
    bus = work / "bus"
    bench = children.start("sensor_bench", {"socket_path": str(bus), **_played(options.input)})
    for name in SERVICES:
        children.start(name, _kept(name, work))
    gui = children.start("web_gui", {"port": options.port, "recordings": str(recordings)})
    if not _until_ready([recorder, bench, gui, *(children[name] for name in SERVICES)], stop):
        return False
    for sensor in SENSORS:
        env = {"DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={bus}"}
        children.start("driver_polar", {}, name=sensor, params_file=STUDY / f"{sensor}.yaml", env=env)
    if not _until_ready([children[sensor] for sensor in SENSORS], stop):
        return False
    _say(f"the page:       {_page(gui)}")
    _say("Ctrl-C ends it" if options.duration is None else f"ends after {options.duration:g} s of recording")
    return True


def _page(gui: Child) -> str:
    """Return the address that web-gui says it serves."""
    found = re.search(r"the page is at (\S+)", gui.log())
    return found[1] if found else "unknown"


def _kept(name: str, work: Path) -> dict[str, object]:
    """Where a service keeps its file, for the length of the demo."""
    files = {
        "metadata_registry": {"database": str(work / "registry.sqlite")},
        "session_coordinator": {"state_file": str(work / "session.json")},
    }
    return files.get(name, {})


def _played(path: str | None) -> dict[str, object]:
    return {"input": str(Path(path).resolve())} if path else {}


def _until_ready(group: list[Child], stop: _StopFlag) -> bool:
    deadline = time.monotonic() + READY_S
    for child in group:
        while not child.ready():
            if stop.set:
                return False
            wrong = [one for one in group if not one.running()] or [child] * (time.monotonic() > deadline)
            for one in wrong:
                why = "did not get ready in time" if one.running() else f"ended with status {one.status()}"
                print(f"{one.name} {why}; its log:\n{one.log()}", file=sys.stderr)
            if wrong:
                return False
            time.sleep(0.1)
        _say(f"{child.name:<18} ready")
    return True


def _watch(watch: "StudyWatch", children: Children, options: argparse.Namespace, stop: _StopFlag) -> int:
    from demo_session import DemoSession, raw_streams, recorded

    page = _page(children["web_gui"])
    session = DemoSession(watch, _say)
    session.start([name for sensor in SENSORS for name in raw_streams(STUDY / f"{sensor}.yaml")])
    failed = _follow(watch, children, session, options.duration, stop)
    lasted_s = _lasted_s(session)
    truth = children["sensor_bench"].get("/truth") if children["sensor_bench"].running() else {}
    _say("stopping ...")
    session.stop(lambda: stop.impatient)
    if session.problem:
        failed.append(f"the session: {session.problem}")
    _await_report(watch, session, stop)
    stopped_at = time.monotonic()
    killed = children.end(STOP_S)
    _say(f"all ended within {time.monotonic() - stopped_at:.1f} s")
    failed += [f"{name} had to be killed" for name in killed]
    print(watch.summary(truth, recorded(session.directory) if session.directory else {}))
    print(f"page:     {page}, as long as the demo ran")
    print(f"report:   {_report(session)}")
    if lasted_s >= SILENT_AFTER_S:
        failed += watch.silent(SENSORS)
    for line in failed:
        print(f"PROBLEM  {line}")
    return 1 if failed else 0


def _follow(
    watch: "StudyWatch", children: Children, session: "DemoSession", duration: float | None, stop: _StopFlag
) -> list[str]:
    """Watch until the end; set the markers of a session of known length; return what went wrong."""
    failed: list[str] = []
    begun = time.monotonic()
    next_line = begun + PROGRESS_S
    markers = list(MARKERS) if duration is not None else []
    while not stop.set:
        watch.spin(0.1)
        session.look()
        for child in children.fallen():
            failed.append(f"{child.name} ended by itself with status {child.status()}")
            _say(f"{failed[-1]}; its last words:\n{child.log()[-2000:]}")
        if time.monotonic() > next_line:
            next_line += PROGRESS_S
            _say(watch.line())
        if duration is None:
            continue
        if session.start_ns:
            lasted_s = _lasted_s(session)
            while markers and not session.over and lasted_s >= markers[0][0] * duration:
                session.mark(markers.pop(0)[1])
            if lasted_s >= duration:
                break
        elif session.over or time.monotonic() - begun > READY_S:
            if not session.over:
                failed.append(f"the session did not begin within {READY_S:.0f} s")
            break
    return failed


def _lasted_s(session: "DemoSession") -> float:
    """Return for how long the session has been recording, in s."""
    return (time.time_ns() - session.start_ns) / 1e9 if session.start_ns else 0.0


def _await_report(watch: "StudyWatch", session: "DemoSession", stop: _StopFlag) -> None:
    """Wait for the report that the recorder makes of a finished session."""
    path = Path(session.directory) / "report.html"
    if not session.directory or not session.start_ns or path.exists():
        return
    _say("waiting for the report ...")
    deadline = time.monotonic() + (REPORT_CTRL_C_S if stop.set else REPORT_S)
    while not path.exists() and time.monotonic() < deadline and not stop.impatient:
        watch.spin(0.1)


def _report(session: "DemoSession") -> str:
    """Return the path of the session's report and its verdict, or why there is none."""
    if not session.directory or not session.start_ns:
        return "none, nothing was recorded"
    path = Path(session.directory) / "report.html"
    if not path.exists():
        return f"none in time; make it with: python -m sense4hri_session.report {session.directory}"
    with contextlib.suppress(OSError, ValueError):
        return f"{path} ({json.loads(path.with_name('report.json').read_text('utf-8'))['verdict']})"
    return str(path)


if __name__ == "__main__":
    sys.exit(main())
