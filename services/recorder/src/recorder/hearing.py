"""Takes in what is published, on one thread of its own: however many topics there are, those of the study come first.

rclpy's executor hands over one message of a topic in each of its rounds, and a round costs with every topic there is:
500 silent ones starve all others. Here a round takes everything that has come.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from typing import Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sense4hri.liveness import Pulse
from sense4hri.pace import Pace
from sense4hri.service import Service

from recorder.taken import Take, Taken, taker

WAIT_S = 0.5  # for messages, where nobody has it `look`
PAUSE_S = 0.05  # the rest after a round: a round costs with every topic, whether something came or not
SHARE = 0.5  # of the rest that a round may take, see Pace: at most a third of a core, unless the rest would be
LONGEST_S = 0.5  # longer: in it the queues fill, and a stop waits for its end
MOST_AT_ONCE, MOST_OF_OTHERS = 5000, 200  # messages of a topic in a round: all that its queue holds
CLOSE_S, COUNT_S = 1.0, 2.0  # at the end: to take in what has come, then to count what is beyond that
OTHERS_S = 0.02  # of a round, for what is not the study's own
SETTLE_S = 0.25  # after a stop, in which what was sent before still comes
SECOND_NS = 1_000_000_000


class _Elsewhere(CallbackGroup):
    """Subscriptions that no executor looks after."""

    def add_entity(self, entity: object) -> None:
        pass

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class _Heard(NamedTuple):
    """A subscription, what is done with a message, and whether it comes first."""

    subscription: Subscription
    take: Callable[[Taken], None]
    first: bool


class Hearing:
    """Every subscription of the recorder's topics."""

    def __init__(self, service: Service[Any]) -> None:
        self._node, self._group = service.node, _Elsewhere()
        self._guard = GuardCondition(None, None, context=service.node.context)
        self._heard: tuple[_Heard, ...] = ()
        self._lock = threading.Lock()
        self._stop = False
        self._turn = 0
        self._oldest_ns = 0
        self._waited_s = 0.0  # the study's own messages, before they were taken
        self._taking_since_s: float | None = None  # by no clock that can be set
        self.rounds = 0
        self._pulse = Pulse()
        self._thread = service.thread("hearing", self._hear, self._pulse)

    @property
    def behind_s(self) -> float:
        """How long the study's newest messages waited; in a round at least since it began: they wait for the next."""
        since_s = self._taking_since_s
        return max(self._waited_s, 0.0 if since_s is None else time.monotonic() - since_s)

    def subscribe(
        self, kind: type, name: str, take: Callable[[Taken], None], profile: QoSProfile, first: bool
    ) -> Subscription:
        """Have take(message) called, on the hearing thread, for every message. first: before those of others."""

        def timed(message: Taken) -> None:
            self._oldest_ns = min(self._oldest_ns, message.received_ns or self._oldest_ns)
            take(message)

        subscription = self._node.create_subscription(
            kind, name, _never_called, profile, callback_group=self._group, raw=True
        )
        with self._lock:
            self._heard = (*self._heard, _Heard(subscription, timed if first else take, first))
        self.look()
        return subscription

    def look(self) -> None:
        """Begin the next round without waiting until something comes."""
        self._guard.trigger()

    def close(self, late: Callable[[], None]) -> list[str]:
        """Take in what has come, the study's own first, and hear nothing more.

        late: called where that is too much; what comes after it need only be counted. Returns the topics that had more
        than could be counted.
        """
        self._stop = True
        self.look()
        self._thread.join()
        self._guard.destroy()
        left = _drain(sorted(self._heard, key=lambda one: not one.first), CLOSE_S)
        if left:
            late()
        return [one.subscription.topic_name for one in _drain(left, COUNT_S)]

    def _hear(self) -> None:
        pace = Pace(SHARE, PAUSE_S, LONGEST_S)
        while not self._stop:
            pace.begin()
            self._round()
            self._pulse.beat()
            self.rounds += 1
            time.sleep(pace.rest_s())

    def _round(self) -> None:
        """Wait until something has come and take it."""
        with ExitStack() as held:
            heard = [one for one in self._heard if self._holds(held, one)]
            ready, take = self._ready(held, heard), held.enter_context(taker())
            self._take_all((one for one in ready if one.first), take)
            self._take_some([one for one in ready if not one.first], take)

    def _holds(self, held: ExitStack, one: _Heard) -> bool:
        """Keep a subscription while it is waited for; forget one that was ended."""
        try:
            held.enter_context(one.subscription.handle)
        except InvalidHandle:
            with self._lock:
                self._heard = tuple(other for other in self._heard if other is not one)
            return False
        return True

    def _ready(self, held: ExitStack, heard: list[_Heard]) -> list[_Heard]:
        """Those that have messages."""
        wait_set = rcl.WaitSet(len(heard), 1, 0, 0, 0, 0, self._node.context.handle)
        held.enter_context(wait_set)
        wait_set.clear_entities()
        for one in heard:
            wait_set.add_subscription(one.subscription.handle)
        wait_set.add_guard_condition(self._guard.handle)
        wait_set.wait(round(WAIT_S * SECOND_NS))
        pointers = set(wait_set.get_ready_entities("subscription"))
        return [one for one in heard if one.subscription.handle.pointer in pointers]

    def _take_all(self, ready: Iterable[_Heard], take: Take) -> None:
        self._oldest_ns = now_ns = time.time_ns()
        self._taking_since_s = time.monotonic()
        for one in ready:
            self._pulse.beat()  # on a machine that is too busy a round may take longer than a hang
            _take(one, take, MOST_AT_ONCE)
            self._waited_s = max(self._waited_s, (now_ns - self._oldest_ns) / SECOND_NS)
        self._waited_s, self._taking_since_s = (now_ns - self._oldest_ns) / SECOND_NS, None

    def _take_some(self, ready: list[_Heard], take: Take) -> None:
        """What is left for the next round stays in the middleware, which counts what it cannot keep."""
        ends_s = time.monotonic() + OTHERS_S
        self._turn += 1
        for i in range(len(ready)):
            if time.monotonic() > ends_s:
                return
            _take(ready[(i + self._turn) % len(ready)], take, MOST_OF_OTHERS)


def _never_called(message: object) -> None:
    """No executor looks after the subscriptions."""


def _take(one: _Heard, take: Take, most: int, ends_s: float = math.inf) -> bool:
    """Take at most so many messages, until then; returns True where none are left."""
    for _ in range(most):
        if time.monotonic() > ends_s:
            return False
        message = take(one.subscription.handle.pointer)
        if message is None:
            return True
        one.take(message)
    return False


def _drain(heard: list[_Heard], seconds: float) -> list[_Heard]:
    """Take what has come, for so long; returns those that have more."""
    ends_s, left = time.monotonic() + seconds, []
    for one in heard:
        with suppress(InvalidHandle), one.subscription.handle, taker() as take:
            if not _take(one, take, MOST_AT_ONCE, ends_s):
                left.append(one)
    return left
