"""What a further sensor costs in memory: driver-polar processes that stream, each with a strap of its own.

    .venv/bin/python tests/bench/bench_driver_memory.py

A container is a process here: `process_memory.py` says what is counted.
"""

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from process_memory import MOST_FURTHER_MIB, further_mib, own_and_proportional_mib
from processes import Processes, poll
from sensor_bench_process import SILENT_DOMAIN, BenchProcess

STRAPS, FIRST, LOOKS, LOOK_S, STREAMS_S = 4, 2, 10, 1.0, 60.0
DEVICE = '  - {{sensor: h10_{n}, model: H10, participant: p1, address: "F1:4A:10:00:00:0{n}", device_id: 1A2B3C0{n}}}\n'


def rows() -> list[dict[str, Any]]:
    """Measure."""
    with tempfile.TemporaryDirectory() as folder:
        some, all_of_them = measured(Path(folder))
    further = further_mib([pss for _, pss in some], [pss for _, pss in all_of_them])
    largest = max(own for own, _ in all_of_them)
    return [
        {
            "what": f"memory of a further driver-polar process (of {STRAPS}) while it streams ECG and acceleration",
            "target": f"<= {MOST_FURTHER_MIB:.0f} MiB",
            "measured": f"{further:.0f} MiB with its share of what all have (PSS), {largest:.0f} MiB its own (USS)",
            "ok": further <= MOST_FURTHER_MIB,
        }
    ]


def measured(folder: Path) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Return (own, proportional) memory in MiB of each of the FIRST drivers, then of all STRAPS."""
    devices = "participants: {p1: {}}\ndevices:\n" + "".join(DEVICE.format(n=n) for n in range(1, STRAPS + 1))
    started = Processes(folder, folder)
    bench = BenchProcess(folder, SILENT_DOMAIN, ros4hri=False, devices=devices).until_ready()
    try:
        found = []
        for count in (FIRST, STRAPS):
            while len(started.running) < count:
                n = len(started.running) + 1
                env = {"DBUS_SYSTEM_BUS_ADDRESS": bench.address, "ROS_DOMAIN_ID": str(SILENT_DOMAIN)}
                env |= {"METRICS_PORT": "", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
                told = {"sensor_id": f"h10_{n}", "human_id": "p1", "model": "H10", "name": f"1A2B3C0{n}"}
                started.start("driver_polar", env=env, **told)
            for process in started.running:
                poll(lambda process=process: process.get("/readyz")[0] == 200, process.log, STREAMS_S)
            time.sleep(LOOKS * LOOK_S)
            found.append([own_and_proportional_mib(process.child.pid) for process in started.running])
        return found[0], found[1]
    finally:
        started.close()
        bench.end()


if __name__ == "__main__":
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    for item in rows():
        print(f"| {item['what']} | {item['target']} | {item['measured']} | {item['ok']} |")
