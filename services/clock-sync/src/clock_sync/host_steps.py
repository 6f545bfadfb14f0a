"""What a host says of its own clock: accounts of CLOCK_REALTIME - CLOCK_MONOTONIC, and steps they tell of.

An account may be wrong: a process kept waiting between its two readings, a host that slept (its monotonic clock stood
still, its wall clock did not). So the packets have the last word.
"""

from __future__ import annotations

import math
from collections import deque

from clock_sync.epoch import CONFIRM_PACKETS, CONFIRM_S, Epoch

SECOND_NS = 1_000_000_000
STEP_NS, SURE_STEP_NS = 2_000_000, 50_000_000  # steps between the two must be told twice
FOR_IT_PACKETS = 3  # so many that speak for a step, and it is no longer disputed
SMALL_CONFIRM_S = 60.0  # for steps within the usual scatter of the delays: packets and polling beat slowly
MOST_HIGH = 50_000  # packets near the upper line, the newest; 800 a second for SMALL_CONFIRM_S


class Accounts:
    """What the host has told of its clock: the account that the clock's line rests on, and one that may be false."""

    def __init__(self) -> None:
        self.newest_ns: int | None = None
        self._doubtful_ns: int | None = None
        self._denied_ns: int | None = None  # the packets have shown that between this one and the newest was no step

    def tells_step(self, account_ns: int) -> bool:
        """Take an account in; True where it tells of a step, which is then due to be `followed`."""
        if abs(self.step_ns(account_ns)) <= STEP_NS:
            self.follow(account_ns)
            return False
        doubt, self._doubtful_ns = self._doubtful_ns, account_ns
        if abs(self.step_ns(account_ns)) > SURE_STEP_NS:
            return True
        return doubt is not None and abs(account_ns - doubt) < STEP_NS

    def step_ns(self, account_ns: int) -> int:
        """By how much the clock was stepped, as this account says; 0 before the first one."""
        if self.newest_ns is None or (self._denied_ns is not None and abs(account_ns - self._denied_ns) <= STEP_NS):
            return 0
        return account_ns - self.newest_ns

    def follow(self, account_ns: int) -> None:
        """From now on the line rests on this account; the next ones are compared with it."""
        if self._denied_ns is not None and abs(account_ns - self._denied_ns) <= STEP_NS:
            self._denied_ns = self.newest_ns
        self.newest_ns, self._doubtful_ns = account_ns, None

    def deny(self, before_ns: int | None) -> None:
        """Between this account and the newest the packets show no step: either may be told next, none is new."""
        self._denied_ns = before_ns


class HostStep:
    """A step of the host's clock that it told of, until the packets have shown whether it was one.

    Of two lines, as far apart as the step, the packets lie above one. A packet near the lower one, stamped since, says
    that this one is right; only one still on its way when the step was told does not. Nothing near the lower one for
    long, and packets near the upper one all the while, says that the upper one is right; a queue says nothing.
    before: the line as it was.
    """

    def __init__(self, step_s: float, before: Epoch) -> None:
        self.step_s, self._before = step_s, before
        self.shown = self.refuted = False
        self._first_low_ns: int | None = None
        self._for_it = 0
        self._high: deque[tuple[int, float]] = deque(maxlen=MOST_HIGH)  # device time, and height above the upper line

    @property
    def disputed(self) -> bool:
        """True while the packets speak against the step, or not yet for it."""
        return not self.shown and self._for_it < FOR_IT_PACKETS

    def sets_aside(self, device_ns: int, received_ns: int) -> bool:
        """Look at a packet; True where it seems to have been stamped before the step, and is not to be used."""
        above_s = self._before.above_s(device_ns, received_ns) - max(self.step_s, 0.0)
        half_s, usual_s = abs(self.step_s) / 2, self._before.gate_s(device_ns)
        if above_s < -half_s:
            return above_s > -3 * half_s and self._low(device_ns)
        if abs(above_s) < usual_s < half_s and self.step_s > 0:
            self._for_it += 1
        long_s = CONFIRM_S if self._before.envelope.usual_delay_s < half_s else SMALL_CONFIRM_S
        return self._upper(device_ns, above_s, min(usual_s, half_s), long_s)

    def _low(self, device_ns: int) -> bool:
        self._high.clear()
        if self.step_s < 0:
            self.shown = True
            return False
        if self._first_low_ns is None:
            self._first_low_ns = device_ns
        self._for_it = 0
        self.refuted = device_ns - self._first_low_ns >= CONFIRM_S * SECOND_NS
        return True

    def _upper(self, device_ns: int, above_s: float, near_s: float, long_s: float) -> bool:
        """Weigh a packet that is not near the lower line."""
        self._high.append((device_ns, above_s))
        begun_ns, enough = self._high[0][0], len(self._high) >= CONFIRM_PACKETS
        if device_ns - begun_ns < long_s * SECOND_NS or not enough:
            return self.step_s < 0
        while device_ns - self._high[1][0] >= long_s * SECOND_NS:
            self._high.popleft()
        middle_ns = device_ns - long_s * SECOND_NS / 2
        early_s = min(above for at_ns, above in self._high if at_ns <= middle_ns)
        late_s = min((above for at_ns, above in self._high if at_ns > middle_ns), default=math.inf)
        if max(early_s, late_s) < near_s:
            self.shown, self.refuted = self.step_s > 0, self.step_s < 0
        return False
