"""What an interpreter costs as a running process: latency of an update on busy cores, CPU per further participant.

    .venv/bin/python tests/bench/bench_interpreter.py

Starts interpreter-ecg on a private ROS domain and feeds it as drivers do. Latency is from publishing the raw message
that completes an update to the features' arrival here, beside an echo by a bare rclpy node in the same run; the
difference is what the interpreter adds. All cores are kept busy meanwhile.
"""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Row = dict[str, Any]

FS_HZ, FRAME = 130.0, 73
FULL_S = 310.0  # of signal until the variability window is full
CORES = 2
ECHO = "/humans/physiological/p1/ppg/echo_1/raw"
TICK_S = 0.05


def ecg(seconds: float) -> Floats:
    """A resting person, shape (n,), uV."""
    rng = np.random.default_rng(1)
    n = round(seconds * FS_HZ)
    t_s = np.arange(n) / FS_HZ
    beats = 0.5 + np.cumsum(
        0.85 + 0.05 * np.sin(np.arange(int(2 * seconds)) * 1.3) + rng.normal(0, 0.01, int(2 * seconds))
    )
    samples = rng.normal(0, 10, n)
    for beat in beats[beats < seconds]:
        near = np.abs(t_s - beat) < 0.5
        phase = t_s[near] - beat
        samples[near] += 1000 * np.exp(-0.5 * (phase / 0.012) ** 2) + 250 * np.exp(-0.5 * ((phase - 0.28) / 0.05) ** 2)
    return samples


class Straps:
    """Virtual straps of several participants in one node, and what comes back."""

    def __init__(self, count: int) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from sense4hri import qos
        from sense4hri_msgs.msg import ECG, PhysioRaw

        self.node = rclpy.create_node(f"driver_bench_{count}")
        values = {"sampling_frequency_hz": FS_HZ, "unit": "uV", "channel_names": ["ecg"]}
        for name, value in values.items():
            self.node.declare_parameter(f"ecg.{name}", value)
        self.features_ms: list[float] = []
        self.echoes_ms: list[float] = []
        self.updates = 0
        self.raw = []
        for i in range(count):
            base = f"/humans/physiological/p{i + 1}/ecg/bench_{count}_{i + 1}/"
            self.raw.append(self.node.create_publisher(PhysioRaw, base + "raw", qos.RAW))
            self.node.create_subscription(ECG, base + "features", self._on_features, qos.deep(qos.FEATURES))
        self.to_echo = self.node.create_publisher(PhysioRaw, ECHO, qos.RAW)
        self.node.create_subscription(ECG, ECHO + "_back", self._on_echo, qos.deep(qos.FEATURES))
        self.samples, self.sent = ecg(FULL_S + 600), 0
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def _on_features(self, message: Any) -> None:
        self.updates += 1
        self.features_ms.append((time.time_ns() - stamp_ns(message.header.stamp)) / 1e6)

    def _on_echo(self, message: Any) -> None:
        self.echoes_ms.append((time.time_ns() - stamp_ns(message.header.stamp)) / 1e6)

    def frame(self, publishers: list[Any]) -> None:
        """Publish the next frame on all of them."""
        from sense4hri.stamps import set_time
        from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

        samples = array("d", self.samples[self.sent : self.sent + FRAME].tobytes())
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=samples)])
        set_time(message.device_timestamp, 10**15 + round((self.sent + FRAME - 1) / FS_HZ * 1e9))
        for publisher in publishers:
            set_time(message.header.stamp, time.time_ns())
            publisher.publish(message)

    def next(self) -> None:
        self.sent += FRAME

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join(5)
        self.node.destroy_node()


def stamp_ns(stamp: Any) -> int:
    """A Time message in ns."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def wait(true: Callable[[], bool], what: str, timeout_s: float = 30.0) -> None:
    """Poll until true() is; RuntimeError at the deadline."""
    deadline = time.monotonic() + timeout_s
    while not true():
        if time.monotonic() > deadline:
            raise RuntimeError(f"not within {timeout_s:.0f} s: {what}")
        time.sleep(0.02)


def echo() -> None:
    """A bare rclpy node: answers every raw message with an empty features message of the same stamp."""
    import rclpy
    from sense4hri import qos
    from sense4hri_msgs.msg import ECG, PhysioRaw

    rclpy.init()
    node = rclpy.create_node("driver_echo")
    back = node.create_publisher(ECG, ECHO + "_back", qos.FEATURES)

    def answer(message: Any) -> None:
        back.publish(ECG(header=message.header))

    node.create_subscription(PhysioRaw, ECHO, answer, qos.RAW)
    rclpy.spin(node)


def burn() -> None:
    """Keep a core busy."""
    while True:
        sum(range(10_000))


@contextmanager
def interpreter() -> Iterator[subprocess.Popen[bytes]]:
    """The service, alone on the domain."""
    process = subprocess.Popen([sys.executable, "-m", "interpreter_ecg"], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(10)


@contextmanager
def side_by_side(*targets: Callable[[], None]) -> Iterator[None]:
    """Run each in a process of its own."""
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=target, daemon=True) for target in targets]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def cpu_s(process: subprocess.Popen[bytes]) -> float:
    """CPU time that a process has used."""
    with open(f"/proc/{process.pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def prefill(straps: Straps) -> None:
    """Send signal far faster than real time until every window is full."""
    while straps.sent < FULL_S * FS_HZ:
        straps.frame(straps.raw)
        straps.next()
        expected = len(straps.raw) * (int(straps.sent / FS_HZ) - 20)
        wait(lambda expected=expected: straps.updates >= expected, "updates while filling the window", 60.0)


def latency_ms(seconds: float = 30.0) -> tuple[Floats, Floats]:
    """(round trips through the interpreter, through the bare echo) in ms on busy cores."""
    with interpreter(), side_by_side(echo, *[burn] * CORES):
        straps = Straps(1)
        try:
            wait(lambda: straps.raw[0].get_subscription_count() > 0, "the interpreter subscribes")
            wait(lambda: straps.to_echo.get_subscription_count() > 0, "the echo subscribes")
            prefill(straps)
            time.sleep(1.0)
            straps.features_ms.clear()
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                straps.frame(straps.raw)
                time.sleep(TICK_S)
                straps.frame([straps.to_echo])
                time.sleep(TICK_S)
                straps.next()
            return np.array(straps.features_ms), np.array(straps.echoes_ms)
        finally:
            straps.close()


def cpu_percent(count: int, seconds: float = 20.0) -> float:
    """CPU of the interpreter in % of a core while it serves `count` participants in real time, windows full."""
    with interpreter() as process:
        straps = Straps(count)
        try:
            wait(lambda: all(raw.get_subscription_count() > 0 for raw in straps.raw), "the interpreter subscribes")
            if count:
                prefill(straps)
            time.sleep(2.0)
            begun_s, begun = cpu_s(process), time.monotonic()
            frame, period_s = 0, FRAME / FS_HZ
            while time.monotonic() < begun + seconds:
                straps.frame(straps.raw)
                straps.next()
                frame += 1
                time.sleep(max(0.0, begun + frame * period_s - time.monotonic()))
            return 100 * (cpu_s(process) - begun_s) / (time.monotonic() - begun)
        finally:
            straps.close()


def neurokit_ms(window_s: float) -> float:
    """CPU time in ms of `neurokit2.ecg_process` over one window, as a batch library would do it every second."""
    import warnings

    import neurokit2

    samples = ecg(window_s)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        neurokit2.ecg_process(samples, sampling_rate=int(FS_HZ))
        begun = time.process_time()
        for _ in range(3):
            neurokit2.ecg_process(samples, sampling_rate=int(FS_HZ))
    return 1e3 * (time.process_time() - begun) / 3


def rows() -> list[Row]:
    """Latency and CPU against their targets."""
    import rclpy

    os.environ["ROS_DOMAIN_ID"] = str(150 + os.getpid() % 50)
    os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
    os.environ.pop("METRICS_PORT", None)
    rclpy.init()
    try:
        through, floor = latency_ms()
        idle, one, nine = (cpu_percent(count) for count in (0, 1, 9))
    finally:
        rclpy.shutdown()
    (p50, p99), (floor50, floor99) = (np.percentile(values, (50, 99)) for values in (through, floor))
    further = (nine - one) / 8
    kit10, kit300 = neurokit_ms(10.0), neurokit_ms(300.0)
    return [
        {
            "what": f"raw message completing an update -> features, {CORES} busy cores, {len(through)} updates, "
            "percentiles less those of the floor of bare rclpy",
            "target": "p50 <= 5 ms, p99 <= 25 ms",
            "measured": f"p50 {p50 - floor50:.1f}, p99 {p99 - floor99:.1f} ms "
            f"(round trip {p50:.1f} and {p99:.1f}, floor {floor50:.1f} and {floor99:.1f})",
            "ok": bool(p50 - floor50 <= 5 and p99 - floor99 <= 25),
        },
        {
            "what": "CPU of interpreter-ecg per further participant at 130 Hz",
            "target": "<= 0.5 % of a core",
            "measured": f"{further:.2f} % (one: {one:.1f} %, nine: {nine:.1f} %); neurokit2.ecg_process every second: "
            f"{kit10 / 10:.1f} % over 10 s, {kit300 / 10:.1f} % over 300 s",
            "ok": further <= 0.5,
        },
        {
            "what": "CPU of interpreter-ecg with no stream",
            "target": "< 1 % of a core",
            "measured": f"{idle:.2f} %",
            "ok": idle < 1,
        },
    ]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
