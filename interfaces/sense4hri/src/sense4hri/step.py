"""What an interpreter's step takes and gives: plain tuples. Imports no ROS.

An update is a NamedTuple whose fields are named as those of the features message, and besides carries the two stamps of
the last sample used. See `docs/adding-an-interpreter.md`.
"""

from typing import Any, NamedTuple, Protocol

from sense4hri.chunk import TimedChunk
from sense4hri.grid import UpdateGrid


class Update(Protocol):
    """What a step found. Both stamps are those of the last sample used; they become those of the message."""

    @property
    def device_ns(self) -> int | None: ...
    @property
    def received_ns(self) -> int: ...


class Step(Protocol):
    """The streaming state of an interpreter for one stream, made as `Step(config, stream_info)`.

    The constructor raises ValueError where the stream cannot be used; the sentence is published. Time comes in with the
    data, never from a clock. A step sees one set of channels: where that changes, a new one is made. It may also have:

    - `device_reported(name, value, received_ns)`: a value that the device computed itself (`heart_rate`, ...);
    - `marker(marker)`: a `Marker` of the study for this person, or for everybody; before the first samples that came at
      its stamp or later;
    - `beside(stream_info, timed) -> list of updates`: samples of another stream of the same device, in the order of the
      stamps;
    - `evidence(stream_info, timed)`: the same, but as they come, so that nothing is held for them; of these a step uses
      what was received at least 1 s before the update (see `sense4hri.motion`).

    What a step does not have is not subscribed to.
    """

    def push(self, timed: TimedChunk) -> list[Any]:
        """Take the next samples; return the updates that became due."""


class Feature(NamedTuple):
    """One named quantity for `extra`; values: oldest first, NaN where it cannot be computed."""

    name: str
    unit: str
    values: tuple[float, ...]


class Marker(NamedTuple):
    """An event of the study (`/study/markers`). received_ns: the event itself in ROS time."""

    received_ns: int
    device_ns: int | None
    uncertainty_s: float
    session_id: str
    human_id: str
    name: str
    value: str
    source: str


class Unusable(NamedTuple):
    """The update of a stream that cannot be used: every number of the message is NaN, and this is why."""

    device_ns: int | None
    received_ns: int
    reasons: tuple[str, ...]


class UnusableStep:
    """Stands in for the step of a stream that cannot be used: says why at the first sample, then at every update."""

    def __init__(self, update_interval_s: float, reason: str) -> None:
        self._grid, self._reasons = UpdateGrid(update_interval_s), (reason,)
        self._said = False

    def push(self, timed: TimedChunk) -> list[Unusable]:
        """Return one update at the first sample of all and one for every grid point."""
        pieces = [piece for piece, due in self._grid.split(timed) if due]
        if not self._said:
            self._said = True
            pieces.insert(0, timed.part(0, 1))
        return [Unusable(piece.device_ns, piece.received_ns, self._reasons) for piece in pieces]
