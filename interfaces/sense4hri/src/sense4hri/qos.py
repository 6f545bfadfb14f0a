"""Quality of service of every topic of the contract, and adaptation to topics that are not ours."""

from collections.abc import Sequence

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _volatile(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE)


def _latched() -> QoSProfile:
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


RAW = _volatile(200)
DEVICE = _volatile(50)
FEATURES = _volatile(50)
CLOCK = _latched()
CLOCK_MEASUREMENT = _volatile(50)
HEALTH = _volatile(1)
STATE = _volatile(10)
SESSION = _latched()
ACK = _volatile(100)
MARKERS = _volatile(100)
SENSORS = _latched()
ASSIGNMENTS = _latched()
HOST_CLOCKS = _latched()
CLOCK_PROBES = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)


def deep(profile: QoSProfile, depth: int = 2000) -> QoSProfile:
    """Return the profile for a subscriber that must not lose a burst: the same, with a longer queue."""
    return QoSProfile(depth=max(depth, profile.depth), reliability=profile.reliability, durability=profile.durability)


def adapt(offers: Sequence[QoSProfile], depth: int = 100) -> QoSProfile:
    """Return a profile that matches every publisher of a foreign topic: the weakest that is offered."""
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = bool(offers) and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def fitting(asked: QoSProfile, offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return what to ask for on a topic of the contract: best effort where none of those who publish offers more."""
    if not offers or any(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers):
        return asked
    return QoSProfile(depth=asked.depth, reliability=ReliabilityPolicy.BEST_EFFORT, durability=asked.durability)
