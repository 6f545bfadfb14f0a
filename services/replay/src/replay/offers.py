"""From the QoS that was recorded to the one that is offered again."""

from collections.abc import Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from replay.bag import Topic

DEPTH, LATCHED_DEPTH = 1000, 100
_RELIABLE, _LATCHED = ("reliable", 1), ("transient_local", 1)
_KNOWN_LATCHED = {"/tf_static": LATCHED_DEPTH, "/robot_description": 1}
_UNLIMITED_S = 9_000_000_000


def is_latched(topic: Topic) -> bool:
    """True where a late subscriber was given what had been said before."""
    if not topic.offers:
        return topic.name in _KNOWN_LATCHED
    return any(entry.get("durability") in _LATCHED for entry in topic.offers)


def latched_depth(topic: Topic) -> int:
    """How many messages a late subscriber is given: as recorded, else 1 for topics of the contract, 100 for others."""
    depths = [entry["depth"] for entry in topic.offers if entry.get("depth")]
    if depths:
        return int(max(depths))
    return 1 if topic.name.startswith(("/humans/", "/study/")) else _KNOWN_LATCHED.get(topic.name, LATCHED_DEPTH)


def profile(topic: Topic) -> QoSProfile:
    """What is offered: the strongest that any publisher of the topic offered, so that whoever heard it hears it again.

    The queue of a volatile topic is as long as flow control needs; subscribers do not see its length.
    """
    entries: Sequence[dict[str, Any]] = topic.offers
    reliable = not entries or any(entry.get("reliability") in _RELIABLE for entry in entries)
    latched = is_latched(topic)
    offered = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=latched_depth(topic) if latched else DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
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
