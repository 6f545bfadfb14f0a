"""What a first pass over the raw messages of a stream has seen: stamps, counts, channels and their extremes."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sense4hri.cdr import RawMessage
from sense4hri.intake import LARGEST
from sense4hri.stream_info import can_be_rate
from sense4hri_recording.receipts import Receipts
from sense4hri_report.rates import true_rate

Floats = NDArray[np.floating[Any]]

STEADY = 0.5  # share by which messages of the usual rate may differ from their median
PAUSE_S = 1.0  # by which a message follows later than its samples last
SETTLED = 20  # messages, from which on their rate is believed more than a declared one
PASSES = 4  # each leaves out pauses that longer ones had hidden in the mean

_integers = partial(array, "q")  # 8 bytes each: a list of int takes 40, for as long as the session is open


@dataclass
class Seen:
    """Arrays have one entry per message; received_ns: a stamp that no clock explains is replaced.

    channels: the smallest and the largest sample of each channel that ever came, without those beyond any unit.
    """

    device_ns: array[int] = field(default_factory=_integers)
    received_ns: array[int] = field(default_factory=_integers)
    counts: array[int] = field(default_factory=_integers)
    channels: dict[str, tuple[float, float]] = field(default_factory=dict)
    channel_sets: dict[tuple[str, ...], None] = field(default_factory=dict)
    undecodable: int = 0
    receipts: Receipts = field(default_factory=Receipts)

    @property
    def samples(self) -> int:
        """All samples, those of repeated messages among them."""
        return sum(self.counts)

    def add(self, raw: RawMessage, log_ns: int) -> None:
        """Take in one message. log_ns: when the recorder had it."""
        self.device_ns.append(raw.device_ns)
        self.received_ns.append(self.receipts.believed_ns(raw.received_ns, log_ns))
        self.counts.append(len(raw.samples))
        self.channel_sets[raw.channels] = None
        low, high = _extremes(raw.samples)
        for name, a, b in zip(raw.channels, low, high, strict=True):
            before = self.channels.get(name, (math.inf, -math.inf))
            self.channels[name] = (min(before[0], a), max(before[1], b))

    def rate_hz(self) -> float:
        """Samples over time of the stamps, gaps and resets left out; 0 where that cannot be known.

        By the device's stamps where most messages have one, else by receipt.
        """
        by_device, steps, counts = self._steps()
        return _device_rate_hz(steps, counts) if by_device else _receipt_rate_hz(steps, counts)

    def true_rate_hz(self, declared_hz: float) -> float:
        """The declared rate, but where the stamps tell of quite another one, by the report's rule."""
        found_hz = self.rate_hz()
        if len(self.counts) < SETTLED or not can_be_rate(found_hz):
            return declared_hz
        by_device, steps, counts = self._steps()
        usual_s = float(np.median(steps / counts))
        return true_rate(declared_hz, found_hz, by_device, 1 / usual_s if usual_s > 0 else 0.0)

    def _steps(self) -> tuple[bool, Floats, Floats]:
        """Whether they are the device's, s from each stamp to the next, and the samples that came with the latter."""
        timed = np.array(self.device_ns, np.int64) != 0
        by_device = 2 * int(timed.sum()) > len(timed)
        if not by_device:
            timed[:] = True
        stamps = np.array(self.device_ns if by_device else self.received_ns, np.int64)[timed]
        samples = np.cumsum(np.array(self.counts, float))[timed]
        return by_device, np.diff(stamps) * 1e-9, np.diff(samples)


def _device_rate_hz(steps_s: Floats, counts: Floats) -> float:
    """Of messages that follow each other without a gap."""
    good = steps_s > 0
    if good.sum() < 2:
        return 0.0
    per_sample = steps_s[good] / counts[good]
    usual = np.sort(per_sample)[(len(per_sample) - 1) // 2]
    steady = np.abs(per_sample / usual - 1) < STEADY
    return float(counts[good][steady].sum() / steps_s[good][steady].sum())


def _receipt_rate_hz(steps_s: Floats, counts: Floats) -> float:
    """Of all messages but those after a pause, as they may come together: what is usual between two says nothing."""
    kept = steps_s >= 0
    for _ in range(PASSES):
        if kept.sum() < 2 or not steps_s[kept].sum():
            return 0.0
        per_sample = steps_s[kept].sum() / counts[kept].sum()
        kept &= steps_s < PAUSE_S + counts * per_sample
    return float(1 / per_sample)


def _extremes(samples: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    low, high = samples.min(axis=0).tolist(), samples.max(axis=0).tolist()
    if all(abs(each) < LARGEST for each in (*low, *high)):
        return low, high
    possible = np.abs(samples) < LARGEST
    return (
        np.where(possible, samples, np.inf).min(axis=0).tolist(),
        np.where(possible, samples, -np.inf).max(axis=0).tolist(),
    )
