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
from scipy.linalg import solveh_banded

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]

SECOND_NS = 1_000_000_000
KNOT_S = 10.0
MOST_KNOTS = 20_000
SKEW_WALK = 4e-7  # random walk of the skew per square root of a second; 15 ppm of wander in 20 min are still followed
SKEW_SIGMA = 100e-6  # a crystal out of the box
LEAST_SCALE_S = 2e-5
GATE_SCALES, GATE_S = 6.0, 0.003  # further above the curve a packet was queued and says nothing
JUMP_S = 1.0
BEFORE_S, AFTER_S = 60.0, 900.0  # a jump that drains within the latter was a stall
STEP_S = 2e-3
STRAY_S = 5.0
EXCESS_WINDOW_S, EXCESS_SMALLEST, EXCESS_SHARE = 60.0, 20, 8  # of a window the 20 smallest delays, or an eighth
BARRIER_START, BARRIER_END, BARRIER_STEP = 1.0, 1e4, 10.0


class Packets(NamedTuple):
    """Stamps of one stream's messages in the order of receipt, int64 ns; device and host clock of the last sample."""

    device_ns: Ints
    received_ns: Ints


class Measurement(NamedTuple):
    """A two-way measurement: ROS time = device time + offset_ns at device_ns; uncertainty_s is a 95 % half width."""

    device_ns: int
    offset_ns: int
    uncertainty_s: float


class HostClock(NamedTuple):
    """The host's account of its clock: stamp in ROS time and CLOCK_REALTIME - CLOCK_MONOTONIC, ns."""

    stamp_ns: int
    realtime_minus_monotonic_ns: int


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
        curve = _interpolate(tau, self.knots_s, self.offset_s) - self.excess_s
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
    host_clock: Sequence[HostClock] = (),
) -> ClockFit:
    """Fit the clock that all these streams share. Raises ValueError where there is no packet at all."""
    names = sorted(streams)
    sizes = [len(streams[name].device_ns) for name in names]
    if not sum(sizes):
        raise ValueError("no packet has device time")
    which = np.concatenate([np.full(n, i, np.int32) for i, n in enumerate(sizes)])
    device = np.concatenate([np.asarray(streams[name].device_ns, np.int64) for name in names])
    received = np.concatenate([np.asarray(streams[name].received_ns, np.int64) for name in names])
    place = np.concatenate([np.arange(n) for n in sizes])
    order = np.lexsort((place, received)) if _is_sorted(streams) else np.argsort(received, kind="stable")
    segment = np.empty(len(device), np.int32)
    segment[order] = _segments(which[order], device[order], received[order], host_clock)
    fitted = []
    for number in range(int(segment.max()) + 1):
        own = segment == number
        fitted.append(_fit_segment(device[own], received[own], transport_delay_s, measurements))
    edges = np.concatenate([[0], np.cumsum(sizes)])
    return ClockFit(tuple(fitted), {name: segment[edges[i] : edges[i + 1]] for i, name in enumerate(names)})


def _is_sorted(streams: dict[str, Packets]) -> bool:
    return all(bool(np.all(np.diff(packets.received_ns) >= 0)) for packets in streams.values())


def _segments(which: NDArray[np.int32], device: Ints, received: Ints, host_clock: Sequence[HostClock]) -> Ints:
    """Number of the epoch of every packet, packets of all streams being in order of receipt."""
    y = ((received - received[0]) - (device - device[0])) * 1e-9
    at = (received - received[0]) * 1e-9
    cuts = set(_host_steps(y, received, host_clock))
    for stream in range(int(which.max()) + 1):
        own = np.flatnonzero(which == stream)
        if len(own) < 2:
            continue
        back = own[1:][np.diff(device[own]) < 0]
        cuts.update(int(i) for i in back)
        for i, change in zip(own[1:], np.diff(y[own]), strict=True):
            if abs(change) > JUMP_S and i not in cuts and _is_step(y, at, int(i), float(change)):
                cuts.add(int(i))
    cuts.discard(0)
    found = np.zeros(len(y), np.int64)
    number, last = 0, 0
    for cut in sorted(cuts):
        base = np.min(y[max(0, last) : cut])
        base_now = float(np.min(y[cut : cut + 20]))
        if number and cut - last < 50 and abs(y[cut] - np.min(y[last:cut])) < JUMP_S:
            continue  # another stream of the device tells the same news
        number, last = number + 1, cut
        found[cut:] = number
        near = np.flatnonzero(at[cut : cut + 2000] - at[cut] < STRAY_S) + cut
        strays = near[(which[near] != which[cut]) & (np.abs(y[near] - base) < np.abs(y[near] - base_now))]
        found[strays] = number - 1
    return found


def _is_step(y: Floats, at: Floats, i: int, change: float) -> bool:
    """True where the packets from i on lie on another line: no stall that drains, nor the drain of one."""
    before = y[np.searchsorted(at, at[i] - BEFORE_S) : i]
    after = y[i : np.searchsorted(at, at[i] + AFTER_S)]
    return bool(abs(after.min() - before.min()) > 0.5 * abs(change)) if len(before) else False


def _host_steps(y: Floats, received: Ints, host_clock: Sequence[HostClock]) -> list[int]:
    """Index of the first packet after each step of the host's clock."""
    found = []
    for (before_ns, before), (after_ns, after) in pairwise(host_clock):
        step_s = (after - before) * 1e-9
        if abs(step_s) < STEP_S:
            continue
        low, high = sorted((before_ns, after_ns))
        around = np.flatnonzero((received >= low - 2 * SECOND_NS) & (received <= high + 2 * SECOND_NS))
        earlier = np.flatnonzero((received < low) & (received >= low - 60 * SECOND_NS))
        if not len(around) or not len(earlier):
            continue
        base = float(np.min(y[earlier]))
        if step_s < 0:
            below = around[y[around] < base + step_s / 2]
            found += [int(below[0])] if len(below) else []
        else:
            below = around[y[around] < base + step_s / 2]
            found += [int(below[-1]) + 1] if len(below) and below[-1] + 1 < len(y) else []
    return found


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
        curve = _smooth(own, origin, offset, knots)
        return Segment(origin, offset, knots, curve, 0.0, True)
    if len(tau) == 1:
        return Segment(origin, offset, knots, np.zeros(count), transport_delay_s, False)
    curve, _ = _below(tau, y, knots, np.ones(len(tau), bool))
    above = y - np.interp(tau, knots, curve)
    scale = _scale(above)
    near = above <= GATE_SCALES * scale + GATE_S
    if not near.all():
        curve, _ = _below(tau, y, knots, near)
        above = y - np.interp(tau, knots, curve)
    return Segment(origin, offset, knots, curve, _excess(tau, above) + transport_delay_s, False)


def _scale(above: Floats) -> float:
    return max(float(np.median(above)) / np.log(2), LEAST_SCALE_S)


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


def _interpolate(x: Floats, knots: Floats, values: Floats) -> Floats:
    """Linear between the knots, and on with the first or last slope beyond them."""
    inside = np.interp(x, knots, values)
    first = (values[1] - values[0]) / (knots[1] - knots[0])
    last = (values[-1] - values[-2]) / (knots[-1] - knots[-2])
    return inside + np.minimum(x - knots[0], 0.0) * first + np.maximum(x - knots[-1], 0.0) * last


def _stiffness(knots: Floats) -> Floats:
    """The smoothness prior's matrix in the upper banded form of solveh_banded, shape (3, knots)."""
    n, h = len(knots), float(knots[1] - knots[0])
    band = np.zeros((3, n))
    slope = 1.0 / (SKEW_SIGMA * h * (n - 1)) ** 2 / (n - 1)
    for i in range(n - 1):  # a weak pull of every slope to zero, together worth the prior of the mean skew
        weight = slope * (n - 1) ** 2
        band[2, i] += weight
        band[2, i + 1] += weight
        band[1, i + 1] -= weight
    weight = 1.0 / (SKEW_WALK**2 * h**3)
    for i in range(n - 2):
        for a, u in ((0, 1.0), (1, -2.0), (2, 1.0)):
            for b, v in ((0, 1.0), (1, -2.0), (2, 1.0)):
                if b >= a:
                    band[2 - (b - a), i + b] += weight * u * v
    return band


def _multiply(band: Floats, x: Floats) -> Floats:
    out = band[2] * x
    for k in (1, 2):
        if len(x) > k:
            out[k:] += band[2 - k, k:] * x[:-k]
            out[:-k] += band[2 - k, k:] * x[k:]
    return out


def _shares(tau: Floats, knots: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Knot before each time, and the weight of the one after it."""
    step = knots[1] - knots[0]
    left = np.clip((tau / step).astype(np.intp), 0, len(knots) - 2)
    return left, (tau - knots[left]) / step


def _below(tau: Floats, y: Floats, knots: Floats, near: NDArray[np.bool_]) -> tuple[Floats, float]:
    """The most likely curve below all packets; only `near` ones pull it up. Returns it and the delays' scale."""
    stiff = _stiffness(knots)
    hull = _local_hulls(tau, y, knots)
    left, right = _shares(tau[hull], knots)
    bound = y[hull]
    all_left, all_right = _shares(tau[near], knots)
    start = _line_below(tau, y)
    curve = start[0] + start[1] * knots - 1e-3
    scale = _scale((y - np.interp(tau, knots, curve))[near])
    for _ in range(2):
        load = np.bincount(all_left, 1 - all_right, len(knots)) + np.bincount(all_left + 1, all_right, len(knots))
        curve = _interior_point(curve, load / scale, stiff, left, right, bound)
        scale = _scale((y - np.interp(tau, knots, curve))[near])
    return curve, scale


def _line_below(tau: Floats, y: Floats) -> tuple[float, float]:
    slope = 0.0
    if tau[-1] > 60:
        third = len(tau) // 3
        early, late = int(np.argmin(y[: third + 1])), int(np.argmin(y[-third - 1 :])) + len(y) - third - 1
        if tau[late] > tau[early]:
            slope = float(np.clip((y[late] - y[early]) / (tau[late] - tau[early]), -1e-3, 1e-3))
    return float(np.min(y - slope * tau)), slope


def _local_hulls(tau: Floats, y: Floats, knots: Floats) -> NDArray[np.intp]:
    """Indices of the packets that can touch a curve which is straight between knots: lower hulls per interval."""
    keep: list[int] = []
    edges = np.searchsorted(tau, knots)
    edges[-1] = len(tau)
    for low, high in pairwise(edges):
        hull: list[int] = []
        for i in range(int(low), int(high)):
            while len(hull) > 1:
                a, b = hull[-2], hull[-1]
                if (y[b] - y[a]) * (tau[i] - tau[a]) < (y[i] - y[a]) * (tau[b] - tau[a]):
                    break
                hull.pop()
            hull.append(i)
        keep += hull
    return np.array(keep, np.intp)


def _interior_point(
    curve: Floats, load: Floats, stiff: Floats, left: NDArray[np.intp], right: Floats, bound: Floats
) -> Floats:
    """Maximise load @ f - f @ stiff @ f / 2 with f below every bound, from a curve that is."""
    n = len(curve)
    at_left = 1 - right

    def value(f: Floats, t: float) -> float:
        slack = bound - at_left * f[left] - right * f[left + 1]
        if np.any(slack <= 0):
            return np.inf
        return float(t * (0.5 * f @ _multiply(stiff, f) - load @ f) - np.log(slack).sum())

    t = BARRIER_START
    while t <= BARRIER_END:
        for _ in range(30):
            inverse = 1.0 / (bound - at_left * curve[left] - right * curve[left + 1])
            gradient = t * (_multiply(stiff, curve) - load)
            gradient += np.bincount(left, at_left * inverse, n) + np.bincount(left + 1, right * inverse, n)
            square = inverse * inverse
            matrix = t * stiff
            matrix[2] += np.bincount(left, at_left**2 * square, n) + np.bincount(left + 1, right**2 * square, n)
            matrix[1] += np.bincount(left + 1, at_left * right * square, n)
            matrix[2] *= 1 + 1e-12
            step = -solveh_banded(matrix, gradient)
            decrease = float(-gradient @ step)
            if decrease < 1e-4:
                break
            length, now = 1.0, value(curve, t)
            while value(curve + length * step, t) > now - 0.1 * length * decrease and length > 1e-9:
                length *= 0.5
            curve = curve + length * step
        t *= BARRIER_STEP
    return curve


def _smooth(measurements: Sequence[Measurement], origin: int, offset: int, knots: Floats) -> Floats:
    """The curve through two-way measurements, each as good as it says; those far off are left out."""
    tau = np.array([(m.device_ns - origin) * 1e-9 for m in measurements])
    y = np.array([(m.offset_ns - offset) * 1e-9 for m in measurements])
    sigma = np.array([m.uncertainty_s / 2 if 0 < m.uncertainty_s < 1e6 else 5e-3 for m in measurements])
    sigma = np.maximum(sigma, LEAST_SCALE_S)
    use = np.abs(y - np.median(y)) < 10.0
    curve = np.zeros(len(knots))
    for _ in range(3):
        left, right = _shares(np.clip(tau[use], knots[0], knots[-1]), knots)
        weight = 1.0 / sigma[use] ** 2
        level = np.average(y[use], weights=weight)
        n, matrix = len(knots), _stiffness(knots)
        matrix[2] += np.bincount(left, (1 - right) ** 2 * weight, n) + np.bincount(left + 1, right**2 * weight, n)
        matrix[1] += np.bincount(left + 1, right * (1 - right) * weight, n)
        matrix[2] *= 1 + 1e-12
        pull = np.bincount(left, (1 - right) * weight * (y[use] - level), n)
        pull += np.bincount(left + 1, right * weight * (y[use] - level), n)
        curve = level + solveh_banded(matrix, pull)
        away = np.abs(y - np.interp(tau, knots, curve)) / sigma
        use = away < 6 * max(1.0, float(np.median(away)))
    return curve
