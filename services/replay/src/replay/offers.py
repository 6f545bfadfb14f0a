"""From the QoS that was recorded to the one that is offered again."""

from collections.abc import Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from replay.recorded import Topic

DEPTH = 1000
_RELIABLE = ("reliable", 1)
_UNLIMITED_S = 9_000_000_000


def profile(topic: Topic) -> QoSProfile:
    """What is offered: the strongest that any publisher of the topic offered, so that whoever heard it hears it again.

    The queue of a volatile topic is as long as flow control needs; subscribers do not see its length.
    """
    entries: Sequence[dict[str, Any]] = topic.offers
    reliable = not entries or any(entry.get("reliability") in _RELIABLE for entry in entries)
    offered = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=topic.latched_depth if topic.latched else DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )
    deadlines = [deadline for entry in entries if (deadline := _seconds(entry.get("deadline"))) is not None]
    if deadlines:
        offered.deadline = Duration(seconds=min(deadlines))
    return offered


def _seconds(entry: Any) -> float | None:
    """A recorded duration in s; None where there was no limit."""
    if not isinstance(entry, dict):
        return None
    seconds = float(entry.get("sec", 0)) + float(entry.get("nsec", 0)) * 1e-9
    return seconds if 0 < seconds < _UNLIMITED_S else None
