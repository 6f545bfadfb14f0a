"""What a killed recorder loses, what a terminated one loses, and how much it takes in without loss.

    .venv/bin/python tests/bench/bench_recorder.py

Real processes on a ROS domain of their own, the publisher in one of its own. Several recorders hear the same publisher;
each is killed at a random moment. Lost is the time from the sending of the first message that is not in the repaired
file to the kill; what the CPU does is given for each process apart.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
os.environ.setdefault("ROS_DOMAIN_ID", str(random.Random(os.getpid()).randint(90, 101)))

from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from recorder.recover import recover
from rosbags.highlevel import AnyReader
from sense4hri.cdr import stamps_ns
from steady_publisher import message_bytes

Row = dict[str, Any]
BENCH = Path(__file__).resolve().parent
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
ENV = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}


class Load(NamedTuple):
    """A steady stream. together: how many recorders of it this machine bears at once."""

    what: str
    rate_hz: float
    size: int
    together: int = 1


CRASHES = [Load("1.5 kB/s", 25.0, 60, 5), Load("20 kB/s", 100.0, 200, 5), Load("2000 kB/s", 200.0, 10_000, 3)]
SMALL, LARGE = Load("small", 4400.0, 588), Load("large", 330.0, 100_000)
TRIALS, SUSTAINED_S = 50, 10.0


class Publisher:
    """The process of the publisher, on a fresh topic that nobody killed seems to listen to still."""

    count = 0

    def __init__(self, folder: Path, load: Load) -> None:
        Publisher.count += 1
        self.topic = f"/humans/physiological/p1/eeg/bench_{Publisher.count}/raw"
        self._file = folder / f"sent_{Publisher.count}"
        words = [self.topic, load.rate_hz, load.size, load.together, self._file]
        self.process = subprocess.Popen(
            [sys.executable, str(BENCH / "steady_publisher.py"), *map(str, words)], env=ENV, stdout=subprocess.PIPE
        )

    def wait_begun(self) -> None:
        """Return once all subscribers are there."""
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == b"begun\n"

    def stop(self) -> NDArray[np.int64]:
        """Times of sending of all messages, in ns."""
        self.process.terminate()
        self.process.wait(20)
        return np.frombuffer(self._file.read_bytes(), np.int64)


def start_recorder(root: Path, log: Path) -> "subprocess.Popen[bytes]":
    """A recorder as in a study, which makes no reports."""
    words = [f"directory:={root}", "reports:=false", "free_floor_mb:=0"]
    arguments = [word for parameter in words for word in ("-p", parameter)]
    with log.open("wb") as out:
        return subprocess.Popen([sys.executable, "-m", "recorder", "--ros-args", *arguments], env=ENV, stderr=out)


def numbers_in(root: Path, topic: str) -> list[int]:
    """The numbers of the messages in the only recording, in their order. Raises ValueError where it is not readable."""
    folder = root / (root / "recording").read_text().strip()
    with AnyReader([folder]) as reader:
        return [stamps_ns(bytes(raw))[1] for c, _, raw in reader.messages() if c.topic == topic]


def crashes(load: Load, trials: int, folder: Path) -> Row:
    """Kill so many recorders; how much is missing of each."""
    chance = random.Random(load.size)
    lost_s: list[float] = []
    readable = holes = 0
    while len(lost_s) < trials:
        number = min(load.together, trials - len(lost_s))
        roots = [folder / f"{load.size}_{len(lost_s) + i}" for i in range(number)]
        publisher = Publisher(folder, load._replace(together=number))
        processes = [start_recorder(root, root.with_suffix(".log")) for root in roots]
        killed_ns = [0] * number
        try:
            publisher.wait_begun()
            begun = time.monotonic()
            for due, i in sorted((chance.uniform(1.0, 3.0), i) for i in range(number)):
                time.sleep(max(0.0, begun + due - time.monotonic()))
                killed_ns[i] = time.time_ns()
                processes[i].kill()
        finally:
            for process in processes:
                process.kill()
                process.wait()
            sent_ns = publisher.stop()
        for root, at_ns in zip(roots, killed_ns, strict=True):
            recover(root / (root / "recording").read_text().strip())
            found = numbers_in(root, publisher.topic)
            readable += bool(found)
            holes += found != list(range(found[0], found[0] + len(found)))
            lost_s.append(max(0.0, (at_ns - int(sent_ns[min(found[-1] + 1, len(sent_ns) - 1)])) / 1e9))
    return {
        "what": f"recorder, SIGKILL at a random moment, {load.what}, {trials} times: lost at most",
        "target": f"<= 0.3 s, {trials} readable after repair",
        "measured": f"{max(lost_s):.2f} s (median {np.median(lost_s):.2f} s), {readable} readable, {holes} with a hole",
        "ok": max(lost_s) <= 0.3 and readable == trials and holes == 0,
    }


def terminated(folder: Path) -> Row:
    """SIGTERM while messages come: what was sent before must be in the file."""
    load, root = Load("200 kB/s", 1000.0, 200), folder / "terminated"
    publisher, process = Publisher(folder, load), start_recorder(root, folder / "terminated.log")
    publisher.wait_begun()
    time.sleep(3.0)
    stopped_ns = time.time_ns()
    process.terminate()
    process.wait(15)
    before = int(np.count_nonzero(publisher.stop() < stopped_ns))
    missing = before - len(set(numbers_in(root, publisher.topic)) & set(range(before)))
    return {
        "what": f"recorder, SIGTERM at {load.rate_hz:.0f} messages/s: lost of those sent before",
        "target": "0",
        "measured": f"{missing} of {before}",
        "ok": missing == 0,
    }


def sustained(load: Load, floor: str, folder: Path) -> list[Row]:
    """Record a stream that is faster than it has to be; beside it what is the least that any recorder must do."""
    root = folder / load.what
    publisher, process = Publisher(folder, load), start_recorder(root, folder / f"{load.what}.log")
    publisher.wait_begun()
    pids = process.pid, publisher.process.pid
    before = [_cpu_s(pid) for pid in pids]
    time.sleep(SUSTAINED_S)
    cpu = [100 * (_cpu_s(pid) - was) / SUSTAINED_S for pid, was in zip(pids, before, strict=True)]
    sent = len(publisher.stop())
    process.terminate()
    process.wait(15)
    found = set(numbers_in(root, publisher.topic))
    came, bare_cpu = _bare(folder, load)
    alone = _writer_alone(load)
    unit = (lambda hz: f"{hz:.0f} messages/s") if load is SMALL else (lambda hz: f"{hz * load.size / 1e6:.0f} MB/s")
    reached = min(sent / SUSTAINED_S, load.rate_hz)
    needed = 4000.0 if load is SMALL else 300.0
    return [
        {
            "what": f"recorder, sustained, {load.size} B messages",
            "target": f">= {floor}, 0 lost",
            "measured": f"{unit(reached)}, {sent - len(found)} of {sent} lost; "
            f"{cpu[0]:.0f} % of a core, the publisher {cpu[1]:.0f} %",
            "ok": sent == len(found) and reached >= needed,
        },
        {
            "what": f"the same stream into a bare raw subscription (rclpy); the mcap writer alone, {load.size} B, zstd",
            "target": "",
            "measured": f"{came:.1%} came, {bare_cpu:.0f} % of a core; {unit(alone)}",
            "ok": None,
        },
    ]


def _bare(folder: Path, load: Load) -> tuple[float, float]:
    """Share of the messages that come, and CPU in % of a core, where they are counted and dropped."""
    publisher = Publisher(folder, load)
    code = (
        "import sys, rclpy\nfrom rclpy.qos import QoSProfile\nfrom sense4hri_msgs.msg import PhysioRaw\n"
        "rclpy.init(); node = rclpy.create_node('bare'); n = [0]\n"
        "def take(data):\n n[0] += 1\n"
        "node.create_subscription(PhysioRaw, sys.argv[1], take, QoSProfile(depth=5000), raw=True)\n"
        "try: rclpy.spin(node)\nexcept BaseException: pass\nprint(n[0])\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, publisher.topic], env=ENV, stdout=subprocess.PIPE)
    publisher.wait_begun()
    before = _cpu_s(process.pid)
    time.sleep(SUSTAINED_S)
    cpu = 100 * (_cpu_s(process.pid) - before) / SUSTAINED_S
    sent = len(publisher.stop())
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=15)
    return int(output or 0) / sent, cpu


def _writer_alone(load: Load) -> float:
    """Messages per second of the writer that everybody's recorder is made of, into memory."""
    variants = [bytes(data) for data in message_bytes(load.size)]
    writer = Writer(BytesIO(), compression=CompressionType.ZSTD)
    writer.start()
    channel = writer.register_channel("/x", "cdr", writer.register_schema("x", "ros2msg", b""))
    count = 40_000_000 // load.size
    begun = time.perf_counter()
    for i in range(count):
        writer.add_message(channel, i, variants[i % len(variants)], i, i)
    writer.finish()
    return count / (time.perf_counter() - begun)


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def rows(trials: int = TRIALS) -> list[Row]:
    """Measure."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        measured = sustained(SMALL, "4000 messages/s", folder) + sustained(LARGE, "30 MB/s", folder)
        measured.append(terminated(folder))
        return measured + [crashes(load, trials, folder) for load in CRASHES]


if __name__ == "__main__":
    print("| what | target | measured | |\n|---|---|---|---|")
    for row in rows(int(sys.argv[1]) if len(sys.argv) > 1 else TRIALS):
        print(f"| {row['what']} | {row['target']} | {row['measured']} | {row['ok']} |")
