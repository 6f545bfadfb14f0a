"""Who wore a sensor when: by the topics on which its samples came, and by what the registry of assignments said."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from sense4hri.names import StreamName

from sense4hri_report.watch import Span
from sense4hri_report.window import Window

LAG_NS = 10_000_000_000
"""So long a driver may take to move its topics after the registry was told."""
MOST_RUNS = 50
"""A sensor that changes more often is two that share a name: nobody's stretches can be told."""


class Assigned(NamedTuple):
    """The registry's word: this pseudonym from then on, ROS time."""

    since_ns: int
    human_id: str


class Move(NamedTuple):
    """A sensor went from one person to another, ROS time; either may be `unassigned`."""

    at_ns: int
    sensor_id: str
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.sensor_id} went from {self.before} to {self.after}"


@dataclass
class Run:
    """Samples came for one pseudonym, by receipt."""

    human_id: str
    first_ns: int
    last_ns: int


@dataclass
class Wearer:
    """The runs of one stream of one sensor, in order."""

    runs: list[Run] = field(default_factory=list)

    def take(self, human_id: str, received_ns: int) -> None:
        """A message came; one that is older than the newest run was only late."""
        newest = self.runs[-1] if self.runs else None
        if newest is not None and newest.human_id == human_id:
            newest.last_ns = max(newest.last_ns, received_ns)
        elif newest is None or (received_ns > newest.last_ns and len(self.runs) <= MOST_RUNS):
            self.runs.append(Run(human_id, received_ns, received_ns))

    @property
    def moved(self) -> bool:
        """It went from one person to another."""
        return 1 < len(self.runs) <= MOST_RUNS


@dataclass
class Wearers:
    """All of a recording. assigned: the registry's changes by sensor_id, oldest first."""

    by_sensor: defaultdict[tuple[str, str], Wearer] = field(default_factory=lambda: defaultdict(Wearer))
    assigned: dict[str, list[Assigned]] = field(default_factory=dict)

    def take(self, name: StreamName, received_ns: int) -> None:
        """A raw message of a stream came."""
        self.by_sensor[name.sensor_type, name.sensor_id].take(name.human_id, received_ns)

    def assign(self, sensor_id: str, human_id: str, since_ns: int) -> None:
        """The registry says who wears a sensor."""
        told = self.assigned.setdefault(sensor_id, [])
        if (not told or told[-1].human_id != human_id) and len(told) <= MOST_RUNS:
            told.append(Assigned(max(since_ns, told[-1].since_ns if told else 0), human_id))

    def move(self, to_reference: Callable[[str, int], int]) -> None:
        """Lead the times of receipt from the clock of each sensor's driver's host to the reference's."""
        for (_, sensor_id), wearer in self.by_sensor.items():
            for run in wearer.runs:
                run.first_ns, run.last_ns = (to_reference(sensor_id, at_ns) for at_ns in (run.first_ns, run.last_ns))

    def window_of(self, name: StreamName, window: Window) -> Window | None:
        """The part of a window in which a stream's person wore the sensor; None where that is no part of it."""
        wearer = self.by_sensor.get((name.sensor_type, name.sensor_id))
        if wearer is None or not wearer.moved:
            return window
        spans = [
            (max(from_ns, window.from_ns), min(to_ns, window.to_ns))
            for run, from_ns, to_ns in self._stretches(name.sensor_id, wearer, window)
            if run.human_id == name.human_id and from_ns < window.to_ns and to_ns > window.from_ns
        ]
        if not spans:
            return None
        from_ns, to_ns = spans[0][0], spans[-1][1]
        return window._replace(
            from_ns=from_ns,
            to_ns=to_ns,
            begins=window.begins or from_ns > window.from_ns,
            ends=window.ends or to_ns < window.to_ns,
            away=tuple((before[1], after[0]) for before, after in pairwise(spans)),
        )

    def moves(self, window: Window) -> Iterator[Move]:
        """Every change of wearer, once for all streams of a sensor."""
        known: set[tuple[str, int, str]] = set()
        for (_, sensor_id), wearer in self.by_sensor.items():
            stretches = self._stretches(sensor_id, wearer, window) if wearer.moved else []
            for number, ((before, _, at_ns), (after, *_)) in enumerate(pairwise(stretches)):
                if (key := (sensor_id, number, after.human_id)) not in known:
                    known.add(key)
                    yield Move(at_ns, sensor_id, before.human_id, after.human_id)

    def disagreements(self, name: StreamName) -> Iterator[Span]:
        """When samples came for this stream's person while the registry named another one."""
        wearer, told = self.by_sensor.get((name.sensor_type, name.sensor_id)), self.assigned.get(name.sensor_id, [])
        ends = [after.since_ns for _, after in pairwise(told)]
        for run in wearer.runs if wearer is not None and len(wearer.runs) <= MOST_RUNS else ():
            for word, end_ns in zip(told, [*ends, run.last_ns], strict=False):
                from_ns, to_ns = max(word.since_ns, run.first_ns), min(max(end_ns, word.since_ns), run.last_ns)
                if name.human_id == run.human_id != word.human_id and to_ns - from_ns > LAG_NS:
                    yield Span(from_ns, to_ns, word.human_id)

    def _stretches(self, sensor_id: str, wearer: Wearer, window: Window) -> list[tuple[Run, int, int]]:
        """Every run with the time in which the sensor was that person's: from one handing over to the next."""
        edges = [min(wearer.runs[0].first_ns, window.from_ns)]
        edges += [self._handed_over_ns(sensor_id, before, after) for before, after in pairwise(wearer.runs)]
        edges.append(max(wearer.runs[-1].last_ns, window.to_ns))
        return [(run, *edge) for run, edge in zip(wearer.runs, pairwise(edges), strict=True)]

    def _handed_over_ns(self, sensor_id: str, before: Run, after: Run) -> int:
        """Between the last sample of the one and the first of the other, when the registry says, if it does."""
        told = [word.since_ns for word in self.assigned.get(sensor_id, ()) if word.human_id == after.human_id]
        said_ns = min(told, key=lambda since_ns: abs(since_ns - after.first_ns), default=before.last_ns)
        return min(max(said_ns, before.last_ns), after.first_ns)
