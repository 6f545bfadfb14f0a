"""Cost of decoding what Polar sensors send.

    .venv/bin/python tests/bench/bench_driver_polar.py

Frames are made here: the fullest an H10 and a Verity Sense send, and one of many small blocks.
"""

import struct
import time
from typing import Any

import numpy as np
from driver_polar import protocol

Row = dict[str, Any]
REPEATS, ROUNDS = 300, 7


def frame(measurement: int, frame_type: int, content: bytes) -> bytes:
    """Return a whole notification."""
    return struct.pack("<BQB", measurement, 10**17, frame_type) + content


def delta_content(channels: int, size: int, width: int, per_block: int, room: int = 219) -> bytes:
    """Return a compressed content of random differences that fills a notification."""
    random = np.random.default_rng(1)
    content = random.bytes(channels * size)
    block = -(-width * per_block * channels // 8)
    while len(content) + 2 + block <= room:
        content += bytes([width, per_block]) + random.bytes(block)
    return content


def frames() -> dict[str, tuple[bytes, float]]:
    """Return each frame and how many of them come in a second."""
    random = np.random.default_rng(1)
    return {
        "H10 ECG, 73 samples": (frame(0, 0, random.bytes(219)), 130 / 73),
        "H10 acceleration at 200 Hz, 36 samples": (frame(2, 1, random.bytes(216)), 200 / 36),
        "Verity Sense PPG, one block of 10 bits": (frame(1, 0x80, delta_content(4, 3, 10, 40)), 55 / 41),
        "Verity Sense acceleration at 416 Hz, one block of 7 bits": (
            frame(2, 0x80, delta_content(3, 2, 7, 75)),
            416 / 76,
        ),
        "nine blocks of 3 bits": (frame(2, 0x81, delta_content(3, 2, 3, 17)), 52 / 154),
    }


def microseconds(data: bytes) -> float:
    """Return the best of several mean times to decode one frame."""
    best = np.inf
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        for _ in range(REPEATS):
            protocol.decode(protocol.parse(data), 2.44e-4)
        best = min(best, (time.perf_counter() - begun) / REPEATS * 1e6)
    return best


def rows() -> list[Row]:
    """Return one row per kind of frame."""
    result = []
    for what, (data, per_second) in frames().items():
        took_us = microseconds(data)
        share = took_us * 1e-6 * per_second * 100
        result.append(
            {
                "what": f"decode {what}",
                "target": "<= 0.1 % of a core per stream",
                "measured": f"{took_us:.0f} us per frame, {share:.3f} % of a core",
                "ok": share <= 0.1,
            }
        )
    return result


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} | {'yes' if row['ok'] else 'NO'} |")
