"""From the cause to the alert: faults in a running study, seen by a real Prometheus with the house's rules.

The demo's services with one person's strap and arm band, and the clock-sync of a second host on a clock of its own.
Firing: from the fault until Prometheus says `firing`; cleared: from the end of the fault until it no longer does; some
rules look back for long, so that clearing is waited for longer. After BUDGET_S no further fault is begun.
What fires where nothing is wrong: bench_false_alerts.py.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "compose"))

import monitoring
from faulted_study import BAND, BENCH, RECORDER, STRAP, FaultedStudy, Place, place
from monitoring import Monitoring
from processes import Process
from sense4hri.host_clocks import this_host
from wall_clock import WallClock

FIRES_WITHIN_S = 15.0
LONGEST_S = 90.0
BUDGET_S = float(os.environ.get("BUDGET_S", "1200"))
DISK_MB = 2000
ECG, PPG = "interpreter_ecg", "interpreter_ppg"
TARGET = "<= 15 s"
OTHER_HOST = "other"
APART_S, BEGINS_ANEW_EVERY_S = 0.5, 10.0
"""Two machines' clocks; and how often a sensor's begins anew: before the 20 s after which clock-sync may be sure."""
NOBODY = "Polar H10 00000000"
FLOOD = str(Path(__file__).with_name("flood_publisher.py"))
BYTES_FLOOD = ("2", "200", "50000", "120")
"""Topics, messages per second, bytes of each, seconds: an inbox holds 3 s of it."""
SPREAD_FLOOD = ("40", "6000", "200", "120", "flood_spread")
"""150 messages per second of each topic, of which the recorder's queue holds half a minute."""
ONE_FLOOD = ("1", "4000", "200", "120", "flood_one")
"""4000 messages per second of one topic, of which the recorder's queue holds a second."""
CROWD = (sys.executable, "-c", "while True: pass")
LEAST_NICE = 19
DOWN = ("ServiceDown", "ServiceUnanswering")
SHORT_BYTES, NO_BYTES = 6_000_000, 100_000
"""What is left for minutes only; and less than the tenth of `free_floor_mb` at which a running recording stops."""
HELD_S, LET_S, LOOK_EVERY_S = 0.15, 0.002, 0.0002
"""How long a starved process waits for a core, and for how long it then works with one: less than one packet takes."""


def rows() -> list[dict[str, Any]]:
    """Return the measured rows, none where Prometheus is not to be had."""
    with watched_study() as study:
        return study.rows() if study else []


@contextmanager
def watched_study() -> "Iterator[Watched | None]":
    """Start a study and what watches it, and end both; None where Prometheus is not to be had."""
    bin_folder = monitoring.programs()
    if bin_folder is None:
        yield None
        return
    with place(DISK_MB) as here:
        watch = Monitoring(here.folder, bin_folder)
        try:
            with closing(Watched(here, watch)) as study:
                yield study
        finally:
            watch.close()


class Fault(NamedTuple):
    """What hurts, which alerts may tell it, and what heals; prepare: what takes its time before it can hurt.

    stays_s: for how long the rule looks back. waits_s: for how long it waits on purpose before it fires.
    """

    what: str
    alerts: tuple[str, ...]
    hurt: Callable[[], object]
    heal: Callable[[], object]
    stays_s: float = 0.0
    waits_s: float = 0.0
    prepare: Callable[[], object] = lambda: None


class Starved:
    """Takes the core from a process in the middle of its work, as a far too busy machine does."""

    def __init__(self, process: Callable[[], Process]) -> None:
        self._process, self._ended = process, threading.Event()
        self._thread = threading.Thread(target=self._hold, daemon=True)

    def begin(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()

    def _hold(self) -> None:
        process = self._process()
        cpu_clock = ~process.child.pid << 3 | 2  # clock_getcpuclockid(3), which Python does not have
        while not self._ended.is_set():
            begun_s = time.clock_gettime(cpu_clock)
            while time.clock_gettime(cpu_clock) - begun_s < LET_S and not self._ended.wait(LOOK_EVERY_S):
                pass
            process.send(signal.SIGSTOP)
            time.sleep(HELD_S)
            process.send(signal.SIGCONT)


class Crowded:
    """Leaves the thread that does a process's work some hundredth of a core; its other threads go on receiving.

    SIGSTOP would not do: what is stopped does not receive either, and a message waits from its receipt on.
    thread_name: as the kit calls it; empty: the main thread.
    """

    def __init__(self, process: Callable[[], Process], thread_name: str) -> None:
        self._process, self._name, self._cores = process, thread_name, os.sched_getaffinity(0)
        self._crowd = list[subprocess.Popen[bytes]]()

    def begin(self) -> None:
        core, thread = {min(self._cores)}, self._thread()
        self._crowd.append(subprocess.Popen(CROWD))
        for crowding in (thread, self._crowd[0].pid):
            os.sched_setaffinity(crowding, core)
        os.setpriority(os.PRIO_PROCESS, thread, LEAST_NICE)

    def end(self) -> None:
        self._crowd[0].kill()
        self._crowd[0].wait()
        os.setpriority(os.PRIO_PROCESS, self._thread(), 0)
        os.sched_setaffinity(self._thread(), self._cores)

    def _thread(self) -> int:
        """Return the number by which the system knows the thread."""
        process = self._process().child.pid
        threads = (process, *(int(one.name) for one in Path(f"/proc/{process}/task").iterdir()))
        names = ((one, Path(f"/proc/{process}/task/{one}/comm").read_text().strip()) for one in threads)
        return next(one for one, name in names if self._name in ("", name))


class Repeated:
    """Does something at once and every so many seconds, until it is told to end."""

    def __init__(self, do: Callable[[], object], every_s: float) -> None:
        self._do, self._every_s, self._ended = do, every_s, threading.Event()
        self._thread = threading.Thread(target=self._repeat, daemon=True)

    def begin(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()

    def _repeat(self) -> None:
        self._do()
        while not self._ended.wait(self._every_s):
            self._do()


class Watched:
    """A study in a session, and the Prometheus that scrapes it."""

    def __init__(self, here: Place, watch: Monitoring) -> None:
        self._here, self._watch, self._start = here, watch, here.processes.start
        self._study = FaultedStudy(here.folder, here.disk, self._start)
        self._ended = threading.Event()
        threading.Thread(target=self._keep_targets, daemon=True).start()
        self._study.begin()
        self._other_clock = WallClock(here.folder)
        self._second_host(self._other_clock)

    def _second_host(self, clock: WallClock) -> Process:
        """Start the clock-sync of a machine with this clock that is called OTHER_HOST."""
        return self._start("clock_sync", env=clock.env, host=OTHER_HOST, reference_host=this_host())

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each fault, one after the other."""
        found, begun_s = list[dict[str, Any]](), time.monotonic()
        for fault in [*self._faults(), *(self._faults_of_root() if self._here.small else [])]:
            if time.monotonic() - begun_s < BUDGET_S:
                found.append(self._measured(fault))
                print(found[-1], file=sys.stderr, flush=True)
        return found

    def fired_within(self, seconds: float) -> set[tuple[str, str]]:
        """Return the alerts, and whom they told of, that fire in the next so many seconds."""
        seen, end_s = set[tuple[str, str]](), time.monotonic() + seconds
        while time.monotonic() < end_s:
            seen |= self._watch.firing()
            time.sleep(1.0)
        return seen

    def close(self) -> None:
        self._ended.set()

    def _keep_targets(self) -> None:
        """Scrape all that has a port, also what has died meanwhile, as long as nothing has taken its place."""
        while not self._ended.wait(1.0):
            running = list(self._study.running.values())
            self._watch.watch([one.port() for one in running if "metrics on port " in one.log()])

    def _faults(self) -> list[Fault]:
        return [
            self._turned("link of a sensor cut", "StreamSilent", STRAP, "down", True, False),
            self._turned("battery at 10 %", "BatteryLow", BAND, "battery_percent", 10, 90),
            self._turned("contact lost", "ContactLost", STRAP, "contact", False, True),
            self._killed("interpreter killed", ECG),
            self._stopped("interpreter stopped", ECG),
            self._killed("driver killed", STRAP),
            self._stopped("driver stopped", BAND),
            self._killed("recorder killed", RECORDER),
            self._killed("virtual sensors and their bus killed", BENCH),
            self._turned("two of five packets lost", "RateLow", STRAP, "loss", 0.4, 0.0),
            self._starved("driver hardly gets a core", STRAP),
            self._stepped("clock of a second host set 0.5 s ahead"),
            self._turned("link slower by 0.4 s", "ClockUnlocked", BAND, "latency_s", 0.43, 0.03),
            self._restarted("interpreter killed and begun anew", PPG),
            self._turned("one of fifty packets lost", "SamplesLost", STRAP, "loss", 0.02, 0.0, stays_s=60.0),
            self._turned("link slower by 1.5 s", "LinkBehind", STRAP, "latency_s", 1.53, 0.03),
            self._absent("driver of a sensor that is not there"),
            self._doubled("two machines of one host name"),
            self._beginning_anew("clock of a sensor begins anew every 10 s", STRAP),
        ]

    def _turn(self, sensor: str, knob: str, value: object) -> None:
        status, said = self._study.running[BENCH].ask(f"/devices/{sensor}/knobs", {knob: value})
        assert status == 200, said

    def _turned(
        self, what: str, alert: str, sensor: str, knob: str, wrong: object, right: object, stays_s: float = 0.0
    ) -> Fault:
        turn = partial(self._turn, sensor, knob)
        return Fault(what, (alert,), lambda: turn(wrong), lambda: turn(right), stays_s)

    def _beginning_anew(self, what: str, sensor: str) -> Fault:
        """Such a clock never leaves WARMUP; a link that only jitters does after 60 s, as sure as it can be by then."""
        resets = Repeated(lambda: self._turn(sensor, "clock_reset", True), BEGINS_ANEW_EVERY_S)
        return Fault(what, ("ClockNotFound",), resets.begin, resets.end, waits_s=60.0)

    def _doubled(self, what: str) -> Fault:
        """As on a machine that was set up from another one's disk."""
        folder, begun = self._here.folder / "doubled", list[Process]()

        def begin() -> None:
            folder.mkdir()
            clock = WallClock(folder)
            clock.step(APART_S)
            begun.append(self._second_host(clock))

        return Fault(what, ("ServiceNotReady",), begin, lambda: begun[0].kill())

    def _killed(self, what: str, name: str) -> Fault:
        def again() -> None:
            self._study.running[name] = self._study.begun(name)

        return Fault(what, (*DOWN, "StreamSilent"), lambda: self._study.running[name].kill(), again)

    def _stopped(self, what: str, name: str) -> Fault:
        def send(number: signal.Signals) -> None:
            self._study.running[name].send(number)  # looked up then: an earlier fault may have begun it anew

        return Fault(f"{what} (SIGSTOP)", DOWN, lambda: send(signal.SIGSTOP), lambda: send(signal.SIGCONT))

    def _starved(self, what: str, name: str) -> Fault:
        starved = Starved(lambda: self._study.running[name])
        return Fault(what, ("LatencyGrowing",), starved.begin, starved.end, stays_s=30.0)

    def _flooded(self, what: str, alert: str, name: str, thread_name: str, words: tuple[str, ...]) -> Fault:
        """More comes than a service takes in whose working thread hardly gets a core."""
        crowded = Crowded(lambda: self._study.running[name], thread_name)
        floods = list[subprocess.Popen[str]]()

        def prepare() -> None:
            command = [sys.executable, FLOOD, *words]
            floods.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
            assert floods[0].stdout is not None
            assert floods[0].stdout.readline() == "there\n"

        def begin() -> None:
            crowded.begin()
            assert floods[0].stdin is not None
            floods[0].stdin.close()

        def end() -> None:
            with floods[0]:
                floods[0].kill()
            crowded.end()

        return Fault(what, (alert,), begin, end, stays_s=60.0, prepare=prepare)

    def _absent(self, what: str) -> Fault:
        begun: list[Process] = []

        def begin() -> None:
            begun.append(self._start("driver_polar", sensor_id="h10_9", human_id="p9", model="H10", name=NOBODY))
            self._study.running["h10_9"] = begun[0]

        def end() -> None:
            del self._study.running["h10_9"]
            begun[0].kill()

        return Fault(what, ("SensorNotFound",), begin, end, waits_s=60.0)

    def _stepped(self, what: str) -> Fault:
        step = self._other_clock.step
        return Fault(what, ("HostClocksApart",), lambda: step(0.5), lambda: step(-0.5))

    def _restarted(self, what: str, name: str) -> Fault:
        """At the same address, as a container is: two processes at two addresses are a new one and one that is gone."""

        def again() -> None:
            before = self._study.running[name]
            before.kill()
            self._study.running[name] = self._study.begun(name, METRICS_PORT=str(before.port()))
            self._study.running[name].port()

        return Fault(what, ("ServiceRestarting",), again, lambda: None, stays_s=120.0)

    def _faults_of_root(self) -> list[Fault]:
        """A crowd takes the core, which only root can give back; then room for some minutes only, then none at all."""
        ballast = self._here.disk / "ballast"

        def fill(left_bytes: int) -> None:
            free = os.statvfs(self._here.disk)
            with ballast.open("ab") as file:
                os.posix_fallocate(file.fileno(), file.tell(), max(free.f_bavail * free.f_frsize - left_bytes, 1))

        return [
            self._flooded("10 MB/s, a busy interpreter", "MessagesDropped", ECG, "", BYTES_FLOOD),
            self._flooded("4000 messages/s, a busy recorder", "MessagesLost", RECORDER, "hearing", ONE_FLOOD),
            self._flooded(
                "6000 messages/s of 40 topics, a busy recorder", "RecorderBehind", RECORDER, "hearing", SPREAD_FLOOD
            ),
            Fault("disk of the recordings fills", ("DiskFilling",), lambda: fill(SHORT_BYTES), ballast.unlink),
            Fault("disk of the recordings is full", ("RecorderCannotRecord",), lambda: fill(NO_BYTES), ballast.unlink),
        ]

    def _measured(self, fault: Fault) -> dict[str, Any]:
        fault.prepare()
        before = {one for one in self._watch.firing() if one[0] in fault.alerts}
        begun_s = time.monotonic()
        fault.hurt()
        fired, fired_s = self._until(lambda: self._new(fault, before), begun_s, LONGEST_S)
        healed_s = time.monotonic()
        fault.heal()
        longest_s = LONGEST_S + fault.stays_s
        _, cleared_s = self._until(lambda: not self._watch.firing() & set(fired or ()), healed_s, longest_s)
        told = f"{fired[0][0]} of {fired[0][1]} after {fired_s:.1f} s" if fired else f"not within {fired_s:g} s"
        ended = f"cleared after {cleared_s:.1f} s" if cleared_s < longest_s else f"not cleared within {longest_s:g} s"
        good = bool(fired) and fired_s <= FIRES_WITHIN_S + fault.waits_s
        target = f"{TARGET} after {fault.waits_s:g} s on purpose" if fault.waits_s else TARGET
        return {"what": f"{fault.what}: alert fires", "target": target, "measured": f"{told}, {ended}", "ok": good}

    def _new(self, fault: Fault, before: set[tuple[str, str]]) -> list[tuple[str, str]]:
        return sorted(one for one in self._watch.firing() - before if one[0] in fault.alerts)

    def _until(self, condition: Callable[[], Any], begun_s: float, longest_s: float) -> tuple[Any, float]:
        """Return what the condition gave, and after how long; longest_s where it never held."""
        while time.monotonic() - begun_s < longest_s:
            if found := condition():
                return found, time.monotonic() - begun_s
            time.sleep(0.2)
        return None, longest_s
