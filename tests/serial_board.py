"""A board on a serial line for the tests of its driver: its forms, its bytes, and what the driver makes of them."""

from pathlib import Path
from typing import Any

import numpy as np
from driver_serial.description import parse
from driver_serial.device import Clock, Decoder
from sense4hri.arrivals import Arrival
from sense4hri.device import Item, Samples
from sense4hri.stamps import SECOND_NS
from sensor_bench.board.firmware import Sketch
from sensor_bench.wired import Frames as Air

BEGUN_NS = 1_800_000_000 * SECOND_NS
STUDY = Path(__file__).parents[1] / "compose" / "studies" / "serial" / "board.yaml"
STREAMS = """
streams:
  eda: {rate_hz: 50, unit: uS, range: [0, 100], bits: 14, channels: {eda: {field: gsr, scale: 0.01}}}
  ppg: {rate_hz: 50, unit: counts, range: [0, 1023], bits: 10, channels: {finger: {field: ppg}}}
"""
BINARY = "fields: [t u32, n u8, gsr u16, belt u16, ppg u16]\nchecksum: sum8\n"
FORMS = {
    "csv": "format: csv\nfields: [t, n, gsr, belt, ppg]\n",
    "pairs": "format: pairs\nchecksum: xor8\n",
    "json": "format: json\n",
    "struct": f"format: struct\nbegins: a5 5a\n{BINARY}",
    "cobs": f"format: cobs\n{BINARY}",
}
TIME, COUNTER = "time: {field: t, unit: ms, bits: 32}\n", "counter: {field: n, bits: 8}\n"


def numbers(first: int, count: int, fs_hz: float) -> np.ndarray:
    """A measure that is the number of the sample, so that none can be taken for another."""
    return (np.arange(first, first + count) % 1000) / 100


def sketch(form: str, air: Air | None = None, **how: Any) -> Sketch:
    measures = {"eda": numbers, "breath": numbers, "pulse": numbers}
    return Sketch(measures, air or Air(1), 0.0, form=form, waits=False, **how)


class Host:
    """A clock of the host that a test turns."""

    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


def played(text: str, chunks: list[tuple[float, bytes]]) -> list[Item]:
    """What the driver makes of bytes that came at these seconds, after which the board is gone."""
    described, host, items = parse(text), Host(), []
    decoder = Decoder(described, Clock(described.time, host) if described.time else None)
    for at_s, octets in chunks:
        host.now_ns = round(at_s * SECOND_NS)
        items += decoder.items(Arrival(BEGUN_NS + host.now_ns, octets))
    return [*items, *decoder.rest()]


def pieces(device: Sketch, seconds: float, random: np.random.Generator) -> list[tuple[float, bytes]]:
    """What a board sends, cut anywhere."""
    octets = np.frombuffer(device.send(seconds), np.uint8)
    cuts = np.sort(random.integers(0, len(octets), 300))
    parts = np.split(octets, cuts)
    return [((i + 1) / len(parts) * seconds, part.tobytes()) for i, part in enumerate(parts)]


def of(items: list[Item], sensor_type: str) -> list[Samples]:
    return [item for item in items if isinstance(item, Samples) and item.sensor_type == sensor_type]
