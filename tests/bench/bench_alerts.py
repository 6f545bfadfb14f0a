"""From the cause to the alert: faults in a running study, seen by a real Prometheus with the house's rules.

The demo's services with one person's strap and arm band. Firing: from the fault until Prometheus says `firing`;
cleared: from the end of the fault until it no longer does. False: alerts in a clean stretch of CLEAN_S before it. After
BUDGET_S no further fault is begun.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "compose"))

import monitoring
from faulted_study import BAND, BENCH, RECORDER, STRAP, FaultedStudy, place
from monitoring import Monitoring
from processes import Processes

FIRES_WITHIN_S = 15.0
LONGEST_S = 90.0
CLEAN_S = float(os.environ.get("CLEAN_S", "1800"))
BUDGET_S = float(os.environ.get("BUDGET_S", "1200"))
DISK_MB = 200
ECG = "interpreter_ecg"
TARGET = "<= 15 s"
DOWN = ("ServiceDown", "ServiceUnanswering")
LEFT_BYTES = 1_500_000


def rows() -> list[dict[str, Any]]:
    """Return the measured rows."""
    bin_folder = monitoring.programs()
    if bin_folder is None:
        return []
    with place(DISK_MB) as here:
        watch = Monitoring(here.folder, bin_folder)
        try:
            return Watched(here.folder, here.disk, here.processes, watch).rows(here.small)
        finally:
            watch.close()


class Fault(NamedTuple):
    """What hurts, which alerts may tell it, and what heals."""

    what: str
    alerts: tuple[str, ...]
    hurt: Callable[[], object]
    heal: Callable[[], object]


class Watched:
    """A study in a session, and the Prometheus that scrapes it."""

    def __init__(self, folder: Path, disk: Path, processes: Processes, watch: Monitoring) -> None:
        self._watch, self._disk = watch, disk
        self._study = FaultedStudy(folder, disk, processes.start)
        self._ended = threading.Event()
        threading.Thread(target=self._keep_targets, daemon=True).start()
        self._study.begin()

    def rows(self, small: bool) -> list[dict[str, Any]]:
        """The clean stretch first, then one fault after the other."""
        found, begun_s = [self._clean()], time.monotonic()
        for fault in [*self._faults(), *([self._disk_fault()] if small else [])]:
            if time.monotonic() - begun_s < BUDGET_S:
                found.append(self._measured(fault))
                print(found[-1], file=sys.stderr, flush=True)
        self._ended.set()
        return found

    def _keep_targets(self) -> None:
        """Scrape all that has a port, also what has died meanwhile, as long as nothing has taken its place."""
        while not self._ended.wait(1.0):
            running = list(self._study.running.values())
            self._watch.watch([one.port() for one in running if "metrics on port " in one.log()])

    def _clean(self) -> dict[str, Any]:
        seen: set[tuple[str, str]] = set()
        end_s = time.monotonic() + CLEAN_S
        while time.monotonic() < end_s:
            seen |= self._watch.firing()
            time.sleep(1.0)
        said = ", ".join(f"{name} of {whom}" for name, whom in sorted(seen)) or "none"
        what, good = f"false alerts in a clean {CLEAN_S / 60:.2g} min", not seen if CLEAN_S >= 1800 else None
        return {"what": what, "target": "0 in 30 min", "measured": f"{len(seen)}: {said}", "ok": good}

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
        ]

    def _turned(self, what: str, alert: str, sensor: str, knob: str, wrong: object, right: object) -> Fault:
        def turn(value: object) -> None:
            status, said = self._study.running[BENCH].ask(f"/devices/{sensor}/knobs", {knob: value})
            assert status == 200, said

        return Fault(what, (alert,), lambda: turn(wrong), lambda: turn(right))

    def _killed(self, what: str, name: str) -> Fault:
        def again() -> None:
            self._study.running[name] = self._study.begun(name)

        return Fault(what, (*DOWN, "StreamSilent"), lambda: self._study.running[name].kill(), again)

    def _stopped(self, what: str, name: str) -> Fault:
        def send(number: signal.Signals) -> None:
            self._study.running[name].send(number)  # looked up then: an earlier fault may have begun it anew

        return Fault(f"{what} (SIGSTOP)", DOWN, lambda: send(signal.SIGSTOP), lambda: send(signal.SIGCONT))

    def _disk_fault(self) -> Fault:
        ballast = self._disk / "ballast"

        def fill() -> None:
            free = os.statvfs(self._disk)
            ballast.write_bytes(bytes(max(free.f_bavail * free.f_frsize - LEFT_BYTES, 0)))

        return Fault("disk of the recordings fills", ("DiskFilling", "RecorderCannotRecord"), fill, ballast.unlink)

    def _measured(self, fault: Fault) -> dict[str, Any]:
        before = {one for one in self._watch.firing() if one[0] in fault.alerts}
        begun_s = time.monotonic()
        fault.hurt()
        fired, fired_s = self._until(lambda: self._new(fault, before), begun_s)
        healed_s = time.monotonic()
        fault.heal()
        _, cleared_s = self._until(lambda: not self._watch.firing() & set(fired or ()), healed_s)
        told = f"{fired[0][0]} of {fired[0][1]} after {fired_s:.1f} s" if fired else f"not within {LONGEST_S:g} s"
        ended = f"cleared after {cleared_s:.1f} s" if cleared_s < LONGEST_S else f"not cleared within {LONGEST_S:g} s"
        good = bool(fired) and fired_s <= FIRES_WITHIN_S
        return {"what": f"{fault.what}: alert fires", "target": TARGET, "measured": f"{told}, {ended}", "ok": good}

    def _new(self, fault: Fault, before: set[tuple[str, str]]) -> list[tuple[str, str]]:
        return sorted(one for one in self._watch.firing() - before if one[0] in fault.alerts)

    def _until(self, condition: Callable[[], Any], begun_s: float) -> tuple[Any, float]:
        """Return what the condition gave, and after how long; LONGEST_S where it never held."""
        while time.monotonic() - begun_s < LONGEST_S:
            if found := condition():
                return found, time.monotonic() - begun_s
            time.sleep(0.2)
        return None, LONGEST_S
