"""Every service of a study in a session killed once and stopped for 15 s once, its D-Bus killed, its disk filled.

Told: until the page's WebSocket has a sentence; recovered: from its restart, or SIGCONT, until nothing is wrong. Lost:
raw samples of streams that the fault does not cut off themselves. Report: what it says of the fault.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "compose"))

from faulted_study import BAND, BENCH, PAGE, RECORDER, STRAP, FaultedStudy, Told, lost, place, said

TOLD_WITHIN_S = 5.0
DISK_MB = 64


def rows() -> list[dict[str, Any]]:
    """Return the measured rows: a session in which all are killed, one in which all are stopped."""
    return [row for faults in (kills, stops_and_rest) for row in measured(faults)]


def measured(faults: Callable[[FaultedStudy, bool], list[Told]]) -> list[dict[str, Any]]:
    """One session with these faults; its recordings are on a disk that can be filled, where one can be mounted."""
    with place(DISK_MB) as here:
        study = FaultedStudy(here.folder, here.disk, here.processes.start)
        study.begin()
        told = faults(study, here.small)
        study.end()
        return [row(one, study.reports()) for one in told]


def kills(study: FaultedStudy, small: bool) -> list[Told]:
    """Everybody once."""
    return [shown(study.killed(name)) for name in study.names]


def stops_and_rest(study: FaultedStudy, small: bool) -> list[Told]:
    """Everybody stopped once; then the bus, and the disk where it is small."""
    told = [shown(study.stopped(name)) for name in study.names]
    return [*told, shown(study.bus_killed()), *([shown(study.disk_full())] if small else [])]


def shown(told: Told) -> Told:
    """Say how far it is: what the reports say of it is known at the end."""
    print(told, file=sys.stderr, flush=True)
    return told


def cut_off(told: Told) -> list[str]:
    """Sensors whose streams a fault ends itself."""
    ends_all = told.service in (BENCH, RECORDER) or "D-Bus" in told.fault
    if told.service == RECORDER and told.fault.startswith("SIGSTOP"):
        return []
    return [STRAP, BAND] if ends_all else [told.service]


def row(told: Told, reports: list[dict[str, Any]]) -> dict[str, Any]:
    """One row of the table."""
    missing, found = lost(reports, told, cut_off(told)), said(reports, told)
    at = "never" if told.told_s is None else f"{told.told_s:.1f} s"
    back = "never" if told.recovered_s is None else f"{told.recovered_s:.1f} s"
    in_report = "; ".join(dict.fromkeys(found)) or "nothing"
    needs_report = told.service != PAGE
    good = told.told_s is not None and told.told_s <= TOLD_WITHIN_S and told.recovered_s is not None and not missing
    return {
        "what": f"{told.service}, {told.fault}: told; sentence; recovered; samples lost elsewhere; report",
        "target": "<= 5 s, without a hand, 0, said",
        "measured": f"{at}; {told.sentence}; {back}; {missing}; {in_report}"[:600].replace("|", "/"),
        "ok": good and (bool(found) or not needs_report),
    }


if __name__ == "__main__":
    for entry in rows() if len(sys.argv) < 2 else measured({"kills": kills, "stops": stops_and_rest}[sys.argv[1]]):
        print(f"| {entry['what']} | {entry['measured']} | {entry['ok']} |", flush=True)
