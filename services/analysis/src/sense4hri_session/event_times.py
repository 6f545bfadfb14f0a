"""Times of events, which are in the device's clock, as ROS time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from sense4hri.clock_model import nearest_ns
from sense4hri.names import StreamName
from sense4hri.sample_clock import UNTIMED_S

from sense4hri_session.clock_fit import SECOND_NS, ClockFit, Ints
from sense4hri_session.seen import Seen

ToRos = Callable[[int, int, int | None], int]
"""(event_ns, received_ns, device_ns) -> ROS time in ns; the latter two are stamps of the message that told of it."""


def to_ros(
    source: StreamName, seen: Mapping[StreamName, Seen], clocks: Mapping[str, ClockFit], delay_s: float
) -> ToRos:
    """The conversion of the events of a stream (`source_of`), on its driver's host.

    Those of a stream without device time, or told while it had none, are in ROS time already, as their samples are.
    delay_s: the known part of the link's delay, that is subtracted from those too.
    """
    delay_ns = round(delay_s * SECOND_NS)
    fit = clocks.get(source.sensor_id)
    segment_of = None if fit is None else fit.segment_of.get("/".join(source))
    if fit is None or segment_of is None:
        return lambda event_ns, received_ns, device_ns: event_ns - delay_ns
    stamps = zip(seen[source].received_ns, seen[source].device_ns, strict=True)
    received = np.array([received_ns for received_ns, device_ns in stamps if device_ns], np.int64)
    order = np.argsort(received, kind="stable")
    ordered, segments = received[order], segment_of[order]

    def convert(event_ns: int, received_ns: int, device_ns: int | None) -> int:
        at = int(np.searchsorted(ordered, received_ns, side="right")) - 1  # the newest raw message with device time
        if not device_ns and (at < 0 or received_ns - int(ordered[at]) >= UNTIMED_S * SECOND_NS):
            return event_ns - delay_ns
        return int(fit.segments[int(segments[max(at, 0)])].ros_ns(np.array([event_ns], np.int64))[0])

    return convert


def marked_ns(told_ns: Ints, device_ns: Ints, fit: ClockFit | None, delay_s: float) -> Ints:
    """ROS time of markers that a sensor's driver told, on its host: where the sensor's samples lie.

    told_ns: by their stamps. device_ns: 0 where the device gave no time. It is of the epoch of the device's clock that
    comes nearest to the stamp; where all are too far, of another clock.
    """
    found_ns = told_ns - round(delay_s * SECOND_NS)
    by_epoch = [segment.ros_ns(device_ns) for segment in fit.segments] if fit else []
    for i in np.flatnonzero(device_ns):
        if (at_ns := nearest_ns((int(ros_ns[i]) for ros_ns in by_epoch), int(told_ns[i]))) is not None:
            found_ns[i] = at_ns
    return found_ns


def source_of(name: StreamName, seen: Mapping[StreamName, Seen]) -> StreamName:
    """The stream whose clock it is: a derived one (`respiration/h10_1_ecg`) has that of what it is derived from.

    Of a sensor that changed hands it is the same person's.
    """
    if name in seen:
        return name
    own = [other for other in seen if name.sensor_id == f"{other.sensor_id}_{other.sensor_type}"]
    return next((other for other in own if other.human_id == name.human_id), own[0] if own else name)
