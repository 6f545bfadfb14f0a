"""Inputs on one time line: corrected time, the newest value at a moment, and the one-second grid; pure.

All times are ROS time in ns and come in with the data; nothing here asks a clock. The grid moves as far as the newest
receipt stamp of any input allows, so a recording replayed at any speed gives the states of the live run.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable
from typing import Generic, NamedTuple, TypeVar

from sense4hri.clock_model import fits, ros_ns

SECOND_NS = 1_000_000_000
SETTLE_NS = SECOND_NS // 2
"""A grid point waits so long for inputs that come late and out of order."""
AWAITED_NS = 3 * SECOND_NS
"""A grid point waits for an awaited input (a computed heart rate) until others are so far ahead of it."""
AWAITED_LOOKS, PATIENT_NS = 8, 9 * SECOND_NS
"""It waits up to the longer time while it has been looked for so few times: 3 s of a replay at 20x are 0.15 s."""
JUMP_NS = 10 * SECOND_NS
"""A step of time larger than this is a new beginning: a replay started over, a host clock set, a long pause."""
AT_ONCE_NS = SECOND_NS // 4
"""Corrected time nearer to receipt than this is taken for receipt: a state does not hang on a clock model's last ms."""

Value = TypeVar("Value")


def seconds(later_ns: int, earlier_ns: int) -> float:
    """The difference of two times in s."""
    return (later_ns - earlier_ns) / SECOND_NS


class ClockModel(NamedTuple):
    """The newest clock model of a device (contract, section 3)."""

    reference_ns: int
    offset_ns: int
    skew_ppm: float


def corrected_ns(device_ns: int, receipt_ns: int, model: ClockModel | None) -> int:
    """When the newest sample was taken; receipt where that is near, or device time or a fitting model is missing."""
    if not device_ns or model is None:
        return receipt_ns
    found_ns = ros_ns(device_ns, model.reference_ns, model.offset_ns, model.skew_ppm)
    return found_ns if fits(found_ns, receipt_ns) and abs(found_ns - receipt_ns) > AT_ONCE_NS else receipt_ns


class Newest(Generic[Value]):
    """The values of one input, sorted by time; asked for rising moments only."""

    KEPT = 1024
    """A camera's lists of faces, 100 a second, for as long as a grid point waits (PATIENT_NS)."""

    def __init__(self) -> None:
        self._times_ns: list[int] = []
        self._values: list[Value] = []

    def put(self, time_ns: int, value: Value) -> None:
        """Add a value; of several with one stamp the one that came last counts."""
        place = bisect_right(self._times_ns, time_ns)
        self._times_ns.insert(place, time_ns)
        self._values.insert(place, value)
        if len(self._times_ns) > self.KEPT:
            self._drop(1)

    def at(self, time_ns: int) -> tuple[int, Value] | None:
        """The newest (time, value) that is not after this moment; what is older is dropped."""
        place = bisect_right(self._times_ns, time_ns)
        if not place:
            return None
        self._drop(place - 1)
        return self._times_ns[0], self._values[0]

    def _drop(self, count: int) -> None:
        del self._times_ns[:count], self._values[:count]


class Grid:
    """Whole seconds of ROS time, each due once when every input up to it has had half a second to come in.

    Moved by the stamps of receipt, which steadily rise; corrected times would step with every new clock model. Awaited
    sources lag behind, by computing time when a recording is replayed fast: no point passes what they last spoke of,
    or, where they have not spoken yet, the moment from which they are expected.
    """

    def __init__(self, first_ns: int = 0, expected: Iterable[str] = ()) -> None:
        """first_ns: no point lies before it; 0 = before the first input. expected: sources, from that input on."""
        self._newest: dict[str, int] = {}
        self._awaited = dict.fromkeys(expected, 0)
        self._looks = Counter[str]()  # at each awaited source since it spoke
        self.next_ns = -(-first_ns // SECOND_NS) * SECOND_NS
        """The next point; 0 = not known yet."""
        self.now_ns: int | None = None
        """The newest stamp of any input; None before the first."""
        self.begun = False
        """Whether a point has been due."""

    def stepped_back(self, source: str, stamp_ns: int) -> bool:
        """True where this source's stamps have stepped back so far that what was before is another story."""
        return stamp_ns < self._newest.get(source, stamp_ns) - JUMP_NS

    def saw(self, source: str, stamp_ns: int, awaited: bool = False) -> None:
        """An input of this source bears this stamp."""
        self._newest[source] = max(stamp_ns, self._newest.get(source, stamp_ns))
        if awaited:
            self._awaited[source] = self._newest[source]
            self._looks[source] = 0
        if self.now_ns is None:
            self._awaited = {source: since_ns or stamp_ns for source, since_ns in self._awaited.items()}
            self.next_ns = self.next_ns or -(-stamp_ns // SECOND_NS) * SECOND_NS
        self.now_ns = max(stamp_ns, self.now_ns or stamp_ns)

    def expect(self, source: str) -> None:
        """A source will speak of what comes from now on: it is awaited, unless it is already."""
        now_ns = self.now_ns or 0
        if now_ns - self._awaited.get(source, -AWAITED_NS - 1) > AWAITED_NS:
            self._awaited[source] = now_ns
            self._looks[source] = 0

    def forget(self, source: str) -> bool:
        """A source has gone: nothing waits for it any more. True where it was far ahead: time steps back."""
        self._awaited.pop(source, None)
        self._newest.pop(source, None)
        self._looks.pop(source, None)
        left_ns = max(self._newest.values(), default=None)
        if left_ns is None or self.now_ns is None or self.now_ns - left_ns <= JUMP_NS:
            return False
        self.now_ns, self.next_ns = left_ns, -(-left_ns // SECOND_NS) * SECOND_NS
        return True

    def due(self) -> list[int]:
        """The grid points to be computed now, in order; after a long pause only the newest."""
        if self.now_ns is None:
            return []
        self._looks.update(list(self._awaited))
        lagging = [s_ns for name, s_ns in self._awaited.items() if self._waited_for(name, self.now_ns - s_ns)]
        settled_ns = min(self.now_ns - SETTLE_NS, *lagging) if lagging else self.now_ns - SETTLE_NS
        if settled_ns - self.next_ns > JUMP_NS:
            self.next_ns = settled_ns // SECOND_NS * SECOND_NS
        points = list(range(self.next_ns, settled_ns + 1, SECOND_NS))
        if points:
            self.begun, self.next_ns = True, points[-1] + SECOND_NS
        return points

    def _waited_for(self, source: str, behind_ns: int) -> bool:
        patient = behind_ns <= PATIENT_NS and self._looks[source] <= AWAITED_LOOKS
        return behind_ns <= AWAITED_NS or patient
