"""What a killed recorder loses at 20 kB/s, what a terminated one loses, and what recording costs.

    .venv/bin/python tests/bench/bench_recorder.py

Real processes on a ROS domain of their own. Lost is the time from the last message in the file to the kill, found by
reading the unfinished file record by record.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
os.environ.setdefault("ROS_DOMAIN_ID", str(random.Random(os.getpid()).randint(60, 100)))

import rclpy
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from sense4hri import qos, stamps
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

Row = dict[str, Any]
RATE_HZ, BYTES_PER_S = 100.0, 20_000


class Source(threading.Thread):
    """Publishes numbered messages at a steady rate; remembers when each was sent."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("bench_source", context=self.context)
        self.topic, self.publisher = "", self.node.create_publisher(PhysioRaw, "/bench/unused", qos.RAW)
        self._topics = 0
        self.sent_ns: list[int] = []
        self.running = threading.Event()
        self.done = threading.Event()
        self._message = PhysioRaw(channels=[PhysioRawChannel(channel_name="a", samples=np.zeros(self._samples()))])

    def begin(self) -> None:
        """A fresh topic, which no killed recorder seems to listen to still."""
        self._topics += 1
        self.topic = f"/humans/physiological/p1/eeg/bench_{self._topics}/raw"
        self.publisher = self.node.create_publisher(PhysioRaw, self.topic, qos.RAW)
        self.sent_ns = []

    @staticmethod
    def _samples() -> int:
        return int((BYTES_PER_S / RATE_HZ - 60) / 8)

    def run(self) -> None:
        due = time.monotonic()
        while not self.done.is_set():
            due += 1 / RATE_HZ
            time.sleep(max(0.0, due - time.monotonic()))
            if self.running.is_set():
                stamps.set_time(self._message.device_timestamp, len(self.sent_ns))
                self.publisher.publish(self._message)
                self.sent_ns.append(time.time_ns())

    def close(self) -> None:
        self.done.set()
        self.join()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def numbers_in(folder: Path, topic: str) -> list[int]:
    """The numbers of the messages on disk, of an unfinished file too."""
    from clock_sync.cdr import stamps_ns

    found, channel = [], -1
    with next(folder.glob("*.mcap")).open("rb") as file:
        records = StreamReader(file).records
        while True:
            try:
                record = next(records)
            except (StopIteration, McapError, EOFError, OSError):
                return found
            if isinstance(record, Channel) and record.topic == topic:
                channel = record.id
            elif isinstance(record, Message) and record.channel_id == channel:
                found.append(stamps_ns(record.data)[1])


def record(
    parent: Path, source: Source, number: signal.Signals, after_s: float
) -> tuple[list[int], list[int], int, float]:
    """Record for a while, then send the signal: numbers in the file, times sent, time of the signal, CPU per s."""
    command = [sys.executable, "-m", "recorder", "--ros-args", "-p", f"directory:={parent}"]
    environment = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}
    source.begin()
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 30
        while source.publisher.get_subscription_count() < 1 and time.monotonic() < deadline:
            time.sleep(0.02)
        source.running.set()
        ticks = _cpu_s(process.pid)
        time.sleep(after_s)
        cpu = (_cpu_s(process.pid) - ticks) / after_s
        signalled_ns = time.time_ns()
        process.send_signal(number)
        if number == signal.SIGTERM:
            source.running.clear()
    finally:
        if number != signal.SIGTERM:
            process.kill()
        process.wait(20)
    time.sleep(0.1)
    source.running.clear()
    folder = parent / (parent / "recording").read_text().strip()
    return numbers_in(folder, source.topic), list(source.sent_ns), signalled_ns, cpu


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rows(kills: int = 8) -> list[Row]:
    """Measure."""
    chance = random.Random(1)
    lost_s, holes, cpu = [], 0, []
    source = Source()
    source.start()
    try:
        with tempfile.TemporaryDirectory() as folder:
            for _ in range(kills):
                found, sent, killed_ns, used = record(Path(folder), source, signal.SIGKILL, chance.uniform(3.0, 5.0))
                last = found[-1] if found else 0
                holes += len(set(range(last + 1)) - set(found))
                lost_s.append((killed_ns - sent[last]) / 1e9)
                cpu.append(used)
            found, sent, stopped_ns, _ = record(Path(folder), source, signal.SIGTERM, 4.0)
            before = sum(at <= stopped_ns for at in sent)
            missing = before - len(set(found) & set(range(before)))
    finally:
        source.close()
    return [
        {
            "what": f"recorder, SIGKILL at a random moment, 20 kB/s, {kills} times: lost at most",
            "target": "<= 0.3 s",
            "measured": f"{max(lost_s):.2f} s (median {np.median(lost_s):.2f} s), {holes} holes before it",
            "ok": max(lost_s) <= 0.3 and holes == 0,
        },
        {
            "what": "recorder, SIGTERM: messages lost",
            "target": "0",
            "measured": f"{missing} of {before}",
            "ok": missing == 0,
        },
        {
            "what": "recorder, CPU at 100 messages/s, 20 kB/s",
            "target": "",
            "measured": f"{100 * float(np.median(cpu)):.1f} % of a core",
            "ok": None,
        },
    ]


if __name__ == "__main__":
    print("| what | target | measured | |\n|---|---|---|---|")
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} | {row['ok']} |")
