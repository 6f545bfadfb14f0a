"""Samples that only the driver of a device without clock knows to be missing: nothing in their receipt shows it."""

from __future__ import annotations

from typing import NamedTuple

from sense4hri_report.raw_findings import RawFindings
from sense4hri_report.rules import Judgement, counted
from sense4hri_report.watch import HealthWatch
from sense4hri_report.window import Window


class DriverLoss(NamedTuple):
    """Samples lost between two accounts of a driver, ROS time; where between them nobody knows."""

    from_ns: int
    to_ns: int
    samples: int


def driver_losses(raw: RawFindings, health: HealthWatch | None) -> list[DriverLoss]:
    """What the driver counted beyond the holes of the stream; nothing of one with device time, which shows them all.

    A hole by receipt and a count of the same time are one loss, of the larger of both numbers: each sample of a hole
    stands for one that was counted in an account which overlaps it.
    """
    if raw.has_device_time or health is None:
        return []
    left = [hole.lost for hole in raw.holes]
    losses = []
    for from_ns, to_ns, samples in health.lost:
        for i, hole in enumerate(raw.holes):
            if hole.from_ns <= to_ns and hole.to_log_ns >= from_ns:
                same = min(samples, left[i])
                left[i], samples = left[i] - same, samples - same
        if samples:
            losses.append(DriverLoss(from_ns, to_ns, samples))
    return losses


def lost_in(losses: list[DriverLoss], window: Window) -> float:
    """Return how many of them lie in a window; those of an account across its edge by the share of its time."""
    return sum(loss.samples * window.share(loss.from_ns, loss.to_ns) for loss in losses)


def judge_driver_losses(losses: list[DriverLoss], expected: float, window: Window, judgement: Judgement) -> None:
    """expected: samples that the window should have, 0 = not known."""
    lost = lost_in(losses, window)
    if lost:
        percent = f" ({lost / expected:.2%})" if expected > 0 else ""
        number = counted(max(round(lost), 1), "sample")
        judgement.gaps(f"{number} missing{percent}, as its driver counted; where cannot be told")
