"""Three hosts on a bad network: partitions of 1, 10 and 60 s, a step and a drift of the drivers' clock.

    .venv/bin/python tests/bench/run.py hosts

Root and /dev/net/tun are needed; about three minutes.
"""

import random
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hosts_study import HostsStudy
from slow_network import why_not

LOSS, DELAY_S = 0.05, 0.1
CUTS_S, AFTER_S = (1, 10, 60), 15
RECOVERY_S, OFFSET_S = 5.0, 0.5e-3


def rows() -> list[dict[str, Any]]:
    """Rows of losses, recovery and host offsets; one that says why where it cannot be tried."""
    if reason := why_not():
        return [{"what": "three hosts", "target": "", "measured": f"not tried: {reason}", "ok": None}]
    with tempfile.TemporaryDirectory() as folder:
        study = HostsStudy(Path(folder), random.randint(90, 101))
        return _rows(study, _run(study))


def _run(study: HostsStudy) -> list[float]:
    """Go through all faults; return when each partition was healed."""
    healed_s = []
    try:
        study.network.loss, study.network.delay_s = LOSS, DELAY_S
        study.begin()
        time.sleep(30)
        for cut_s in CUTS_S:
            study.network.cut("drive")
            time.sleep(cut_s)
            study.network.heal("drive")
            healed_s.append(time.time())
            time.sleep(AFTER_S)
        study.step(2.0)
        time.sleep(30)
    finally:
        study.end()
    return healed_s


def _rows(study: HostsStudy, healed_s: list[float]) -> list[dict[str, Any]]:
    accounts = study.accounts().values()
    silent = sum(account.span - account.arrived - account.told_lost for account in accounts)
    lost, span = sum(a.span - a.arrived for a in accounts), sum(a.span for a in accounts)
    found = [_row("samples lost and not told", "0", f"{silent} ({lost} of {span} lost)", silent == 0)]
    for cut_s, at_s in zip(CUTS_S, healed_s, strict=True):
        took_s = max(min(came for came in account.received_s if came > at_s) - at_s for account in accounts)
        found.append(_row(f"data after a partition of {cut_s} s", "<= 5 s", f"{took_s:.1f} s", took_s <= RECOVERY_S))
    for host, what in (("drive", "250 ms ahead, 50 ppm, stepped by 2 s"), ("other", "not off")):
        errors = sorted(abs(error_s) for error_s, _ in study.host_errors(host))
        middle, high = statistics.median(errors), errors[int(0.95 * (len(errors) - 1))]
        text = f"median {middle * 1e3:.2f} ms, 95 % {high * 1e3:.2f} ms, of {len(errors)}"
        found.append(_row(f"error of a host's offset, {what}", "<= 0.5 ms", text, high <= OFFSET_S))
    return found


def _row(what: str, target: str, measured: str, ok: bool) -> dict[str, Any]:
    network = f"5 % loss, {DELAY_S * 1e3:.0f} ms each way: "
    return {"what": network + what, "target": target, "measured": measured, "ok": ok}


if __name__ == "__main__":
    for row in rows():
        print(row["what"], "|", row["target"], "|", row["measured"], "|", row["ok"])
