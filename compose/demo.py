"""`make demo`: a study as plain processes on this machine, without Docker or root; the demo study needs no sensor.

Starts the services of a study file, records a session through the handshake, says what it waits for, where the page
and the recording are and what flows; a study that replays a recording it plays to its end. On Ctrl-C, when its
terminal is closed, or after --duration it stops the session, waits for the report, ends everything and sums up; a
second Ctrl-C does not wait.
Exit status 1 where anything in the chain stayed silent, 78 where `make check` finds what is wrong before anything has
started.
"""

import argparse
import contextlib
import dataclasses
import errno
import json
import math
import os
import re
import shutil
import signal
import stat
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import demo_setup
from children import Child, Children
from study_file import WRONG, Service, Study, StudyError

if TYPE_CHECKING:
    from demo_session import DemoSession
    from study_watch import StudyWatch

END_LAST = ("sensor_bench", "recorder")  # the drivers release their sensors before, the recorder hears all of it
READY_S = 90.0  # the beats of a recording are found first
READY_EACH_S = 5.0  # processes that begin at once share the cores
STOP_S = 10.0  # of each process, as Docker stops a container
PROGRESS_S = 10.0
REPORT_S, REPORT_CTRL_C_S = 20.0, 3.0  # after a Ctrl-C all is to end within 10 s; the recorder, ending, finishes it
MARKERS = ((0.1, "condition_start"), (0.9, "condition_end"))  # of a session of known length: when, as a share of it
SILENT_AFTER_S = 30.0  # a run shorter than this cannot say that the slower parts of the chain are silent


def main() -> int:
    """Run the study; return the exit status."""
    options = demo_setup.options((__doc__ or "").partition("\n")[0])
    claim = demo_setup.own_domain()
    try:
        if demo_setup.unfit(options):
            return WRONG
        study = demo_setup.read(options)
        if wrong := demo_setup.unplayable(study, options.input):
            print(wrong, file=sys.stderr)
            return WRONG
        return _run(study, options)
    except StudyError as error:
        print(error, file=sys.stderr)
        return WRONG
    finally:
        claim.close()


def _run(study: Study, options: argparse.Namespace) -> int:
    from study_watch import StudyWatch  # starts ROS, which reads the domain then

    work = Path(tempfile.mkdtemp(prefix="sense4hri-demo-"))
    last = [service.name for package in END_LAST for service in study.processes if service.package == package]
    children = Children(work, last)
    stop = _StopFlag()
    try:
        if not _start(children, study, options, work, stop):
            return 1
        replay = study.of("replay")
        if replay is None and study.of("session_coordinator") is None:
            return _attend(children, stop)
        watch = StudyWatch()
        try:
            if replay is not None:
                return _replay(watch, children, children[replay.name], options.duration, stop)
            return _watch(watch, children, study, options, stop)
        finally:
            watch.close()
    finally:
        children.end(STOP_S)
        shutil.rmtree(work, ignore_errors=True)


def _attend(children: Children, stop: "_StopFlag") -> int:
    """Keep the part of a machine that has no session-coordinator running: others conduct the session."""
    failed: list[str] = []
    while not stop.set:
        time.sleep(0.1)
        failed += _fallen(children)
    return int(bool(failed))


def _fallen(children: Children, done: Child | None = None) -> list[str]:
    """Say who has ended by itself since the last call; return a sentence for each. done: who may end in order."""
    sentences = []
    for child in children.fallen():
        if not (child is done and child.status() == 0):
            sentences.append(f"{child.name} ended by itself with status {child.status()}")
            _say(f"{sentences[-1]}; its last words:\n{child.log()[-2000:]}")
    return sentences


def _replay(watch: "StudyWatch", children: Children, replay: Child, duration: float | None, stop: "_StopFlag") -> int:
    """Look on while a recording is played, to its end, or for so many s; without one until told to stop."""
    failed: list[str] = []
    begun = time.monotonic()
    next_line = begun + PROGRESS_S
    while not stop.set and not failed and replay.running() and time.monotonic() - begun < (duration or math.inf):
        watch.spin(0.1)
        if time.monotonic() > next_line:
            next_line += PROGRESS_S
            played = replay.get("/status")
            _say(f"{played.get('position_s', 0.0):.0f} of {played.get('duration_s', 0.0):.0f} s; {watch.line()}")
        failed += _fallen(children, replay)
    failed += _fallen(children, replay)
    _say("the recording has been played; stopping ..." if replay.status() == 0 else "stopping ...")
    killed = children.end(STOP_S)
    failed += [f"{child.name} had to be killed; it said last: {child.last_words()}" for child in killed]
    print(watch.summary({}, {}))
    for line in failed:
        print(f"PROBLEM  {line}")
    return 1 if failed else 0


class _StopFlag:
    """Set by Ctrl-C, SIGTERM and a terminal that is closed; by a second Ctrl-C or SIGTERM, waiting is over as well."""

    def __init__(self) -> None:
        self.set = self.impatient = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # it is under nohup
            signal.signal(signal.SIGHUP, self._on_hangup)

    def _on_signal(self, number: int, frame: object) -> None:
        self.set, self.impatient = True, self.set

    def _on_hangup(self, number: int, frame: object) -> None:
        self.set = True
        _speak_to_nobody()


def _speak_to_nobody() -> None:
    """Let what is said from now on go nowhere, but to a file."""
    with open(os.devnull, "w") as nowhere:
        for output in (sys.stdout, sys.stderr):
            if not stat.S_ISREG(os.fstat(output.fileno()).st_mode):  # a terminal or a pipe, with nobody behind it
                os.dup2(nowhere.fileno(), output.fileno())


def _say(text: str) -> None:
    """Print a line at once; where the terminal is closed just then it is lost, and SIGHUP is about to come."""
    try:
        print(f"{datetime.now(UTC):%H:%M:%S}  {text}", flush=True)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        _speak_to_nobody()


def _start(children: Children, study: Study, options: argparse.Namespace, work: Path, stop: _StopFlag) -> bool:
    """Start everything, a line each, what data come from last; False where something did not come up."""
    _say(f"study {study.name}; ROS domain {os.environ['ROS_DOMAIN_ID']}; logs in {work}")
    if options.input is not None:
        _say(f"p1 plays {options.input}")
    for service in study.only_images:
        _say(f"{service.name} is left out: it has no command, only an image")
    volumes = work / "volumes"
    for name in study.volumes():
        (volumes / name).mkdir(parents=True)
    sources = [service for service in study.processes if service in study.sensors or service.package == "replay"]
    others = [service for service in study.processes if service not in sources]
    begun = [(service, _begin(children, service, options, volumes)) for service in others]
    if not _until_ready([child for service, child in begun if service.ours], stop):
        return False
    given = [(source, _begin(children, source, options, volumes)) for source in sources]
    if not _until_ready([child for source, child in given if source.ours], stop, "/healthz"):
        return False
    if page := _page(children, study):
        _say(f"the page:       {page}")
    _say("Ctrl-C ends it" if options.duration is None else f"ends after {options.duration:g} s of recording")
    return True


def _begin(children: Children, service: Service, options: argparse.Namespace, volumes: Path) -> Child:
    """Start one service, with what the options of this program change in it."""
    given: dict[str, str] = {}
    if service.package == "recorder":
        given["record_when"] = "session"
    if service.package == "sensor_bench" and options.input is not None:
        given["input"] = json.dumps(str(Path(options.input).resolve()))
    process = service.process(volumes)
    words = [word for name, value in given.items() for word in ("--ros-args", "-p", f"{name}:={value}")]
    return children.start(service.name, dataclasses.replace(process, command=[*process.command, *words]))


def _page(children: Children, study: Study) -> str:
    """Return the address that web-gui says it serves, "" where the study has no page."""
    gui = study.of("web_gui")
    found = re.search(r"the page is at (\S+)", children[gui.name].log()) if gui else None
    return found[1] if found else ""


def _until_ready(group: list[Child], stop: _StopFlag, path: str = "/readyz") -> bool:
    """Wait for all of them, a line each; False where one does not come up, or all is to stop."""
    deadline = time.monotonic() + _ready_s(len(group))
    for child in group:
        while not child.ready(path):
            if stop.set:
                return False
            wrong = [one for one in group if not one.running()] or [child] * (time.monotonic() > deadline)
            for one in wrong:
                why = "did not get ready in time" if one.running() else f"ended with status {one.status()}"
                print(f"{one.name} {why}; its log:\n{one.log()}", file=sys.stderr)
            if wrong:
                return False
            time.sleep(0.1)
        _say(f"{child.name:<19} {'ready' if path == '/readyz' else 'started'}")
    return True


def _ready_s(processes: int) -> float:
    """Return how long so many processes may take to begin, in s."""
    return READY_S + READY_EACH_S * processes


def _watch(watch: "StudyWatch", children: Children, study: Study, options: argparse.Namespace, stop: _StopFlag) -> int:
    from demo_session import DemoSession, recorded

    page = _page(children, study)
    session = DemoSession(watch, _say)
    session.start(study)
    failed = _follow(watch, children, session, options.duration, stop, _ready_s(len(study.processes)))
    lasted_s = _lasted_s(session)
    bench = study.of("sensor_bench")
    truth = children[bench.name].get("/truth") if bench else {}
    _say("stopping ...")
    session.stop(lambda: stop.impatient)
    if session.problem:
        failed.append(f"the session: {session.problem}")
    _await_report(watch, session, stop)
    stopped_at = time.monotonic()
    killed = children.end(STOP_S)
    _say(f"all ended within {time.monotonic() - stopped_at:.1f} s")
    failed += [f"{child.name} had to be killed; it said last: {child.last_words()}" for child in killed]
    print(watch.summary(truth, recorded(session.directory) if session.directory else {}))
    print(f"page:     {page or 'none in this study'}, as long as it ran")
    print(f"report:   {_report(session)}")
    if lasted_s >= SILENT_AFTER_S:
        failed += watch.silent(study)
    for line in failed:
        print(f"PROBLEM  {line}")
    return 1 if failed else 0


def _follow(
    watch: "StudyWatch",
    children: Children,
    session: "DemoSession",
    duration: float | None,
    stop: _StopFlag,
    ready_s: float,
) -> list[str]:
    """Watch until the end; set the markers of a session of known length; return what went wrong."""
    failed: list[str] = []
    begun = time.monotonic()
    next_line = begun + PROGRESS_S
    markers = list(MARKERS) if duration is not None else []
    while not stop.set:
        watch.spin(0.1)
        session.look()
        failed += _fallen(children)
        if failed and not session.start_ns:
            break
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
        elif session.over or time.monotonic() - begun > ready_s:
            if not session.over:
                failed.append(f"the session did not begin within {ready_s:.0f} s")
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
        return f"none in time; make it with: {Path(sys.executable).parent}/sense4hri-report {session.directory}"
    with contextlib.suppress(OSError, ValueError):
        return f"{path} ({json.loads(path.with_name('report.json').read_text('utf-8'))['verdict']})"
    return str(path)


if __name__ == "__main__":
    sys.exit(main())
