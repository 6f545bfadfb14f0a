"""Chunk <-> message. `array.array` fills a message 90 times faster than an ndarray does."""

from array import array

import numpy as np
from sense4hri_msgs.msg import Marker as MarkerMessage
from sense4hri_msgs.msg import PhysioFeature

from sense4hri.cdr import RawMessage, read_raw, write_raw
from sense4hri.chunk import Chunk
from sense4hri.errors import FrameError
from sense4hri.intake import LARGEST, LONGEST_NAME
from sense4hri.stamps import to_ns
from sense4hri.step import Marker


def doubles(values: object) -> "array[float]":
    """Return numbers as the array a float64[] field takes fastest."""
    return array("d", np.ascontiguousarray(values, np.float64).tobytes())


def octets_of(chunk: Chunk, frame_id: str) -> bytes:
    """Return a chunk as the serialised message for `raw`; both stamps belong to the last sample.

    Written straight as bytes: filling a message and having it serialised costs several times as much
    (`tests/bench/bench_publishing.py`).
    """
    return write_raw(frame_id, RawMessage(chunk.received_ns, chunk.device_ns or 0, chunk.channels, chunk.samples))


def chunk_of(message: bytes) -> Chunk:
    """Return a serialised `raw` message as a chunk: read from its bytes, which costs a tenth of what its class does.

    Raises FrameError where it is none, its channels are absent, empty or of unequal length, or a name or a number is
    impossible.
    """
    try:
        told = read_raw(message)
    except ValueError as err:
        raise FrameError(str(err)) from err
    if np.any(np.abs(told.samples) > LARGEST):
        raise FrameError(f"a raw message with a number beyond {LARGEST:g}")
    longest = max(map(len, told.channels))
    if longest > LONGEST_NAME:
        raise FrameError(f"a raw message with a channel name of {longest} characters, at most {LONGEST_NAME} can be")
    return Chunk(told.channels, np.ascontiguousarray(told.samples), told.device_ns or None, told.received_ns)


def marker_of(message: MarkerMessage) -> Marker:
    """Return a message of `/study/markers` as a plain tuple."""
    return Marker(
        to_ns(message.header.stamp),
        to_ns(message.device_timestamp) or None,
        message.uncertainty_s,
        message.session_id,
        message.human_id,
        message.name,
        message.value,
        message.source,
    )


def feature(name: str, unit: str, values: object) -> PhysioFeature:
    """Return one named value or list of values."""
    return PhysioFeature(name=name, unit=unit, values=doubles(np.atleast_1d(np.asarray(values, np.float64))))
