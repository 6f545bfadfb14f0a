"""What was refused of what others sent: counted, and each topic and publisher named once. Pure."""

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

MOST_NAMED = 1000
LOOK_S = 1.0
LONGEST_SENTENCE = 300


@dataclass
class LeftOut:
    """What was refused of one topic or ROS service. nodes: full names of those who publish it, as far as known."""

    count: int = 0
    nodes: tuple[str, ...] = ()
    why: str = ""
    look_at_s: float = 0.0


class Refusals:
    """Filled from any thread.

    count(kind): adds one to the metric; kinds are message types and ROS services of this program, so they are few.
    publishers(topic): full names of the nodes behind it; looked up once per LOOK_S. warn: writes one line.
    """

    def __init__(
        self, count: Callable[[str], None], publishers: Callable[[str], Iterable[str]], warn: Callable[[str], None]
    ) -> None:
        self._count, self._publishers, self._warn = count, publishers, warn
        self._lock = threading.Lock()
        self.named: dict[str, LeftOut] = {}
        """What was refused so far, by topic or ROS service: at most MOST_NAMED of them."""

    def add(self, place: str, kind: str, why: str) -> None:
        """Count what was refused, and say it where its sender is not known for it yet."""
        self._count(kind)
        with self._lock:
            if place not in self.named and len(self.named) >= MOST_NAMED:
                return
            left_out = self.named.setdefault(place, LeftOut())
            left_out.count, left_out.why = left_out.count + 1, why[:LONGEST_SENTENCE]
            if time.monotonic() < left_out.look_at_s:
                return
            left_out.look_at_s = time.monotonic() + LOOK_S
        self._name(place, left_out)

    def _name(self, place: str, left_out: LeftOut) -> None:
        nodes = tuple(sorted(set(self._publishers(place))))
        if left_out.count > 1 and set(nodes) <= set(left_out.nodes):
            return
        left_out.nodes = nodes
        by = f" from {', '.join(nodes)}" if nodes else ""
        self._warn(f"{place}: refused{by}: {left_out.why}; more of it is only counted")
