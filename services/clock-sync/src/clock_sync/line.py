"""The most likely line below a cloud of delays, and how sure it is; the method is told in `envelope`."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

WANDER_PER_S = 4e-8  # change of the skew with temperature, 1/s, as the uncertainty knows it
GATE_SCALES, GATE_S = 6.0, 0.003  # a bin so many delay scales and seconds above the line is congested
GAP_SMALLEST, GAP_SHARE = 20, 8  # of the delays the 20 smallest, or an eighth
FLOOR_S = 1e-5

_STEPS = np.logspace(-4, 0.5, 14)
_GRID = np.concatenate([-_STEPS[::-1], [0.0], _STEPS])
_CELLS = np.gradient(_GRID)

Point = tuple[float, float]


class Line(NamedTuple):
    """`y(tau) = level_s + skew * (tau - centre_s)` with the covariance of (level, skew) and the mean delay above it."""

    centre_s: float
    level_s: float
    skew: float
    var_level: float
    cov: float
    var_skew: float
    scale_s: float

    def at(self, tau_s: float) -> float:
        return self.level_s + self.skew * (tau_s - self.centre_s)

    def sigma_s(self, tau_s: float) -> float:
        """Standard deviation at `tau_s`, the wander of the skew since the centre included."""
        x = tau_s - self.centre_s
        wander = 0.5 * WANDER_PER_S * x * x
        return math.sqrt(max(self.var_level + 2 * x * self.cov + x * x * self.var_skew, 0.0) + wander * wander)


def lower_hull(points: Iterable[Point]) -> tuple[list[float], list[float]]:
    """Times and heights of the lower convex hull's vertices (Andrew's monotone chain); times of points must rise."""
    rest = iter(points)
    (x, y), slope = next(rest), -math.inf
    hull: list[tuple[float, float, float]] = []  # vertices before (x, y), each with the slope of the edge towards it
    for x_next, y_next in rest:
        while (slope_next := (y_next - y) / (x_next - x)) <= slope:
            x, y, slope = hull.pop()
        hull.append((x, y, slope))
        x, y, slope = x_next, y_next, slope_next
    hull.append((x, y, slope))
    return [vertex[0] for vertex in hull], [vertex[1] for vertex in hull]


def columns(points: Collection[Point]) -> NDArray[np.float64]:
    """Times and heights, shape (2, n)."""
    return np.fromiter(chain.from_iterable(points), np.float64, 2 * len(points)).reshape(-1, 2).T


def median_and_largest(values: NDArray[np.float64]) -> tuple[float, float]:
    """Of a few finite values, in a tenth of the time of np.median."""
    ordered, middle = np.sort(values), len(values) // 2
    return float(ordered[middle] + ordered[middle - 1 + len(values) % 2]) / 2, float(ordered[-1])


def _supporting_skew(hx: list[float], hy: list[float], centre: float, prior: float, weight: float) -> float:
    """The skew of the highest posterior: explicit at each hull vertex, and right at the vertex that keeps it."""
    low = -math.inf
    last = len(hx) - 1
    for k in range(last + 1):
        high = (hy[k + 1] - hy[k]) / (hx[k + 1] - hx[k]) if k < last else math.inf
        best = prior + (centre - hx[k]) * weight
        if best <= high:
            return max(best, low)
        low = high
    return low


def fit(
    points: Collection[Point], prior_skew: float, prior_sigma: float, largest_scale_s: float, unseen_s: float = 0.0
) -> Line:
    """Posterior mean of the line below `points` (tau_s, y_s; in order of tau), and its covariance at their centroid.

    `largest_scale_s` bounds the delay scale: a constant queue under most of the points must not pass for jitter. The
    line stays at least `unseen_s` below the hull: so far, on average, lies the shortest delay under the ones seen.
    """
    hx, hy = lower_hull(points)
    tau, y = columns(points)
    scale, variance = largest_scale_s, prior_sigma * prior_sigma
    for _ in range(2):
        n, centre = len(tau), float(np.add.reduce(tau)) / len(tau)
        skew = _supporting_skew(hx, hy, centre, prior_skew, variance * n / scale)
        above = y - skew * tau
        above -= min([v - skew * x for x, v in zip(hx, hy, strict=True)])
        middle, highest = median_and_largest(above)
        scale = min(max(middle / math.log(2), FLOOR_S), largest_scale_s)
        if highest > GATE_SCALES * scale + GATE_S:
            near = above <= GATE_SCALES * scale + GATE_S
            tau, y = tau[near], y[near]
    n, centre = len(tau), float(np.add.reduce(tau)) / len(tau)
    skew = _supporting_skew(hx, hy, centre, prior_skew, variance * n / scale)
    return _posterior(np.array((hx, hy)), (centre, skew), (prior_skew, prior_sigma), scale, n, unseen_s)


def _posterior(
    hull: NDArray[np.float64],
    likely: tuple[float, float],
    prior: tuple[float, float],
    scale: float,
    n: int,
    unseen_s: float,
) -> Line:
    """Mean and covariance of (level, skew) on a grid around the most likely skew.

    hull: times and heights, (2, m). likely: centroid of the n points, skew. prior: mean and deviation of the skew.
    """
    (centre, skew), (prior_skew, prior_sigma), excess = likely, prior, scale / n
    offsets = prior_sigma * _GRID
    levels = np.minimum.reduce(hull[1][:, None] - (skew + offsets) * (hull[0][:, None] - centre))
    best = float(levels[len(_STEPS)])
    drawn = (offsets + 2 * (skew - prior_skew)) * offsets / (2 * prior_sigma**2)
    weight = np.exp(np.minimum((levels - best) / excess - drawn, 50.0)) * _CELLS
    weight /= np.add.reduce(weight)
    mean_offset, mean_level = float(weight @ offsets), float(weight @ levels)
    d_skew, d_level = offsets - mean_offset, levels - mean_level
    weighted = weight * d_level
    return Line(
        centre,
        min(mean_level - excess, best - unseen_s),
        skew + mean_offset,
        float(weighted @ d_level) + excess * excess,
        float(weighted @ d_skew),
        float(weight @ (d_skew * d_skew)),
        scale,
    )


def half_gap(delays: NDArray[np.float64]) -> float:
    """How far, on average, the smallest possible delay lies under the smallest of these, in s.

    Half the gap between neighbouring smallest delays, weighted by its size: right where delays are random (then it
    equals the mean gap), and where packets and a radio's polling are in step, so that only some delays ever happen.
    """
    gaps = np.diff(np.sort(delays)[: max(GAP_SMALLEST, len(delays) // GAP_SHARE)])
    total = float(gaps.sum())
    return float(gaps @ gaps) / (2 * total) if total > 0 else 0.0
