"""Samples of a stream gathered from update to update, and what a hole between them breaks. Imports no ROS.

An interpreter that computes once per block, on all its samples together, cannot depend on how the chunks were cut.
"""

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.chunk import Break, TimedChunk
from sense4hri.grid import UpdateGrid
from sense4hri.hrv import LONGEST_GAP_S
from sense4hri.stamps import SECOND_NS

PATIENCE_S = 2.0  # of sample time that a block waits for the streams beside it
KEPT_S = 60.0  # of a stream beside one that is silent


class Hole(Enum):
    """What is between a block and the next one."""

    CHAIN = "chain"  # samples are missing: nothing may be measured across; what was learned before holds
    SEGMENT = "segment"  # more than `longest_gap_s` is missing: everything begins anew
    CLOCK = "clock"  # the device started afresh: moreover, times before cannot be compared with times after


class Samples(NamedTuple):
    """Samples, shape (n, channels), and their times, shape (n,), on the event clock."""

    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    times_ns: NDArray[np.int64]


@dataclass(frozen=True)
class Block:
    """All samples since the block before: up to a point of the update grid, or up to a hole.

    samples: shape (n, channels); n is 0 where a hole follows an update at once. device_ns, received_ns: stamps of the
    last sample, for the update. first_ns: first sample of the segment; begins: it is the first one of this block. due:
    an update belongs to its last sample. hole: what follows it. beside: samples of other streams of the device in the
    same time, by sensor type; one that gave none is absent.
    """

    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    times_ns: NDArray[np.int64]
    device_ns: int | None
    received_ns: int
    first_ns: int
    begins: bool
    due: bool
    hole: Hole | None
    end_ns: int  # the last sample so far, also of an empty block
    beside: Mapping[str, Samples] = field(default_factory=dict)

    def window_s(self, longest_s: float) -> float:
        """Return the time since the segment's first sample, but at most longest_s: a message's `window_s`."""
        return min((self.end_ns - self.first_ns) / SECOND_NS, longest_s)


class Blocks:
    """Cuts one stream into blocks.

    A hole of at most bridged_s is none: the samples go on, with that much time between them; where `filled`, each lost
    sample of such a hole stands there as NaN, so that the samples keep their rate. beside: sensor types of the same
    device whose samples are added to each block. It waits for them, as long as patience_s of its own samples at most;
    then that stream is taken to be absent until it comes again.
    """

    def __init__(
        self,
        update_interval_s: float,
        *,
        bridged_s: float = 0.0,
        filled: bool = False,
        longest_gap_s: float = LONGEST_GAP_S,
        beside: Collection[str] = (),
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._grid, self._filled = UpdateGrid(update_interval_s, longest_gap_s), filled
        self._bridged_ns, self._longest_gap_ns = round(bridged_s * SECOND_NS), round(longest_gap_s * SECOND_NS)
        self._beside = {sensor_type: _Beside() for sensor_type in beside}
        self._patience_ns = round(patience_s * SECOND_NS)
        self._pieces: list[TimedChunk] = []  # since the last block
        self._newest: TimedChunk | None = None
        self._first_ns, self._begins = 0, True
        self._held: deque[Block] = deque()  # complete, but for what is beside them

    def take(self, timed: TimedChunk) -> list[Block]:
        """Take the next samples; return the blocks that are complete now."""
        if self._is_bridged(timed):
            self._fill(timed)
            timed = timed._replace(break_=None)
        hole = self._hole(timed)
        if hole is not None:
            self._held.append(self._block(due=False, hole=hole))
            self._begins = hole is not Hole.CHAIN
        for piece, due in self._grid.split(timed):
            if self._begins and not self._pieces:
                self._first_ns = int(piece.times_ns[0])
            self._pieces.append(piece)
            self._newest = piece
            if due:
                self._held.append(self._block(due=True, hole=None))
        return self._complete()

    def take_beside(self, sensor_type: str, timed: TimedChunk) -> list[Block]:
        """Take samples of a stream beside this one; return the blocks that waited for them."""
        self._beside[sensor_type].take(timed)
        return self._complete()

    def _gap_ns(self, timed: TimedChunk) -> int:
        return 0 if self._newest is None else int(timed.times_ns[0] - self._newest.times_ns[-1])

    def _is_bridged(self, timed: TimedChunk) -> bool:
        return timed.break_ is Break.GAP and 0 < self._gap_ns(timed) <= self._bridged_ns

    def _fill(self, timed: TimedChunk) -> None:
        """Let the samples that were lost before a chunk belong to the block of its first one."""
        if not self._filled or not timed.lost:
            return
        assert self._newest is not None
        edges_ns = int(self._newest.times_ns[-1]), int(timed.times_ns[0])
        times_ns = edges_ns[0] + np.arange(1, timed.lost + 1) * (edges_ns[1] - edges_ns[0]) // (timed.lost + 1)
        samples = np.full((timed.lost, timed.samples.shape[1]), np.nan)
        self._pieces.append(timed._replace(samples=samples, times_ns=times_ns))

    def _hole(self, timed: TimedChunk) -> Hole | None:
        if self._newest is None or timed.break_ is None:
            return None
        if timed.break_ is not Break.GAP:
            return Hole.CLOCK
        return Hole.CHAIN if self._gap_ns(timed) <= self._longest_gap_ns else Hole.SEGMENT

    def _block(self, due: bool, hole: Hole | None) -> Block:
        assert self._newest is not None
        last, pieces = self._newest, self._pieces or [self._newest.part(0, 0)]
        begins, self._begins, self._pieces = self._begins and bool(self._pieces), False, []
        samples = np.concatenate([piece.samples for piece in pieces])
        times_ns = np.concatenate([piece.times_ns for piece in pieces])
        stamps = last.device_ns, last.received_ns
        end_ns = int(last.times_ns[-1])
        return Block(last.channels, samples, times_ns, *stamps, self._first_ns, begins, due, hole, end_ns)

    def _complete(self) -> list[Block]:
        """Return the held blocks that have what is beside them, or need not wait for it any more."""
        complete = []
        while self._held and not self._waits(self._held[0]):
            block = self._held.popleft()
            near = {sensor_type: stream.until(block.end_ns) for sensor_type, stream in self._beside.items()}
            complete.append(replace(block, beside={name: got for name, got in near.items() if got is not None}))
        return complete

    def _waits(self, block: Block) -> bool:
        if self._newest is None or any(held.hole is Hole.CLOCK for held in self._held):
            return False
        lag_ns = int(self._newest.times_ns[-1]) - block.end_ns
        awaited = [stream.awaited(block.end_ns, lag_ns > self._patience_ns) for stream in self._beside.values()]
        return any(awaited)


class Presence:
    """How much of a window came, by the number of samples: a filter that bridges short losses does not show them.

    blocks: of the window, so many.
    """

    def __init__(self, blocks: int) -> None:
        self._blocks = blocks
        self.restart()

    def restart(self) -> None:
        """Forget what was before."""
        self._counts = np.empty((0, 2), int)  # samples with a number, and all, of each block

    def add(self, samples: NDArray[np.float64]) -> None:
        """Take the samples of a block, shape (n, channels), NaN where one is missing."""
        number = np.count_nonzero(np.isfinite(samples).all(axis=1))
        self._counts = np.concatenate([self._counts, [[number, len(samples)]]])[-self._blocks :]

    def share(self) -> float:
        """Return the share of samples that are a number, 0 before the first."""
        came, due = self._counts.sum(axis=0)
        return float(came / max(1, due))


class _Beside:
    """The samples of one stream beside another that no block has taken yet."""

    def __init__(self) -> None:
        self._pieces: deque[TimedChunk] = deque()
        self._newest_ns: int | None = None
        self._absent = False

    def take(self, timed: TimedChunk) -> None:
        if timed.break_ is Break.RESET or (self._pieces and self._pieces[-1].channels != timed.channels):
            self._pieces.clear()
        self._pieces.append(timed)
        self._newest_ns, self._absent = int(timed.times_ns[-1]), False
        while self._pieces[0].times_ns[-1] < self._newest_ns - round(KEPT_S * SECOND_NS):
            self._pieces.popleft()

    def awaited(self, end_ns: int, too_long: bool) -> bool:
        """True where samples up to end_ns are still to come; too_long: they have been waited for long enough."""
        self._absent |= too_long and not self._reaches(end_ns)
        return not self._absent and not self._reaches(end_ns)

    def _reaches(self, end_ns: int) -> bool:
        return self._newest_ns is not None and self._newest_ns >= end_ns

    def until(self, end_ns: int) -> Samples | None:
        """Return the samples up to end_ns, each once; None where there is none."""
        taken = []
        while self._pieces and self._pieces[0].times_ns[0] <= end_ns:
            piece = self._pieces.popleft()
            n = int(np.searchsorted(piece.times_ns, end_ns, side="right"))
            taken.append(piece.part(0, n))
            if n < len(piece.times_ns):
                self._pieces.appendleft(piece.part(n, len(piece.times_ns)))
        if not taken:
            return None
        samples = np.concatenate([piece.samples for piece in taken])
        return Samples(taken[0].channels, samples, np.concatenate([piece.times_ns for piece in taken]))
