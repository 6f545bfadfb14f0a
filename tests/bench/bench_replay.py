"""How fast replay plays at most, and how exactly it keeps the recorded time at 1x; heard in another process.

.venv/bin/python tests/bench/bench_replay.py
"""

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS
FRAMES = {"small, 73 samples of a chest strap": (20, 73, 40_000), "large, 30 kB": (4, 3_750, 8_000)}
"""Topics, samples in a message, messages."""
TIMED_S, TIMED_HZ = 30, 200
QOS = "- {reliability: reliable, durability: volatile, history: keep_last, depth: 200}"


class Heard(NamedTuple):
    """When messages came (monotonic clock, s), and the CPU time of replay from the first to the last, in s."""

    times_s: NDArray[np.float64]
    cpu_s: float


def rows() -> list[dict[str, Any]]:
    """Everything measured here, for `make bench`."""
    with tempfile.TemporaryDirectory() as folder:
        return [*(_fastest(Path(folder), name) for name in FRAMES), _timing(Path(folder))]


def _fastest(folder: Path, name: str) -> dict[str, Any]:
    topics, samples, count = FRAMES[name]
    bag = folder / f"{samples}.mcap"
    size = _write(bag, topics, samples, count, 1_000)
    heard = _heard(bag, topics, count, rate=0.0, most_per_s=0.0)
    took_s = heard.times_s[-1] - heard.times_s[0]
    rate = f"{(count - 1) / took_s:.0f} msg/s, {count * size / took_s / 1e6:.1f} MB/s"
    measured = f"{rate}, {len(heard.times_s)} of {count} heard, {1e6 * heard.cpu_s / count:.0f} us CPU each"
    what = f"replay as fast as a subscriber keeps up, {name}"
    return {"what": what, "target": "none lost", "measured": measured, "ok": len(heard.times_s) == count}


def _timing(folder: Path) -> dict[str, Any]:
    bag, count = folder / "timed.mcap", TIMED_S * TIMED_HZ
    _write(bag, 4, 73, count, TIMED_HZ)
    heard = _heard(bag, 4, count, rate=1.0)
    error_ms = 1000 * (heard.times_s - heard.times_s[0] - np.arange(len(heard.times_s)) / TIMED_HZ)
    off_ms = np.abs(error_ms - np.median(error_ms))
    drift_ms = float(np.median(error_ms[-TIMED_HZ:]) - np.median(error_ms[:TIMED_HZ]))
    p50, p95, p99 = np.percentile(off_ms, [50, 95, 99])
    measured = f"p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.2f}, max {off_ms.max():.1f} ms; drift {drift_ms:+.2f} ms"
    what = f"replay at 1x, {TIMED_HZ} msg/s for {TIMED_S} s: time of receipt against log time"
    measured += f"; {len(off_ms)} of {count} heard"
    return {"what": what, "target": "none lost", "measured": measured, "ok": len(off_ms) == count}


def _write(path: Path, topics: int, samples: int, count: int, per_s: int) -> int:
    """Write messages of many topics in turn; return the bytes of one."""
    from rclpy.serialization import serialize_message
    from recorder.schemas import definition
    from sense4hri.stamps import from_ns
    from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

    kind = "sense4hri_msgs/msg/PhysioRaw"
    message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=[1.5] * samples)])
    message.header.stamp = from_ns(START_NS)
    data = serialize_message(message)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", definition(kind).encode())
        channels = [
            writer.register_channel(_topic(n), "cdr", schema, {"offered_qos_profiles": QOS}) for n in range(topics)
        ]
        for i in range(count):
            at_ns = START_NS + i * SECOND_NS // per_s
            writer.add_message(channels[i % topics], at_ns, data, at_ns)
        writer.finish()
    return len(data)


def _topic(number: int) -> str:
    return f"/humans/physiological/p1/ecg/bench_{number}/raw"


def _heard(bag: Path, topics: int, count: int, **parameters: float) -> Heard:
    """Play it to a node of this process, which takes the bytes and the time."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from sense4hri import qos
    from sense4hri_msgs.msg import PhysioRaw

    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    context = rclpy.Context()
    domain = int(os.environ.get("ROS_DOMAIN_ID") or random.randint(90, 101))
    rclpy.init(context=context, domain_id=domain)
    node, executor = rclpy.create_node("bench", context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    times_s: list[float] = []
    for number in range(topics):
        profile = qos.deep(qos.RAW)
        node.create_subscription(
            PhysioRaw, _topic(number), lambda data: times_s.append(time.monotonic()), profile, raw=True
        )
    given = {"bag": f"'{bag}'", "linger_s": 0.0, **parameters}
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    env = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"} | {"ROS_DOMAIN_ID": str(domain)}
    command = [sys.executable, "-m", "replay", "--ros-args", *words]
    process = subprocess.Popen(command, env=env, stderr=subprocess.DEVNULL)
    cpu_s: list[float] = []
    try:
        while process.poll() is None:
            executor.spin_once(timeout_sec=0.1)
            if len(cpu_s) < len(times_s[:1]) + len(times_s[count - 1 :]):
                cpu_s.append(_cpu_s(process.pid))
        for _ in range(20):
            executor.spin_once(timeout_sec=0.01)
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait(10)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    return Heard(np.array(times_s), cpu_s[-1] - cpu_s[0])


def _cpu_s(pid: int) -> float:
    """CPU time a process has used so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} |")
