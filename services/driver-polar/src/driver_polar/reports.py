"""Decoded frames to what the kit publishes: samples under their stream, the device's own values beside them."""

import math
from collections.abc import Iterator

from sense4hri.chunk import Chunk
from sense4hri.device import Item, Reported, Samples
from sense4hri.errors import FrameError
from sense4hri.gatt import feature

from driver_polar.protocol import Frame, Intervals


def of_frame(frame: Frame, sensor_type: str, channel_names: tuple[str, ...], received_ns: int) -> Iterator[Item]:
    """Hand on the samples under the declared channel names, and status words as values the device reports.

    Raises FrameError where the frame has another number of channels than the stream declares.
    """
    if frame.channels:
        if len(frame.channels) != len(channel_names):
            raise FrameError(
                f"{sensor_type} frame of {len(frame.channels)} channels, declared are {len(channel_names)}"
            )
        yield Samples(sensor_type, Chunk(channel_names, frame.samples, frame.device_ns, received_ns))
    if frame.status:
        words = tuple(feature(word.name, "1", *word.values.tolist()) for word in frame.status)
        yield Reported(sensor_type, received_ns, frame.device_ns, words)


def of_intervals(intervals: Intervals, sensor_type: str, received_ns: int) -> Iterator[Item]:
    """Report one value per interval; rates of 0 (unknown) are left out, a contact the device cannot tell is NaN."""
    known = [bpm for bpm in intervals.heart_rate_bpm if bpm]
    features = [feature("heart_rate", "1/min", *known)] if known else []
    features += [
        feature("pp_interval", "ms", *intervals.interval_ms),
        feature("pp_error", "ms", *intervals.error_ms),
        feature("blocked", "1", *intervals.blocked),
        feature("contact", "1", *(math.nan if touch is None else touch for touch in intervals.contact)),
    ]
    yield Reported(sensor_type, received_ns, intervals.device_ns, tuple(features))
