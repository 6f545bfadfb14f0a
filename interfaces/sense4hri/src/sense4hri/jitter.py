"""Tells samples that are missing from device stamps that jitter. Imports no ROS.

A loss shifts every frame that follows it; what jitters comes back. Where a stream's stamps are exact, a late frame
tells at once how many samples are missing. Where jitter hides single samples, only whole frames are missing, and that
is believed once frames have stayed late for clearly longer, or are clearly later, than whatever came back within the
last minute: mostly some frames after the loss, and the number of lost frames is exact. The evidence is a cumulative
sum over how late each frame is (Page, Biometrika 41, 1954). Before thirty frames have shown how much stamps jitter, a
loss is believed in the same way; from the fourth frame on single samples are counted where none has shown jitter. What
the coarse ticks of a clock explain (1 ms of a board's `millis()`) is no jitter: they move a stamp by one tick at most.
"""

from bisect import bisect_left
from collections import deque
from heapq import nlargest
from itertools import islice
from math import gcd
from statistics import median

from sense4hri.running_rate import MEMORY_S
from sense4hri.stamps import SECOND_NS

SPREAD_FRAMES, SPREAD_SHARE, SPREADS = 1000, 0.99, 3.5  # jitter: 3.5 times what 99 % of so many frames stay within
FEW_FRAMES, LOOK_AGAIN = 30, 100  # before so many little is known of the jitter; it is looked at again after so many
STEADY_FRAMES = 3  # frames whose stamps did not jitter: what is missing after them need not be whole frames
UNSURE = 0.6  # samples: where 3.5 times the usual jitter is more, only whole frames are missed
PAUSE, ROOM = 0.7, 1.2  # of a sample: boards pause for less; 1.2 times the jitter less than a whole one
WHOLE = 0.05  # samples: so near to whole numbers losses lie where stamps do not jitter
TICK = 1 / 3  # samples: a clock of shorter ticks hides no single sample, also where its board pauses a little
SHIFT = 0.75  # of a frame: a board that pauses shifts its frames by less, one that loses a frame by a whole one
VOTE = 0.5  # of a frame: so much beyond SHIFT a single frame adds to the evidence at the most
LEAST, USUALS, BEFORE, YOUNG = 0.1, 2.0, 2.5, 3.0
"""A loss is believed where the evidence for it, in frames, is the sum of these or more: 0.1, 2 times the usual jitter,
2.5 times what turned out to be jitter before, and 3 divided by the number of frames so far."""
COUNTED, MANY = 3.0, 4.0  # frames listened to for each one of jitter, to count exactly; more missing are told at once
NEW_FRAMES, STAYED, LATE, NEW_SHIFT = 64, 5, 0.5, 0.7
"""Among the first 64 frames a loss is believed where a frame and the four after it are each half a frame late or more,
and their median is 0.7 of a frame or more."""
SETTLING, RESETTLING = 32, 8  # frames by which the usual lateness is known; it is learnt as if so many were, again


class Jitter:
    """How late and early the frames of one stream come, and what is missing all the same."""

    def __init__(self) -> None:
        self._shown = deque[float](maxlen=SPREAD_FRAMES)  # samples by which frames came late or early
        self._shown_ns = deque[int](maxlen=SPREAD_FRAMES)  # the stamps of these frames
        self._frames = self._looked = self._known = 0
        self._stamp_ns = self._tick_ns = 0
        self._usual = self._tick = 0.0  # samples by which a frame is usually late or early, and by its clock's ticks
        self._shift = _Shift()

    @property
    def doubtful(self) -> bool:
        """True while the newest frames are late or early, and nothing tells yet why: their rate is no rate."""
        return self._shift.undecided

    def missing(self, late: float, n: int, stamp_ns: int, fs_hz: float) -> int | None:
        """Return how many samples are known now to be missing; None where the frame of n continues the one before.

        late: by how many samples longer its stamp took than its samples do; negative = too early.
        """
        self._frames += 1
        self._learn_tick(stamp_ns, fs_hz)
        whole = late > 0.5 and abs(late - round(late)) < self._tick + (WHOLE if self._shown else WHOLE / 10)
        least = max(0.5, n / 20)
        tolerance = self._tolerance(least, whole)
        if abs(late) < n / 2 and not whole:
            self._shown.append(max(abs(late) - self._tick, 0.0))
            self._shown_ns.append(stamp_ns)
        self._look(stamp_ns)
        if tolerance is None:
            unit = 1 if self._known >= STEADY_FRAMES and not self._hides(least) else n
            return self._shift.missing(late, n, stamp_ns, USUALS * self._usual / n, unit)
        lost = None if abs(late) < tolerance else max(0, round(late))
        self._shift.follow(late - (lost or 0), n)
        return lost

    def of_another_rate(self) -> None:
        """The stream's rate is known better now: how late frames are usually is learnt afresh."""
        self._shift.settle()

    def _learn_tick(self, stamp_ns: int, fs_hz: float) -> None:
        """Learn in which steps the device's clock counts: they divide all that passes between two stamps.

        What has passed for jitter until then may have been of the ticks.
        """
        before_ns, self._tick_ns = self._tick_ns, gcd(self._tick_ns, stamp_ns - self._stamp_ns) if self._stamp_ns else 0
        self._stamp_ns = stamp_ns
        tick = self._tick_ns * fs_hz / SECOND_NS
        self._tick = tick if WHOLE < tick < TICK else 0.0
        if self._tick and self._tick_ns != before_ns:
            self._shown.clear()
            self._shown_ns.clear()
            self._known, self._usual = 0, 0.0

    def _look(self, stamp_ns: int) -> None:
        """Learn the usual jitter: with every frame at first, now and then later."""
        if self._known < FEW_FRAMES or self._frames >= self._looked + LOOK_AGAIN:
            self._looked = self._frames
            begun = bisect_left(self._shown_ns, stamp_ns - MEMORY_S * SECOND_NS)
            self._known = len(self._shown) - begun
            beyond = self._known - int(SPREAD_SHARE * (self._known - 1))
            self._usual = nlargest(beyond, islice(self._shown, begun, None))[-1] if self._known else 0.0

    def _tolerance(self, least: float, whole: bool) -> float | None:
        """Samples by which a frame may be late or early; None where a single frame cannot tell."""
        if self._known < FEW_FRAMES:
            return least if whole and self._usual < 2 * WHOLE else None
        if self._hides(least):
            return None
        spread = self._tick + SPREADS * self._usual
        return max(least, spread, min(PAUSE, 1 - ROOM * self._usual))

    def _hides(self, least: float) -> bool:
        """Whether the usual jitter is so large that it hides single samples."""
        return self._tick + SPREADS * self._usual > max(UNSURE, least)


class _Shift:
    """Whether frames have become later than usual by whole frames, and stay so: these frames were lost.

    Lateness is in samples in `_level` and `_usual_level`, in frames everywhere else.
    """

    def __init__(self) -> None:
        self.evidence, self.early = 0.0, False
        self._level = self._usual_level = 0.0  # samples by which the newest frame, and usual ones, are late in all
        self._frames = self._settled = 0
        self._late: list[float] = []  # how late each of the frames is that the evidence is of
        self._sum, self._newest = 0.0, deque([0.0], STAYED)  # by how much all frames are late, and those before
        self._stayed: list[float] = []  # by how much more those after a late one are, while little is known yet
        self._heights, self._sums = _Largest(), _Largest()  # what came back: of single frames, of the evidence

    @property
    def undecided(self) -> bool:
        """True while newer frames are to tell what the newest ones are."""
        return self.evidence > 0 or self.early or bool(self._stayed)

    def settle(self) -> None:
        """Learn faster for a while how late frames are usually."""
        self._settled = min(self._settled, RESETTLING)

    def follow(self, late: float, n: int) -> float:
        """Take a frame in; return by how much of one it is later than usual."""
        self._frames, self._settled = self._frames + 1, self._settled + 1
        self._level += late
        shift = (self._level - self._usual_level) / n
        self.early = shift < -SHIFT
        if shift < SHIFT:
            self._usual_level += shift * n / min(self._settled, SETTLING)
        return shift

    def missing(self, late: float, n: int, stamp_ns: int, needed: float, unit: int) -> int | None:
        """Return how many samples are missing; None where nothing is, or nothing tells yet.

        needed: evidence that the stream's usual jitter could make. unit: samples that are lost together, n or 1.
        """
        shift = self.follow(late, n)
        if self._new_loss(late / n):
            return self._believed(n, unit, self._stayed, 0.0)
        highest, largest = (each.since(stamp_ns - MEMORY_S * SECOND_NS) for each in (self._heights, self._sums))
        if shift < -SHIFT - needed:
            return self._too_early(stamp_ns, -shift)
        self.evidence += min(shift - SHIFT, VOTE)
        if self.evidence <= 0:
            self._came_back(stamp_ns)
            return None
        self._late.append(shift)
        needed += LEAST + YOUNG / self._frames
        at_once = shift - SHIFT >= needed + BEFORE * highest
        if not at_once and self.evidence < needed + BEFORE * largest:
            return None
        jitter = highest + SHIFT - 0.5 if highest else 0.0  # by which a count of frames would be wrong
        if len(self._late) < COUNTED * jitter and not (at_once and shift > MANY):
            return None
        return self._believed(n, unit, self._late, jitter)

    def _new_loss(self, late_frames: float) -> bool:
        """Whether a late frame among the first has stayed late: their rate and their jitter are not known yet."""
        self._sum += late_frames
        if not self._stayed and self._frames > NEW_FRAMES:
            return False
        self._stayed.append(self._sum - median(self._newest))
        if self._stayed[-1] < LATE or (len(self._stayed) == STAYED and median(self._stayed) < NEW_SHIFT):
            self._newest.append(self._sum)
            self._stayed.clear()
        return len(self._stayed) == STAYED

    def _too_early(self, stamp_ns: int, height: float) -> int:
        """A frame far too early: what was late before it was no loss, or the device's clock was set."""
        self._late.append(height)
        self._came_back(stamp_ns)
        self._usual_level = self._level
        return 0

    def _came_back(self, stamp_ns: int) -> None:
        if self._late:
            self._heights.add(stamp_ns, max(self._late) - SHIFT)
            self._sums.add(stamp_ns, sum(min(late - SHIFT, VOTE) for late in self._late if late > SHIFT))
        self.evidence = 0.0
        self._late.clear()

    def _believed(self, n: int, unit: int, late: list[float], jitter: float) -> int:
        """Return the loss that the evidence is of; less rather than more, as what is left tells again."""
        samples = unit * max(1, round((median(late) - jitter / len(late)) * n / unit))
        self._level -= samples
        self.evidence = 0.0
        self._late.clear()
        self._stayed.clear()
        self._newest = deque([self._sum], STAYED)
        return samples


class _Largest:
    """The largest of the values since a moment."""

    def __init__(self) -> None:
        self._falling: deque[tuple[int, float]] = deque()  # each with its stamp; none after it is larger

    def add(self, stamp_ns: int, value: float) -> None:
        """Take a value in."""
        while self._falling and self._falling[-1][1] <= value:
            self._falling.pop()
        self._falling.append((stamp_ns, value))

    def since(self, stamp_ns: float) -> float:
        """Return the largest, 0 where there is none; older ones are forgotten."""
        while self._falling and self._falling[0][0] < stamp_ns:
            self._falling.popleft()
        return self._falling[0][1] if self._falling else 0.0
