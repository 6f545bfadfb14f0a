"""CPU that a driver's streams take per 1000 raw messages, from samples to the middleware, by a driver's own outlet.

    .venv/bin/python tests/bench/run.py publishing        # a second or two of CPU

CPU of the process, its threads of DDS included; nobody listens, so what each listener adds is not in it.
"""

import asyncio
import os
import random
import time
from types import SimpleNamespace
from typing import Any

import numpy as np

os.environ.setdefault("ROS_DOMAIN_ID", str(random.randint(90, 101)))
import rclpy
from sense4hri.chunk import Chunk
from sense4hri.device import Samples, Stream
from sense4hri.outlet import Outlets
from sense4hri.service import Service

MESSAGES, FIRST = 2000, 100
START_NS = 1_700_000_000_000_000_000
SHAPES = {
    "100 samples of 1 channel, no device time": (1000.0, 100, 1, False),
    "10 samples of 3 channels, each with its device time": (100.0, 10, 3, True),
    "1 sample of 3 channels, irregular": (0.0, 1, 3, False),
}
"""What a BITalino, a Shimmer's accelerometer, and the gaze of a Pupil Core with two eyes publish."""


def cpu_ms(service: Service[Any], number: int, rate_hz: float, samples: int, channels: int, timed: bool) -> float:
    """Return ms of CPU per 1000 messages of one stream."""
    names = tuple("xyz"[:channels])
    stream = Stream(rate_hz, "m/s^2", -1000.0, 1000.0, 16, names)
    outlets = Outlets(service, f"bench_{number}", "p1")
    outlets.declare({"accelerometer": stream})
    outlet, values = outlets.of("accelerometer"), np.random.default_rng(1).normal(size=(samples, channels))
    period_ns = round(1e9 / (rate_hz or 200.0))
    begun_s = 0.0
    for message in range(FIRST + MESSAGES):
        if message == FIRST:
            begun_s = time.process_time()
        times_ns = (message * samples + np.arange(samples)) * period_ns
        device_ns = int(times_ns[-1]) + period_ns
        chunk = Chunk(names, values, device_ns if timed or not rate_hz else None, START_NS + device_ns)
        outlet.publish(Samples("accelerometer", chunk, times_ns + period_ns if timed else None))
    return (time.process_time() - begun_s) * 1e6 / MESSAGES


def rows() -> list[dict[str, Any]]:
    """One row for each shape of a message."""
    rclpy.init()
    node = rclpy.create_node("bench_publishing")
    loop = asyncio.new_event_loop()
    service = Service("bench_publishing", node, SimpleNamespace(asks_rates=False), loop)
    try:
        measured = {what: cpu_ms(service, number, *shape) for number, (what, shape) in enumerate(SHAPES.items())}
    finally:
        service.close()
        node.destroy_node()
        rclpy.shutdown()
        loop.close()
    return [
        {"what": f"1000 messages of {what}: CPU", "target": "none set", "measured": f"{ms:.0f} ms", "ok": None}
        for what, ms in measured.items()
    ]


if __name__ == "__main__":
    for row in rows():
        print(row["what"], "|", row["target"], "|", row["measured"], "|", row["ok"])
