"""`make demo`: the demo study as plain processes on this machine, without Docker, root or a sensor.

Starts the virtual sensors and every service, says where the page and the recording are, shows what flows, and on Ctrl-C
(or after --duration) ends everything and sums up. Exit status 1 where anything in the chain stayed silent.
"""

import argparse
import contextlib
import os
import random
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
READY_S = 60.0
STOP_S = 8.0
PROGRESS_S = 10.0
SILENT_AFTER_S = 30.0  # a run shorter than this cannot say that the slower parts of the chain are silent


def main() -> int:
    """Run the demo; return the exit status."""
    options = _options()
    missing = _missing()
    if missing:
        print("\n".join(missing), file=sys.stderr)
        return 2
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
    parser.add_argument("--duration", type=float, metavar="S", help="stop by itself after so many seconds of streaming")
    parser.add_argument("--input", metavar="FILE", help="p1 plays this real recording (see services/sensor-bench)")
    parser.add_argument("--port", type=int, default=8080, help="port of the page (8080)")
    parser.add_argument("--recordings", type=Path, default=ROOT / "recordings", help="folder for recordings")
    return parser.parse_args()


def _missing() -> list[str]:
    lines = []
    if shutil.which("dbus-daemon") is None:
        lines.append("dbus-daemon is missing: the virtual sensors need it. Debian, Ubuntu: apt-get install dbus-daemon")
    return lines


class _StopFlag:
    """Set by Ctrl-C and SIGTERM."""

    def __init__(self) -> None:
        self.set = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, frame: object) -> None:
        self.set = True


def _say(text: str) -> None:
    print(f"{datetime.now(UTC):%H:%M:%S}  {text}", flush=True)


def _start(children: Children, options: argparse.Namespace, work: Path, recordings: Path, stop: _StopFlag) -> bool:
    """Start everything, a line each; False where something did not come up."""
    _say(f"ROS domain {os.environ['ROS_DOMAIN_ID']}; logs in {work}")
    recorder = children.start("recorder", {"directory": str(recordings)})
    bus = work / "bus"
    bench = children.start("sensor_bench", {"socket_path": str(bus), **_played(options.input)})
    for name in SERVICES:
        children.start(name, _kept(name, work))
    gui = children.start("web_gui", {"port": options.port})
    if not _until_ready([recorder, bench, gui, *(children[name] for name in SERVICES)], stop):
        return False
    for sensor in SENSORS:
        env = {"DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={bus}"}
        children.start("driver_polar", {}, name=sensor, params_file=STUDY / f"{sensor}.yaml", env=env)
    if not _until_ready([children[sensor] for sensor in SENSORS], stop):
        return False
    _say(f"the page:       http://127.0.0.1:{options.port}")
    _say(f"the recording:  {recorder.get('/recording').get('directory', recordings)}")
    _say("Ctrl-C ends it" if options.duration is None else f"ends after {options.duration:g} s")
    return True


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
            if not child.running() or time.monotonic() > deadline:
                why = "did not get ready in time" if child.running() else f"ended with status {child.status()}"
                print(f"{child.name} {why}; its log:\n{child.log()}", file=sys.stderr)
                return False
            time.sleep(0.1)
        _say(f"{child.name:<18} ready")
    return True


def _watch(watch: "StudyWatch", children: Children, options: argparse.Namespace, stop: _StopFlag) -> int:
    begun = time.monotonic()
    next_line = begun + PROGRESS_S
    failed: list[str] = []
    while not stop.set and (options.duration is None or time.monotonic() - begun < options.duration):
        watch.spin(0.1)
        for child in children.fallen():
            failed.append(f"{child.name} ended by itself with status {child.status()}")
            _say(f"{failed[-1]}; its last words:\n{child.log()[-2000:]}")
        if time.monotonic() > next_line:
            next_line += PROGRESS_S
            _say(watch.line())
    lasted_s = time.monotonic() - begun
    truth = children["sensor_bench"].get("/truth") if children["sensor_bench"].running() else {}
    recording = children["recorder"].get("/recording") if children["recorder"].running() else {}
    _say("stopping ...")
    stopped_at = time.monotonic()
    killed = children.end(STOP_S)
    _say(f"all ended within {time.monotonic() - stopped_at:.1f} s")
    failed += [f"{name} had to be killed" for name in killed]
    print(watch.summary(truth, recording))
    if lasted_s >= SILENT_AFTER_S:
        failed += watch.silent(SENSORS)
    for line in failed:
        print(f"PROBLEM  {line}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
