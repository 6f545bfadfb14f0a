"""An offset over time as a smooth curve through knots: the most likely one below all packets, or through measurements.

The method is told in `clock_fit`. Times `tau` and offsets in s, from the segment's origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

Floats = NDArray[np.floating[Any]]

SKEW_WALK = 4e-7  # random walk of the skew per square root of a second; 15 ppm of wander in 20 min are still followed
SKEW_SIGMA = 100e-6  # a crystal out of the box
LEAST_SCALE_S = 2e-5
BARRIER_START, BARRIER_END, BARRIER_STEP = 1.0, 1e4, 10.0


class Measurement(NamedTuple):
    """A two-way measurement: ROS time = device time + offset_ns at device_ns; uncertainty_s is a 95 % half width."""

    device_ns: int
    offset_ns: int
    uncertainty_s: float


def interpolate(x: Floats, knots: Floats, values: Floats) -> Floats:
    """Linear between the knots, and on with the first or last slope beyond them."""
    inside = np.interp(x, knots, values)
    first = (values[1] - values[0]) / (knots[1] - knots[0])
    last = (values[-1] - values[-2]) / (knots[-1] - knots[-2])
    return inside + np.minimum(x - knots[0], 0.0) * first + np.maximum(x - knots[-1], 0.0) * last


def delay_scale(above: Floats) -> float:
    """Mean of exponential delays above the curve, by their median, in s."""
    return max(float(np.median(above)) / np.log(2), LEAST_SCALE_S)


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


def below(tau: Floats, y: Floats, knots: Floats, near: NDArray[np.bool_]) -> tuple[Floats, float]:
    """The most likely curve below all packets; only `near` ones pull it up. Returns it and the delays' scale."""
    stiff = _stiffness(knots)
    hull = _local_hulls(tau, y, knots)
    left, right = _shares(tau[hull], knots)
    bound = y[hull]
    all_left, all_right = _shares(tau[near], knots)
    start = _linebelow(tau, y)
    curve = start[0] + start[1] * knots - 1e-3
    scale = delay_scale((y - np.interp(tau, knots, curve))[near])
    for _ in range(2):
        load = np.bincount(all_left, 1 - all_right, len(knots)) + np.bincount(all_left + 1, all_right, len(knots))
        curve = _interior_point(curve, load / scale, stiff, left, right, bound)
        scale = delay_scale((y - np.interp(tau, knots, curve))[near])
    return curve, scale


def _linebelow(tau: Floats, y: Floats) -> tuple[float, float]:
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


def smooth(measurements: Sequence[Measurement], origin: int, offset: int, knots: Floats) -> Floats:
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
