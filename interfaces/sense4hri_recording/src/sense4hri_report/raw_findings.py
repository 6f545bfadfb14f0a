"""What was found of one stream of raw samples: counts, holes, events, and the samples with their times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS
from sense4hri_recording.receipts import Receipts

from sense4hri_report.holes import Holes

KEPT = 5000  # events of one kind that are listed; all are counted
KINDS = ("duplicate", "conflict", "reorder", "backwards", "reboot", "clock_reset", "channels")


class Event(NamedTuple):
    """Something else than a hole. at_ns: ROS time. kind: one of KINDS; what: details."""

    at_ns: int
    kind: str
    what: str


class Placed(NamedTuple):
    """Samples with ROS times, shape (n,); fresh: they do not continue those before."""

    times_ns: NDArray[np.int64]
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    fresh: bool


@dataclass
class RawFindings:
    """The account of one raw stream.

    declared_hz: the declared rate, 0 = irregular, None = nowhere declared. on_samples: gets everything that counts.
    """

    declared_hz: float | None
    on_samples: Callable[[Placed], None] = lambda placed: None
    messages: int = 0
    samples: int = 0
    undecodable: int = 0
    duplicates: int = 0
    conflicts: int = 0
    reorders: int = 0
    backwards: int = 0
    resets: int = 0
    mixed: int = 0
    untimed: int = 0
    lost_within: int = 0
    """Samples that messages lack among their own."""
    first_ns: int = 0
    last_ns: int = 0
    first_log_ns: int = 0
    last_log_ns: int = 0
    first_device_ns: int = 0
    last_device_ns: int = 0
    has_device_time: bool = False
    holes: Holes = field(default_factory=Holes)
    events: list[Event] = field(default_factory=list)
    channels: dict[str, bool] = field(default_factory=dict)
    """All that ever came, and whether every message brought them."""
    corrected: bool = False
    """The clock models of the recording gave the times; else receipt did, less the smallest delay seen."""
    rate_hz: float | None = None
    """The rate by which samples are counted; None before it is known."""
    receipts: Receipts = field(default_factory=Receipts)
    counts: Counter[str] = field(default_factory=Counter)
    """Events by kind; `events` lists the first of them."""
    steady_samples: int = 0
    steady_ns: int = 0
    """Samples between which nothing was missing, and the time of their stamps."""
    frame: int = 0
    """Samples of the newest message."""

    @property
    def measured_hz(self) -> float | None:
        """Samples over the time of the stamps where nothing was missing; None where that cannot be known."""
        return self.steady_samples * SECOND_NS / self.steady_ns if self.steady_ns > 0 else None

    @property
    def lost(self) -> int | None:
        """Samples missing between others, by device time; None where the device gives none to count them by."""
        if self.messages and (not self.has_device_time or not self.rate_hz):
            return None
        return sum(hole.lost for hole in self.holes if not hole.estimated)

    @property
    def lost_estimated(self) -> int:
        """Samples that about fit into holes whose length only receipt tells."""
        return sum(hole.lost for hole in self.holes if hole.estimated)

    @property
    def frame_s(self) -> float:
        """Length of the newest message in s; 0 where irregular."""
        return self.frame / self.rate_hz if self.rate_hz else 0.0

    def move(self, to_reference: Callable[[int], int]) -> None:
        """Lead all times but the recorder's receipts from the clock of the driver's host to the reference's."""
        self.first_ns, self.last_ns = (at_ns and to_reference(at_ns) for at_ns in (self.first_ns, self.last_ns))
        for hole in self.holes:
            hole.from_ns, hole.to_ns = to_reference(hole.from_ns), to_reference(hole.to_ns)
        self.events = [event._replace(at_ns=to_reference(event.at_ns)) for event in self.events]

    def event(self, at_ns: int, kind: str, what: str) -> None:
        """Count something that happened, and list it where there are not too many."""
        self.counts[kind] += 1
        if self.counts[kind] <= KEPT:
            self.events.append(Event(at_ns, kind, what))
