"""Outlets on the network, through liblsl; the only place that imports it."""

from typing import Any

import numpy as np
import pylsl
from numpy.typing import NDArray
from pylsl.lib import lib
from sense4hri import lsl
from sense4hri.plain_text import plain
from sense4hri.stamps import SECOND_NS

from bridge_lsl.described import Outlet

BUFFER_S = 60
WALL_INTERVAL_S = 0.5


def configure(session: str) -> None:
    """Tell liblsl of the session, before anything else."""
    if text := lsl.settings((), session):
        lib.lsl_set_config_content(text.encode())


def stream_info(outlet: Outlet) -> pylsl.StreamInfo:
    """Return what liblsl sends of an outlet: XML, which knows no control characters."""
    info = pylsl.StreamInfo(
        outlet.name, outlet.content_type, len(outlet.channels), outlet.rate_hz, outlet.form, outlet.source_id
    )
    description = info.desc()
    for tag, text in outlet.about.items():
        description.append_child_value(tag, plain(text))
    channels = description.append_child("channels")
    for parts in outlet.channels:
        channel = channels.append_child("channel")
        for tag, text in zip(("label", "unit", "type"), parts, strict=True):
            channel.append_child_value(tag, plain(text))
    return info


class Offered:
    """One outlet; it is gone from the network once nobody holds it."""

    def __init__(self, outlet: Outlet) -> None:
        self._outlet = pylsl.StreamOutlet(stream_info(outlet), max_buffered=BUFFER_S)

    def push(self, rows: "NDArray[np.float64] | list[Any]", wall_ns: NDArray[np.int64]) -> None:
        """Send samples, shape (n, channels), or rows, taken at these times of the wall clock, shape (n,)."""
        self._outlet.push_chunk(rows, Wall.lsl_s(wall_ns).tolist())


class Wall:
    """The wall clock on LSL's: read again from time to time, because one of the two is slewed or stepped."""

    _offset_ns, _read_at_s = 0, -1.0

    @classmethod
    def lsl_s(cls, wall_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return times of the wall clock as LSL's stamps, in s."""
        now_s = pylsl.local_clock()
        if cls._read_at_s < 0 or now_s - cls._read_at_s > WALL_INTERVAL_S:
            cls._offset_ns, cls._read_at_s = lsl.wall(pylsl.local_clock).offset_ns, now_s
        return np.asarray((wall_ns - cls._offset_ns) / SECOND_NS, np.float64)
