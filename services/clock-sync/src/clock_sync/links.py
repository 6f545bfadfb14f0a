"""Simulated one-way links with known truth, for tests, benches and notebooks (profiles: see the README's Method)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SHORTEST_DELAY_S = 0.020
EPOCH_NS = 1_700_000_000_000_000_000


class Profile(NamedTuple):
    """One kind of link.

    period_s: time between packets. interval_s: of the link's polling, 0 = none. again: probability that a packet needs
    one more polling. stall_every_s, stall_s: mean time between two stalls of the host, and their mean length.
    jitter_s: mean of an exponential delay.
    """

    period_s: float
    interval_s: float
    again: float
    stall_every_s: float
    stall_s: float
    jitter_s: float = 0.0
    hiccup: float = 0.0  # probability of 16 ms more


PROFILES = {
    "strap": Profile(0.562, 0.045, 0.1, 30.0, 0.15),
    "eeg": Profile(0.047, 0.030, 0.1, 30.0, 0.15),
    "bad": Profile(0.562, 0.045, 0.4, 10.0, 1.0),
    "heavy": Profile(0.562, 0.045, 0.45, 10.0, 1.0),
    "congestion": Profile(0.562, 0.045, 0.1, 30.0, 0.15),
    "serial": Profile(0.05, 0.0, 0.0, 1e9, 0.0, 0.001, 0.02),
    "wifi": Profile(0.1, 0.0, 0.0, 20.0, 0.3, 0.004, 0.1),
    "slow": Profile(1.0371, 0.030, 0.1, 30.0, 0.15),
}


class Link(NamedTuple):
    """Packets that arrived: true time of the newest sample and receipt in s from the start, stamps in ns."""

    true_s: Floats
    received_s: Floats
    device_ns: NDArray[np.int64]
    received_ns: NDArray[np.int64]

    def error_ms(self, ros_ns: NDArray[np.int64]) -> Floats:
        """Error of the ROS times that a model gives to these packets, the shortest delay of the link apart."""
        return ((ros_ns - EPOCH_NS) / 1e9 - self.true_s - SHORTEST_DELAY_S) * 1e3


def simulate(
    profile: str,
    seed: int,
    duration_s: float = 1200.0,
    queue: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
    skew: float | None = None,
) -> Link:
    """A device clock that drifts (within 100 ppm) and wanders (within 15 ppm, 20 min) seen through a link.

    queue: times and heights in s of a congestion, put together by straight lines; the profile `congestion` has its own.
    """
    kind, random = PROFILES[profile], np.random.default_rng(seed)
    true = np.arange(0.0, duration_s, kind.period_s)
    drift = random.uniform(-100e-6, 100e-6) if skew is None else skew
    wander, phase = random.uniform(0, 15e-6), random.uniform(0, 2 * np.pi)
    rate = 1 + drift + wander * np.sin(2 * np.pi * true / 1200 + phase)
    device = random.uniform(1e3, 1e6) + np.concatenate([[0.0], np.cumsum(np.diff(true) * rate[1:])])
    received = true + SHORTEST_DELAY_S
    if kind.interval_s:
        first = random.uniform(0, kind.interval_s)
        received = first + np.ceil((received - first) / kind.interval_s) * kind.interval_s
        received += (random.geometric(1 - kind.again, len(true)) - 1) * kind.interval_s
    received += random.exponential(kind.jitter_s, len(true)) + 0.016 * (random.random(len(true)) < kind.hiccup)
    stall = 0.0
    while (stall := stall + random.exponential(kind.stall_every_s)) < duration_s:
        end = stall + random.exponential(kind.stall_s)
        received[(received >= stall) & (received < end)] = end
    if profile == "congestion":
        queue = queue or ((500.0, 590.0, 620.0), (0.0, 3.0, 0.0))
    if queue is not None:
        received += np.interp(true, *queue)
    received = np.maximum.accumulate(received)
    arrives = random.random(len(true)) > 0.01
    true, device, received = true[arrives], device[arrives], received[arrives]
    return Link(
        true, received, np.rint(device * 1e9).astype(np.int64), EPOCH_NS + np.rint(received * 1e9).astype(np.int64)
    )
