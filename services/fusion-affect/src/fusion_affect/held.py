"""What has come of a session that is yet to begin; pure."""

from collections import deque
from itertools import count
from typing import Generic, TypeVar

from fusion_affect.align import Newest

MOST_OF_ONE = Newest.KEPT
MOST = 1 << 14
"""Of 24 participants with two sensors and a face each about 9000 come while a grid point waits (`align.PATIENT_NS`)."""

Value = TypeVar("Value")


class Held(Generic[Value]):
    """Inputs in the order in which they came, by their sources.

    Of one source the newest MOST_OF_ONE are kept; of more than MOST in all the oldest of the source that came last
    goes: neither a flood of messages nor one of names pushes out what others have said.
    """

    def __init__(self) -> None:
        self._of: dict[str, deque[tuple[int, Value]]] = {}
        self._numbers, self._size = count(), 0

    def __len__(self) -> int:
        return self._size

    def put(self, source: str, value: Value) -> None:
        """Keep an input of this source."""
        of_source = self._of.setdefault(source, deque())
        of_source.append((next(self._numbers), value))
        self._size += 1
        if len(of_source) > MOST_OF_ONE:
            self._drop_of(source)
        elif self._size > MOST:
            self._drop_of(next(reversed(self._of)))

    def forget(self, source: str) -> None:
        """This source has gone, with all that it has said."""
        self._size -= len(self._of.pop(source, ()))

    def take(self) -> list[Value]:
        """Return all of it and keep nothing."""
        numbered = sorted((each for of_source in self._of.values() for each in of_source), key=lambda each: each[0])
        self._of, self._size = {}, 0
        return [value for _, value in numbered]

    def _drop_of(self, source: str) -> None:
        self._of[source].popleft()
        self._size -= 1
        if not self._of[source]:
            del self._of[source]
