"""What sensor_bench itself costs, and how truthfully it keeps time, with four devices sending everything they have."""

import asyncio
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from bleak import BleakClient, BleakScanner
from bleak.backends.device import BLEDevice

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from sensor_bench_process import SILENT_DOMAIN, BenchProcess

CONTROL, DATA = "fb005c81-02e7-f387-1cad-8acd2d8df0c8", "fb005c82-02e7-f387-1cad-8acd2d8df0c8"
H10_STARTS = ("02 00 00 01 82 00 01 01 0e 00", "02 02 00 01 c8 00 01 01 10 00 02 01 08 00")
VERITY_STARTS = (
    "02 01 00 01 37 00 01 01 16 00 04 01 04",
    "02 02 00 01 34 00 01 01 10 00 02 01 08 00 04 01 03",
    "02 03",
)
MEASURED_S = 30.0


def cpu_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rss_mib(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


async def stream(
    device: BLEDevice, starts: tuple[str, ...], frames: list[tuple[int, int]], ends: asyncio.Event
) -> None:
    """Start everything on one device and note (device ns, arrival ns) of every frame until told to end."""
    async with BleakClient(device) as client:
        await client.start_notify(CONTROL, lambda _, value: None)
        await client.start_notify(
            DATA, lambda _, value: frames.append((int.from_bytes(value[1:9], "little"), time.time_ns()))
        )
        await client.start_notify("2a37", lambda _, value: None)
        for start in starts:
            await client.write_gatt_char(CONTROL, bytes.fromhex(start), response=True)
        await ends.wait()


async def measure(bench: BenchProcess) -> dict[str, Any]:
    ends = asyncio.Event()
    devices = bench.read("/devices")
    frames: dict[str, list[tuple[int, int]]] = {device["sensor"]: [] for device in devices}
    for device in devices:
        bench.knobs(device["sensor"], latency_s=0.0, jitter_s=0.0)
    # one scan for all: a client may have one discovery session only
    seen = await BleakScanner.discover(timeout=2.0, return_adv=True)
    tasks = [
        asyncio.ensure_future(
            stream(
                seen[d["address"]][0],
                H10_STARTS if d["model"] == "H10" else VERITY_STARTS,
                frames[d["sensor"]],
                ends,
            )
        )
        for d in devices
    ]
    while not all(frames.values()):
        done, _ = await asyncio.wait(tasks, timeout=0.1)
        for task in done:
            task.result()
    before = cpu_s(bench.child.pid)
    await asyncio.sleep(MEASURED_S)
    used_s = cpu_s(bench.child.pid) - before
    truth = await asyncio.to_thread(bench.read, "/truth")
    ends.set()
    await asyncio.gather(*tasks)
    delays_ms = []
    for sensor, clock in truth["devices"].items():
        stamps = np.array(frames[sensor])
        elapsed_ns = (stamps[:, 0] - clock["reference_device_ns"]) / (1 + clock["skew_ppm"] * 1e-6)
        delays_ms += ((stamps[:, 1] - clock["reference_host_ns"] - elapsed_ns) * 1e-6).tolist()
    return {
        "cpu_percent": 100 * used_s / MEASURED_S,
        "rss_mib": rss_mib(bench.child.pid),
        "frames": sum(map(len, frames.values())),
        "p50_ms": float(np.percentile(delays_ms, 50)),
        "p99_ms": float(np.percentile(delays_ms, 99)),
    }


def rows() -> list[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        begun = time.monotonic()
        bench = BenchProcess(Path(folder), SILENT_DOMAIN, ros4hri=False).until_ready()
        ready_s = time.monotonic() - begun
        os.environ["DBUS_SYSTEM_BUS_ADDRESS"] = bench.address
        try:
            seen = asyncio.run(measure(bench))
        finally:
            bench.end()
    return [
        {
            "what": "sensor-bench: CPU, 2 H10 and 2 Verity Sense sending everything",
            "target": "<= 50 % of a core",
            "measured": f"{seen['cpu_percent']:.1f} %",
            "ok": seen["cpu_percent"] <= 50,
        },
        {"what": "sensor-bench: memory", "target": "-", "measured": f"{seen['rss_mib']:.0f} MiB", "ok": None},
        {"what": "sensor-bench: start to ready", "target": "-", "measured": f"{ready_s:.1f} s", "ok": None},
        {
            "what": "sensor-bench: sample taken -> bleak callback, link delay 0",
            "target": "-",
            "measured": f"p50 {seen['p50_ms']:.1f} ms, p99 {seen['p99_ms']:.1f} ms, {seen['frames']} frames",
            "ok": None,
        },
    ]


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} | {row['ok']} |")
