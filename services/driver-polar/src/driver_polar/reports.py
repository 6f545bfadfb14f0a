"""Decoded frames to what the kit publishes: samples under their stream, the device's own values beside them."""

import math
from collections.abc import Iterator

from sense4hri.chunk import Chunk
from sense4hri.device import Feature, Item, Reported, Samples, Status
from sense4hri.errors import FrameError

from driver_polar.heart_rate import HeartRate
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
        words = tuple(_feature(word.name, "1", *word.values.tolist()) for word in frame.status)
        yield Reported(sensor_type, received_ns, frame.device_ns, words)


def of_intervals(intervals: Intervals, sensor_type: str, received_ns: int) -> Iterator[Item]:
    """Report one value per interval; rates of 0 (unknown) are left out, a contact the device cannot tell is NaN."""
    known = [bpm for bpm in intervals.heart_rate_bpm if bpm]
    features = [_feature("heart_rate", "1/min", *known)] if known else []
    features += [
        _feature("pp_interval", "ms", *intervals.interval_ms),
        _feature("pp_error", "ms", *intervals.error_ms),
        _feature("blocked", "1", *intervals.blocked),
        _feature("contact", "1", *(math.nan if touch is None else touch for touch in intervals.contact)),
    ]
    yield Reported(sensor_type, received_ns, intervals.device_ns, tuple(features))


def of_heart_rate(measured: HeartRate, sensor_type: str, received_ns: int) -> Iterator[Item]:
    """Report rate and RR intervals; they carry no device time, and a rate of 0 (unknown) is left out."""
    features = []
    if measured.bpm:
        features.append(_feature("heart_rate", "1/min", measured.bpm))
    if measured.rr_ms:
        features.append(_feature("rr_interval", "ms", *measured.rr_ms))
    if measured.energy_kj is not None:
        features.append(_feature("energy_expended", "kJ", measured.energy_kj))
    if measured.contact is not None:
        features.append(_feature("contact", "1", measured.contact))
        yield Status(contact=float(measured.contact))
    if features:
        yield Reported(sensor_type, received_ns, None, tuple(features))


def _feature(name: str, unit: str, *values: float) -> Feature:
    return Feature(name, unit, tuple(float(value) for value in values))
