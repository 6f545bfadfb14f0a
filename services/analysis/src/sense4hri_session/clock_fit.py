"""The clock of one device against ROS time, from the whole recording and in both directions of time.

A packet gives one pair: `tau`, the device time of its newest sample, and `y`, receipt minus device time. `y` is the
clock's offset plus a delay that is never negative, so the offset runs along the lower edge of the cloud of packets.

Method. Per segment (nothing is blended across a reset or a step) the offset is a curve through knots. Delays above it
are exponential, as for the hull estimators (Moon, Skelly & Towsley 1999; Zhang, Liu & Xia 2002): every packet pulls the
curve up, and it must lie below all of them. A random walk of the skew keeps it smooth, as a crystal's temperature
does. That is a convex problem; an interior-point method solves it with banded matrices. The curve then touches the
earliest packets; what lies under them on average is estimated from the gaps between the smallest delays, and
subtracted. Where a driver measured the offset in both directions those measurements are smoothed instead.
The smallest delay of the link cannot be observed; only `transport_delay_s` of it is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.host_account import HostAccount

from sense4hri_session.clock_curve import Measurement, below, delay_scale, interpolate, smooth
from sense4hri_session.clock_epochs import epochs

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]

SECOND_NS = 1_000_000_000
KNOT_S = 10.0
MOST_KNOTS = 20_000
MOST_HANDS = 100  # so often a sensor changes hands in a session; more are two devices of one name
GATE_SCALES, GATE_S = 6.0, 0.003  # further above the curve a packet was queued and says nothing
EXCESS_WINDOW_S, EXCESS_SMALLEST, EXCESS_SHARE = 60.0, 20, 8  # of a window the 20 smallest delays, or an eighth


class Packets(NamedTuple):
    """Stamps of one stream's messages in the order of receipt, int64 ns; device and host clock of the last sample."""

    device_ns: Ints
    received_ns: Ints


@dataclass(frozen=True)
class Segment:
    """One epoch of a device clock. offset_s at knots_s, both relative to device_ns and offset_ns."""

    device_ns: int
    offset_ns: int
    knots_s: Floats
    offset_s: Floats
    excess_s: float
    measured: bool

    def ros_ns(self, device_ns: Ints) -> Ints:
        """ROS time in ns of device times of this epoch; beyond its ends the skew there goes on."""
        tau = (np.asarray(device_ns, np.int64) - self.device_ns) * 1e-9
        curve = interpolate(tau, self.knots_s, self.offset_s) - self.excess_s
        return device_ns + self.offset_ns + np.rint(curve * SECOND_NS).astype(np.int64)

    def ros_ns_at_start(self) -> int:
        """ROS time in ns of device_ns."""
        return int(self.ros_ns(np.array([self.device_ns], np.int64))[0])

    def skew_ppm(self) -> float:
        """Mean rate of ROS time against the device's, minus 1, in 1e-6."""
        return float((self.offset_s[-1] - self.offset_s[0]) / (self.knots_s[-1] - self.knots_s[0]) * 1e6)


@dataclass(frozen=True)
class ClockFit:
    """The clock of one device. segment_of: for every stream the index into `segments` of each of its packets."""

    segments: tuple[Segment, ...]
    segment_of: dict[str, NDArray[np.int32]]


def fit_clock(
    streams: dict[str, Packets],
    transport_delay_s: float = 0.0,
    measurements: Sequence[Measurement] = (),
    host_clock: Sequence[HostAccount] = (),
) -> ClockFit:
    """Fit the clock that all these streams share. Raises ValueError where there is no packet at all.

    streams: by `human/type/sensor`. Those that differ in the human alone and take turns are one stream: its sensor
    changed hands, and its clock may have begun anew between the two.
    """
    names = sorted(streams)
    sizes = [len(streams[name].device_ns) for name in names]
    if not sum(sizes):
        raise ValueError("no packet has device time")
    numbers = _numbers({name: streams[name].received_ns for name in names})
    which = np.concatenate([np.full(n, numbers[name], np.int32) for n, name in zip(sizes, names, strict=True)])
    device = np.concatenate([np.asarray(streams[name].device_ns, np.int64) for name in names])
    received = np.concatenate([np.asarray(streams[name].received_ns, np.int64) for name in names])
    place = np.concatenate([np.arange(n) for n in sizes])
    order = np.lexsort((place, received)) if _is_sorted(streams) else np.argsort(received, kind="stable")
    segment = np.empty(len(device), np.int32)
    segment[order] = epochs(which[order], device[order], received[order], host_clock)
    fitted = []
    for number in range(int(segment.max()) + 1):
        own = segment == number
        fitted.append(_fit_segment(device[own], received[own], transport_delay_s, measurements))
    edges = np.concatenate([[0], np.cumsum(sizes)])
    return ClockFit(tuple(fitted), {name: segment[edges[i] : edges[i + 1]] for i, name in enumerate(names)})


def _numbers(received: dict[str, Ints]) -> dict[str, int]:
    """The number of every stream, the same of those of a sensor that changed hands."""
    numbers = {name: number for number, name in enumerate(received)}
    kinds: dict[str, list[str]] = {}
    for name in received:
        kinds.setdefault(name.partition("/")[2] or name, []).append(name)
    for own in kinds.values():
        whose = np.repeat(np.arange(len(own)), [len(received[name]) for name in own])
        order = np.argsort(np.concatenate([received[name] for name in own]), kind="stable")
        if np.count_nonzero(np.diff(whose[order])) <= MOST_HANDS:
            numbers |= dict.fromkeys(own, numbers[own[0]])
    return numbers


def _is_sorted(streams: dict[str, Packets]) -> bool:
    return all(bool(np.all(np.diff(packets.received_ns) >= 0)) for packets in streams.values())


def _fit_segment(
    device: Ints, received: Ints, transport_delay_s: float, measurements: Sequence[Measurement]
) -> Segment:
    order = np.argsort(device, kind="stable")
    device, received = device[order], received[order]
    origin, offset = int(device[0]), int(received[0] - device[0])
    tau = (device - origin) * 1e-9
    y = ((received - device) - offset) * 1e-9
    count = int(min(max(np.ceil(tau[-1] / KNOT_S), 1), MOST_KNOTS, 2 * len(tau))) + 1
    knots = np.linspace(0.0, max(float(tau[-1]), 1.0), count)
    own = [m for m in measurements if device[0] - 60 * SECOND_NS <= m.device_ns <= device[-1] + 60 * SECOND_NS]
    own = [m for m in own if abs((m.offset_ns - offset) * 1e-9 - float(np.median(y))) < 10.0]
    if own:
        curve = smooth(own, origin, offset, knots)
        return Segment(origin, offset, knots, curve, 0.0, True)
    if len(tau) == 1:
        return Segment(origin, offset, knots, np.zeros(count), transport_delay_s, False)
    curve, _ = below(tau, y, knots, np.ones(len(tau), bool))
    above = y - np.interp(tau, knots, curve)
    scale = delay_scale(above)
    near = above <= GATE_SCALES * scale + GATE_S
    if not near.all():
        curve, _ = below(tau, y, knots, near)
        above = y - np.interp(tau, knots, curve)
    return Segment(origin, offset, knots, curve, _excess(tau, above) + transport_delay_s, False)


def _excess(tau: Floats, above: Floats) -> float:
    """How far, on average, the smallest possible delay lies under the smallest that was seen, in s.

    Half the gap between neighbouring delays, weighted by its size: right where delays are random (then it equals the
    mean gap), and where packets and a radio's polling are in step, so that only some delays ever happen.
    """
    window = np.floor(tau / EXCESS_WINDOW_S)
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(window)) + 1, [len(tau)]])  # of years, only those with packets
    found = []
    for low, high in pairwise(bounds):
        if high - low < EXCESS_SMALLEST:
            continue
        smallest = np.sort(above[low:high])[: max(EXCESS_SMALLEST, (high - low) // EXCESS_SHARE)]
        gaps = np.diff(smallest)
        if gaps.sum() > 0:
            found.append(float(np.sum(gaps * gaps) / (2 * np.sum(gaps))))
    return float(np.median(found)) if found else 0.0
