"""Turns one node: waits for what comes, takes all of it, hands it over.

rclpy's own executors were measured and left (docs/decisions/own-executor.md): SingleThreadedExecutor gathers every
entity of the node anew, three times per message, so a message costs the more the more topics there are.
"""

import time
from collections import deque
from collections.abc import Callable, Collection, Coroutine
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
from rclpy.node import Node
from rclpy.subscription import Subscription

from sense4hri.graph_guard import GraphGuard
from sense4hri.pace import Pace

SHARE, PAUSE_S, LONGEST_PAUSE_S = 0.03, 0.004, 0.025
"""After a turn it rests, and what comes meanwhile is taken together in the next one; see `Pace`."""
SELDOM_S = 0.05
"""It does not rest after a turn that was waited for so long: little comes."""
MOST_AT_ONCE, TURN_S = 50, 0.02
"""A turn takes at most so many messages of a topic, and ends after so long: who asks whether the thread still turns is
answered on a machine that is too busy too, and what begins to come meanwhile waits for no longer. A session is
announced 1 s before it begins, which is 50 ms where it is replayed at 20x: samples must not overtake that."""
EVENTS_S = 1.0
"""How often the middleware's events are looked at: a publisher's or subscriber's quality of service does not fit."""
SECOND_NS = 1_000_000_000
Take = Callable[[], bool]
"""take() hands over one message, request or response; False where none is left."""


class Executor:
    """Spins one node from `spin` to `shutdown`, on the thread that calls `spin`; the rest is for any thread.

    It waits for subscriptions, services and clients. A subscription's callback gets the message, and its info where it
    takes two. Where a service's callback returns a `concurrent.futures.Future`, the answer is sent once it is there,
    and others are heard meanwhile. `spin` raises what a callback raises. on_unreadable(name, sentence): what came on a
    topic or ROS service cannot be turned into Python; it is left out. on_graph(): somebody began or ended to publish,
    to subscribe or to serve, or is only now known by name; told every graph_every_s at the most.
    """

    graph_every_s = 0.2
    """May be set from any thread."""

    def __init__(
        self, node: Node, on_unreadable: Callable[[str, str], None], on_graph: Callable[[], None] = lambda: None
    ) -> None:
        self._node, self._context = node, node.context
        self._on_unreadable, self._on_graph = on_unreadable, on_graph
        self._guard = GuardCondition(None, None, context=self._context)
        self._tasks: deque[Callable[[], object]] = deque()
        self._stopped, self._changed = False, True
        self._held = ExitStack()  # keeps what is waited for from being destroyed meanwhile
        self._wait_set: Any = None
        self._waited: list[_Kind] = []
        self._patience: WeakKeyDictionary[Subscription, float] = WeakKeyDictionary()
        self._patient: list[_Patient] = []
        self._waited_s = self._events_at_s = self._graph_at_s = 0.0

    def add_node(self, node: Node) -> None:
        """Called by rclpy where this is made the node's executor."""

    def remove_node(self, node: Node) -> None:
        """Called by rclpy where another one is."""

    def wake(self) -> None:
        """Look at what the node has; called by rclpy where something was created or destroyed."""
        self._changed = True
        self._trigger()

    def create_task(self, function: Callable[..., object], *args: Any) -> None:
        """Have function(*args) called when its turn comes."""
        self._tasks.append(partial(function, *args))
        self._trigger()

    def delay(self, subscription: Subscription, within_s: float) -> None:
        """Take what comes of this one so much later at the most, together with what else has come by then."""
        self._patience[subscription] = within_s
        self.wake()

    def shutdown(self) -> None:
        """End `spin`."""
        self._stopped = True
        self._trigger()

    def spin(self) -> None:
        """Turn until shutdown."""
        pace = Pace(SHARE, PAUSE_S, LONGEST_PAUSE_S)
        try:
            while not self._stopped and self._context.ok():
                pace.begin()
                left = self._turn()
                if not left and self._waited_s < SELDOM_S:
                    time.sleep(pace.rest_s())
        finally:
            self._held.close()
            self._guard.destroy()

    def _trigger(self) -> None:
        with suppress(InvalidHandle):  # the thread has ended
            self._guard.trigger()

    def _turn(self) -> bool:
        """Wait for what comes and hand it over, a message of each topic in turn; True where more is left."""
        if self._changed:
            self._changed = False
            self._gather()
        ready = self._ready()
        ends_s = time.monotonic() + TURN_S
        for _ in range(MOST_AT_ONCE):
            ready = [take for take in ready if take()]
            if not ready or time.monotonic() > ends_s:
                break
        for _ in range(len(self._tasks)):
            self._tasks.popleft()()
        if time.monotonic() >= self._events_at_s:
            self._events_at_s = time.monotonic() + EVENTS_S
            self._take_events()
        return bool(ready)

    def _gather(self) -> None:
        """Take note of what the node has now; what was destroyed meanwhile goes."""
        self._held.close()
        node = self._node
        if any(node.timers) or any(node.guards):
            raise RuntimeError(f"{node.get_name()} has a timer or a guard condition, which nobody looks after")
        mine = [one for one in node.subscriptions if one.callback_group.can_execute(one)]
        messages = self._hold(mine, self._take_message)
        self._patient = [_Patient(one, self._patience[one.entity]) for one in messages if one.entity in self._patience]
        responses = self._hold(list(node.clients), self._take_response)
        requests = self._hold(list(node.services), self._take_request)
        self._held.enter_context(node.handle)
        self._graph = GraphGuard(node.handle)
        counts = len(messages), 2, 0, len(responses), len(requests), 0
        self._wait_set = rcl.WaitSet(*counts, self._context.handle)
        self._held.enter_context(self._wait_set)
        self._waited = [
            _Kind("subscription", messages, self._wait_set.add_subscription, self._patient),
            _Kind("client", responses, self._wait_set.add_client),
            _Kind("service", requests, self._wait_set.add_service),
        ]
        self._forget()

    def _forget(self) -> None:
        """Drop what rclpy keeps in the node's callback group of all that has ever been: weak references, now dead.

        Other threads add to the group meanwhile: only a copy is looked through.
        """
        kept = self._node.default_callback_group.entities
        kept.difference_update([one for one in kept.copy() if one() is None])

    def _hold(self, entities: list[Any], take: Callable[[Any], bool]) -> list["_Held"]:
        """Return those that are not destroyed, each with how something of it is taken."""
        held: list[_Held] = []
        for entity in entities:
            with suppress(InvalidHandle):
                self._held.enter_context(entity.handle)
                held.append(_Held(entity, entity.handle, partial(take, entity)))
        return held

    def _ready(self) -> list[Take]:
        """Wait until something has come, at most EVENTS_S."""
        begun_s = now_s = time.monotonic()
        while True:
            wait_s = self._fill(now_s)
            self._wait_set.wait(0 if self._tasks else round(wait_s * SECOND_NS))
            ready = [(kind, one) for kind in self._waited for one in self._wait_set.get_ready_entities(kind.name)]
            guards, now_s = self._wait_set.get_ready_entities("guard_condition"), time.monotonic()
            if ready or guards or wait_s == EVENTS_S or self._tasks:
                break
        self._waited_s = now_s - begun_s
        if self._graph.pointer in guards:
            self._graph_at_s = now_s + self.graph_every_s
            self._on_graph()
        return [kind.takes[one] for kind, one in ready]

    def _fill(self, now_s: float) -> float:
        """Fill the wait set; return for how long, in s, before something else is to be waited for too."""
        self._wait_set.clear_entities()
        for kind in self._waited:
            for handle in kind.handles:
                kind.add(handle)
        self._wait_set.add_guard_condition(self._guard.handle)
        wait_s = EVENTS_S
        if self._graph_at_s <= now_s:
            self._graph.add_to(self._wait_set)
        else:
            wait_s = self._graph_at_s - now_s
        for one in self._patient:
            if one.due_s <= now_s:
                self._wait_set.add_subscription(one.held.handle)
            else:
                wait_s = min(wait_s, one.due_s - now_s)
        return wait_s

    def _take_message(self, subscription: Subscription) -> bool:
        handle, kind, raw = subscription.handle, subscription.msg_type, subscription.raw
        taken = self._taken(subscription.topic, lambda: handle.take_message(kind, raw))
        if taken:
            message, info = taken
            alone = subscription._callback_type is Subscription.CallbackType.MessageOnly  # rclpy's own, of /clock
            subscription.callback(message) if alone else subscription.callback(message, info)
        return taken is not None

    def _take_response(self, client: Any) -> bool:
        taken = self._taken(client.srv_name, lambda: client.handle.take_response(client.srv_type.Response))
        if taken:
            header, response = taken
            if header is None:
                return False
            try:
                asked = client.get_pending_request(header.request_id.sequence_number)
            except KeyError:  # nobody waits for it any more
                return True
            asked.set_result(response)
        return taken is not None

    def _take_request(self, service: Any) -> bool:
        taken = self._taken(service.srv_name, lambda: service.handle.service_take_request(service.srv_type.Request))
        if taken:
            request, header = taken
            if header is None:
                return False
            self._answer(service, header, service.callback(request, service.srv_type.Response()))
        return taken is not None

    def _answer(self, service: Any, header: Any, response: Any) -> None:
        if isinstance(response, Future):
            send = partial(self._answer, service, header)
            response.add_done_callback(lambda done: self.create_task(lambda: send(done.result())))
        else:
            with suppress(InvalidHandle):  # the service has ended meanwhile
                service.send_response(response, header)

    def _taken(self, name: str, take: Callable[[], Any]) -> Any:
        """Return what take() returns; an empty tuple where what came cannot be read."""
        try:
            return take()
        except (RuntimeError, ValueError, OverflowError, SystemError) as err:
            self._on_unreadable(name, f"it cannot be read: {err}")
            return ()

    def _take_events(self) -> None:
        """Hand over what the middleware tells of the node's publishers and subscriptions."""
        with ExitStack() as held:
            events = []
            for event in self._node.waitables:
                with suppress(InvalidHandle):
                    held.enter_context(event)
                    events.append(event)
            if not events:
                return
            number = sum(event.get_num_entities().num_events for event in events)
            wait_set = rcl.WaitSet(0, 0, 0, 0, 0, number, self._context.handle)
            held.enter_context(wait_set)
            wait_set.clear_entities()
            waited = [event for event in events if _add(event, wait_set)]
            wait_set.wait(0)
            for event in [event for event in waited if event.is_ready(wait_set)]:
                _run(event.execute(_told(event)))


def _add(event: Any, wait_set: Any) -> bool:
    """Wait for an event; False where its publisher or subscription has begun to be destroyed on another thread."""
    try:
        event.add_to_wait_set(wait_set)
    except InvalidHandle:
        return False
    return True


def _told(event: Any) -> Any:
    """Return what the middleware tells with an event; None where what it is of has begun to be destroyed."""
    with suppress(InvalidHandle):
        return event.take_data()
    return None


class _Held(NamedTuple):
    """A subscription, client or service of the node, kept from being destroyed."""

    entity: Any
    handle: Any
    take: Take


@dataclass
class _Patient:
    """A subscription that may wait. due_s: when it is waited for again, on the monotonic clock."""

    held: _Held
    within_s: float
    due_s: float = 0.0

    def take(self) -> bool:
        """Once nothing is left, let what comes next wait. All that may wait for as long wait for the same time."""
        taken = self.held.take()
        if not taken:
            self.due_s = (time.monotonic() // self.within_s + 1) * self.within_s
        return taken


class _Kind:
    """Subscriptions, clients or services: how they are put into a wait set, and by pointer how one is taken from.

    handles: those that are always waited for, all but the patient ones.
    """

    def __init__(
        self, name: str, held: list[_Held], add: Callable[[Any], object], patient: Collection[_Patient] = ()
    ) -> None:
        self.name, self.add = name, add
        waiting = {one.held.handle.pointer: one.take for one in patient}
        self.handles = [one.handle for one in held if one.handle.pointer not in waiting]
        self.takes = {one.handle.pointer: one.take for one in held} | waiting


def _run(coroutine: Coroutine[Any, Any, None]) -> None:
    """Run a coroutine of rclpy's that waits for nothing."""
    with suppress(StopIteration):
        coroutine.send(None)
