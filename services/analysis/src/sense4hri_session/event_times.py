"""Times of events, which are in the device's clock, as ROS time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from sense4hri.names import StreamName

from sense4hri_session.clock_fit import ClockFit
from sense4hri_session.seen import Seen

ToRos = Callable[[int, int], int]
"""(event_ns, received_ns) -> ROS time in ns; received_ns: header stamp of the message that told of the event."""


def to_ros(source: StreamName, seen: Mapping[StreamName, Seen], clocks: Mapping[str, ClockFit]) -> ToRos:
    """The conversion of the events of a stream (`source_of`), on its driver's host.

    Those of a stream without device time are in ROS time already.
    """
    fit = clocks.get(source.sensor_id)
    segment_of = None if fit is None else fit.segment_of.get("/".join(source))
    if fit is None or segment_of is None:
        return lambda event_ns, received_ns: event_ns
    stamps = zip(seen[source].received_ns, seen[source].device_ns, strict=True)
    received = np.array([received_ns for received_ns, device_ns in stamps if device_ns], np.int64)
    order = np.argsort(received, kind="stable")
    ordered, segments = received[order], segment_of[order]

    def convert(event_ns: int, received_ns: int) -> int:
        at = min(int(np.searchsorted(ordered, received_ns)), len(ordered) - 1)
        return int(fit.segments[int(segments[at])].ros_ns(np.array([event_ns], np.int64))[0])

    return convert


def source_of(name: StreamName, seen: Mapping[StreamName, Seen]) -> StreamName:
    """The stream whose clock it is: a derived one (`respiration/h10_1_ecg`) has that of what it is derived from."""
    if name in seen:
        return name
    own = [other for other in seen if name.sensor_id == f"{other.sensor_id}_{other.sensor_type}"]
    return own[0] if own else name
