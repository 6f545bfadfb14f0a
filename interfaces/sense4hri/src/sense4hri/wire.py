"""Chunk <-> message. `array.array` fills a message 90 times faster than an ndarray does."""

from array import array

import numpy as np
from sense4hri_msgs.msg import Marker as MarkerMessage
from sense4hri_msgs.msg import PhysioFeature, PhysioRaw, PhysioRawChannel

from sense4hri.chunk import Chunk
from sense4hri.errors import FrameError
from sense4hri.stamps import set_time, to_ns
from sense4hri.step import Marker


def doubles(values: object) -> "array[float]":
    """Return numbers as the array a float64[] field takes fastest."""
    return array("d", np.ascontiguousarray(values, np.float64).tobytes())


def raw_message(chunk: Chunk, frame_id: str) -> PhysioRaw:
    """Return a chunk as the message for `raw`; both stamps belong to the last sample."""
    message = PhysioRaw()
    message.header.frame_id = frame_id
    set_time(message.header.stamp, chunk.received_ns)
    set_time(message.device_timestamp, chunk.device_ns)
    message.channels = [
        PhysioRawChannel(channel_name=name, samples=doubles(chunk.samples[:, i]))
        for i, name in enumerate(chunk.channels)
    ]
    return message


def chunk_of(message: PhysioRaw) -> Chunk:
    """Return a `raw` message as a chunk.

    Raises FrameError where channels are absent, empty or of unequal length.
    """
    lengths = {len(channel.samples) for channel in message.channels}
    if len(lengths) != 1 or 0 in lengths:
        raise FrameError(f"raw message of {message.header.frame_id!r} has channels of {sorted(lengths)} samples")
    samples = np.column_stack([np.frombuffer(channel.samples, np.float64) for channel in message.channels])
    names = tuple(channel.channel_name for channel in message.channels)
    return Chunk(names, samples, to_ns(message.device_timestamp) or None, to_ns(message.header.stamp))


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
