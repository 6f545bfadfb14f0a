"""Following the graph: hearing topics for as long as somebody publishes them, asking nodes for their parameters."""

import asyncio
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.exceptions import NameValidationException
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from sense4hri import qos
from sense4hri.crowd import TOO_MANY
from sense4hri.errors import Refused
from sense4hri.message_types import message_class, type_name
from sense4hri.parameter_value import plain_value
from sense4hri.service import Service
from sense4hri.topics import Topic

PARAMETERS_TIMEOUT_S = 5.0
MOST_PARAMETERS, LONGEST_NAME = 1000, 256
DEPTH = 100
Subscribe = Callable[[Topic, type, Callable[..., None], QoSProfile], Subscription]
"""See `by` of `follow`."""


@dataclass
class _Heard:
    """One topic that is subscribed to."""

    topic: Topic
    kind: type
    profile: QoSProfile
    subscription: Subscription | None = None


@dataclass(frozen=True)
class _Told:
    """Who is told what; see `follow`."""

    on_message: Callable[..., None]
    on_gone: Callable[[Topic], None]
    on_publishers: Callable[[Topic, QoSProfile], None]
    on_refused: Callable[[Topic, str], None]


@dataclass(frozen=True)
class _How:
    """How topics are heard; see `follow`."""

    exclude: Iterable[str]
    types: Collection[type] | None
    profile: QoSProfile | None
    depth: int
    raw: bool
    with_info: bool
    by: Subscribe | None
    hold: bool


class Follower:
    """Subscriptions to every topic that matches; see `follow`."""

    def __init__(self, service: Service[Any], globs: Iterable[str], told: _Told, how: _How) -> None:
        self._service, self._told, self._how = service, told, how
        self._heard: dict[tuple[str, str], _Heard] = {}
        self._refused: dict[tuple[str, str], str] = {}
        self._kinds = None if how.types is None else {type_name(kind): kind for kind in how.types}
        self._watch = service.watch(globs, self._changed, self._kinds, how.exclude)

    @property
    def topics(self) -> list[Topic]:
        """What is being heard now."""
        return [heard.topic for heard in self._heard.values()]

    def subscription(self, name: str, type_name: str) -> Subscription | None:
        """Return the subscription to a topic; None where it is not being heard."""
        heard = self._heard.get((name, type_name))
        return heard.subscription if heard is not None else None

    def release(self, name: str, type_name: str) -> None:
        """End a subscription that outlasts its last publisher; the next publisher is found anew."""
        heard = self._heard.get((name, type_name))
        if heard is not None and not heard.topic.publishers:
            self._unsubscribe(self._heard.pop((name, type_name)))

    def close(self) -> None:
        """Follow no more; nothing more is told."""
        self._service.graph.unwatch(self._watch)
        for key in list(self._heard):
            self._unsubscribe(self._heard.pop(key))

    def _changed(self, topic: Topic) -> None:
        key = topic.name, topic.type_name
        if not topic.publishers:
            self._gone(topic)
        elif key in self._heard:
            self._heed(self._heard[key], topic)
        elif key not in self._refused or (self._refused[key] == TOO_MANY and not topic.excess):
            self._found(topic)

    def _found(self, topic: Topic) -> None:
        key = topic.name, topic.type_name
        profile = self._fitting(topic, None)
        try:
            kind = self._kind(topic)
            self._told.on_publishers(topic, profile)
        except Refused as err:
            self._refused[key] = str(err)
            self._told.on_refused(topic, str(err))
            return
        self._refused.pop(key, None)
        self._heard[key] = _Heard(topic, kind, profile)
        self._heard[key].subscription = self._subscribe(self._heard[key])

    def _kind(self, topic: Topic) -> type:
        if topic.excess:
            raise Refused(TOO_MANY)
        kind = message_class(topic.type_name) if self._kinds is None else self._kinds[topic.type_name]
        if kind is None:
            raise Refused(f"its type {topic.type_name} is not installed here")
        return kind

    def _heed(self, heard: _Heard, topic: Topic) -> None:
        """Take note of other publishers; subscribe afresh where the old subscription would not hear all of them."""
        profile = self._fitting(topic, heard)
        heard.topic = topic
        self._told.on_publishers(topic, profile)
        if profile != heard.profile:
            self._unsubscribe(heard)
            heard.profile = profile
            heard.subscription = self._subscribe(heard)

    def _gone(self, topic: Topic) -> None:
        key = topic.name, topic.type_name
        self._refused.pop(key, None)
        heard = self._heard.get(key)
        if heard is not None:
            heard.topic = topic
            if not self._how.hold:
                self._unsubscribe(self._heard.pop(key))
        self._told.on_gone(topic)

    def _fitting(self, topic: Topic, heard: _Heard | None) -> QoSProfile:
        """Return what to ask for: what all publishers offer; never more than before while one of the old ones stays."""
        offers = [publisher.qos_profile for publisher in topic.publishers]
        if self._how.profile is not None:
            return qos.fitting(self._how.profile, offers)
        if heard is not None and heard.topic.instances & topic.instances:
            offers.append(heard.profile)
        return qos.adapt(offers, self._how.depth)

    def _subscribe(self, heard: _Heard) -> Subscription:
        def take(*message: Any) -> None:
            self._told.on_message(heard.topic, *message)

        how, name = self._how, heard.topic.name
        if how.by is None:
            return self._service.subscribe(heard.kind, name, take, heard.profile, raw=how.raw, with_info=how.with_info)

        return how.by(heard.topic, heard.kind, take, heard.profile)

    def _unsubscribe(self, heard: _Heard) -> None:
        if heard.subscription is not None:
            self._service.unsubscribe(heard.subscription)
            heard.subscription = None


def follow(
    service: Service[Any],
    globs: Iterable[str],
    on_message: Callable[..., None],
    on_gone: Callable[[Topic], None] = lambda topic: None,
    *,
    on_publishers: Callable[[Topic, QoSProfile], None] = lambda topic, profile: None,
    on_refused: Callable[[Topic, str], None] = lambda topic, why: None,
    exclude: Iterable[str] = (),
    types: Collection[type] | None = None,
    profile: QoSProfile | None = None,
    depth: int = DEPTH,
    raw: bool = False,
    with_info: bool = False,
    by: Subscribe | None = None,
    hold: bool = False,
) -> Follower:
    """Hear every topic that matches one of the globs and none of exclude, for as long as somebody publishes on it.

    Globs are as in `Patterns`.

    on_message(topic, message) is called on the main thread; on_gone(topic) when the last publisher is gone, and no
    message of it comes after that. on_publishers(topic, profile) is called before the first message, and again
    whenever the publishers have changed; the first time it may raise Refused. on_refused(topic, why) is called once
    for a topic that cannot be heard; on_gone is told of it too.

    types: message classes that count, None = whatever is installed. profile: for topics of the contract, best effort
    where nobody publishes reliably; without one the subscription asks for what is offered, with a queue of depth. raw:
    messages are CDR bytes. with_info: on_message(topic, message, info) with rclpy's dict of times (ns). by: makes the
    subscriptions, as by(topic, message class, take, profile), and has take called with every message on whatever
    thread it likes. hold: the subscription outlasts its last publisher, so that the next one is heard from its first
    message, until `Follower.release`.
    """
    told = _Told(on_message, on_gone, on_publishers, on_refused)
    how = _How(exclude, types, profile, depth, raw, with_info, by, hold)
    return Follower(service, globs, told, how)


async def ask(service: Service[Any], kind: type, name: str, request: Any, timeout_s: float) -> Any:
    """Return the response of somebody's ROS service. Raises TimeoutError, also where nobody serves it, or can."""
    try:
        client = service.node.create_client(kind, name)
    except NameValidationException as err:  # another DDS program may call its node anything
        raise TimeoutError(f"{name} is no name of a ROS service") from err
    try:
        return await service.call(client, request, timeout_s)
    finally:
        service.node.destroy_client(client)


async def ask_parameters(
    service: Service[Any], node: str, names: Iterable[str] | None = None, timeout_s: float = PARAMETERS_TIMEOUT_S
) -> dict[str, Any]:
    """Return a node's parameters as plain Python values: bool, int, float, str or a list of these.

    node: its full name. names: those to ask for, None = all it has. One that the node lacks or that is not set is left
    out, and so is, counted and said once, what no parameter can be. Raises TimeoutError where the node has not answered
    within timeout_s in all.
    """
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + timeout_s

    async def told(kind: Any, service_name: str, **fields: Any) -> Any:
        left_s = deadline_s - loop.time()
        return await ask(service, kind, f"{node}/{service_name}", kind.Request(**fields), left_s)

    def refuse(why: str) -> None:
        service.refuse(f"{node}/get_parameters", "parameters", why)

    def read(key: str, value: ParameterValue) -> Any:
        try:
            return plain_value(value)
        except Refused as err:
            return refuse(f"its parameter {key!r} {err}")

    async def values(asked: list[str]) -> dict[str, Any]:
        answer = (await told(GetParameters, "get_parameters", names=asked)).values
        if len(answer) == len(asked):
            return {key: read(key, value) for key, value in zip(asked, answer, strict=True)}
        if len(asked) < 2:
            return {}
        # a node that lacks one of them answers for none: ask for each
        return {key: value for one in asked for key, value in (await values([one])).items()}

    asked = list(names) if names is not None else (await told(ListParameters, "list_parameters")).result.names
    usable = [name for name in asked[:MOST_PARAMETERS] if len(name) <= LONGEST_NAME]
    if len(usable) < len(asked):
        refuse(f"it has {len(asked)} parameters, {len(usable)} of them are looked at")
    return {key: value for key, value in (await values(usable)).items() if value is not None}
