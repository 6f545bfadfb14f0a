"""Which topics are published and by whom: one look at the graph for everybody in a service who wants to know. Pure."""

import asyncio
import math
import re
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NamedTuple, Protocol

from sense4hri.crowd import Crowd
from sense4hri.pace import Pace
from sense4hri.patterns import Patterns

SHORTEST_S, RECHECK_S = 0.02, 0.5
UNTOLD_S = 2.0  # after so long it is looked at all the same, should the middleware ever not tell of a change
TURN_S = 0.1
"""For so long at once `Graph.keep_looking` keeps the main thread from everything else."""
SHARE, LONGEST_S = 0.01, 2.0  # of a core, for the names and for the publishers each, however many topics there are
_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")  # DDS itself allows more, rclpy raises where it is asked for that
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # so DDS says until a publisher's participant has said its name
BEST_EFFORT = "best effort: what gets lost on the way is not sent again; publish it reliable"
"""What is told of a raw topic that is `best_effort`."""


class GraphNode(Protocol):
    """What is asked of rclpy's Node."""

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]: ...
    def get_publishers_info_by_topic(self, topic_name: str) -> list[Any]: ...


class Topic(NamedTuple):
    """One topic of one type. publishers: rclpy's TopicEndpointInfo of each; empty when the last one is gone.

    excess: True where they have more topics of this field than a driver has, see `crowd`; nobody then reads this one.
    one_of_many: True where they have more than a device has, though not too many; of a silent one nothing is made.
    """

    name: str
    type_name: str
    publishers: tuple[Any, ...]
    excess: bool = False
    one_of_many: bool = False

    @property
    def instances(self) -> frozenset[bytes]:
        """The ids of its publishers: a node that was restarted has other ones."""
        return frozenset(bytes(publisher.endpoint_gid) for publisher in self.publishers)

    @property
    def told_of(self) -> tuple[frozenset[bytes], bool, bool]:
        """What watchers are told of when it changes."""
        return self.instances, self.excess, self.one_of_many

    @property
    def best_effort(self) -> bool:
        """True where one of its publishers does not send again what got lost on the way."""
        return any(publisher.qos_profile.reliability.name == "BEST_EFFORT" for publisher in self.publishers)


Changed = Callable[[Topic], None]


class Watch:
    """What one watcher knows of the graph; see `Graph.watch`."""

    def __init__(
        self, globs: Iterable[str], exclude: Iterable[str], types: Collection[str] | None, changed: Changed
    ) -> None:
        self._wanted, self._excluded, self._types, self._changed = Patterns(globs), Patterns(exclude), types, changed
        self.topics: dict[tuple[str, str], Topic] = {}
        """What is published now, by name and type."""

    def wants(self, name: str) -> bool:
        """True where a topic of this name is watched."""
        return self._wanted.match(name) and not self._excluded.match(name)

    def take(self, name: str, published: Mapping[str, Topic]) -> None:
        """Take note of who publishes a topic now, by type; tell what is new of it."""
        for key in [key for key in self.topics if key[0] == name and key[1] not in published]:
            self._changed(self.topics.pop(key)._replace(publishers=()))
        for type_name, topic in published.items():
            if self._types is not None and type_name not in self._types:
                continue
            known, self.topics[name, type_name] = self.topics.get((name, type_name)), topic
            if known is None or known.told_of != topic.told_of:
                self._changed(topic)


class Graph:
    """Looks at the graph for all watchers of a service together, whenever it is told that it has `changed`.

    Two looks are at least SHORTEST_S apart; for known topics whose publishers may be others, RECHECK_S. On a graph so
    large that either would take more than SHARE of a core it is looked at less often, LONGEST_S apart at the most.
    """

    def __init__(self, node: GraphNode) -> None:
        self._node = node
        self._watches: list[Watch] = []
        self._seen: list[tuple[str, list[str]]] = []  # what the node said last
        self._watchers: dict[str, tuple[Watch, ...]] = {}  # of every topic on the graph
        self._published: set[str] = set()
        self._settled: set[str] = set()  # published, and the name of every publisher is known
        self._crowd = Crowd()
        self._present: list[str] = []  # watched, and on the graph
        self._left: deque[str] = deque()  # whose publishers are still to be asked for in this round
        self._news, self._stale = asyncio.Event(), True  # since the last look; since the last recheck
        self._recheck_at_s = 0.0
        self._looks, self._rechecks = Pace(SHARE, SHORTEST_S, LONGEST_S), Pace(SHARE, RECHECK_S, LONGEST_S)
        self._rest_s = SHORTEST_S

    def changed(self) -> None:
        """Something on the graph has changed: have a look."""
        self._stale = True
        self._news.set()

    def watch(
        self,
        globs: Iterable[str],
        changed: Changed,
        types: Collection[str] | None = None,
        exclude: Iterable[str] = (),
    ) -> Watch:
        """Have changed(topic) called whenever the publishers of a topic change: they come, are others, or are gone.

        globs, exclude: as in `Patterns`. types: names of the types that count (`sense4hri_msgs/msg/ECG`), None = any.
        """
        watch = Watch(globs, exclude, types, changed)
        self._watches.append(watch)
        self._begin_anew()
        return watch

    def unwatch(self, watch: Watch) -> None:
        """Tell this watcher no more."""
        if watch in self._watches:
            self._watches.remove(watch)
            self._begin_anew()

    def look(self) -> None:
        """Look at the graph once, and tell every watcher what has changed for it."""
        self._stale = True
        self._begin()
        self._ask(math.inf)

    async def keep_looking(self) -> None:
        """Look whenever something has changed, TURN_S at a time: a watcher may do much about each new topic."""
        while True:
            self._begin()
            while self._ask(TURN_S):
                await asyncio.sleep(0)
            await asyncio.sleep(self._rest_s)
            await self._wait()

    async def _wait(self) -> None:
        """Until something has changed, or a recheck is due that came too soon after the one before."""
        due_s = max(self._recheck_at_s - time.monotonic(), 0.0) if self._stale else UNTOLD_S
        try:
            async with asyncio.timeout(due_s):
                await self._news.wait()
        except TimeoutError:
            self._stale = True

    def _begin(self) -> None:
        """Ask which topics there are, and note those whose publishers are to be asked for."""
        self._looks.begin()
        self._news.clear()
        seen = self._node.get_topic_names_and_types()
        self._rest_s = self._looks.rest_s()
        recheck = self._stale and time.monotonic() >= self._recheck_at_s
        if not recheck and seen == self._seen:
            self._left.extend(name for name in self._present if name not in self._settled)
            return
        self._seen = seen
        if recheck:
            self._recheck_at_s, self._stale = math.inf, False  # until the round is over, or a watcher comes or goes
        self._rechecks.begin()
        names = {name for name, _ in seen if _NAME.fullmatch(name)}
        known = self._watchers
        self._watchers = {
            name: known[name] if name in known else self._who_wants(name) for name in names | self._published
        }
        watched = sorted(name for name, watchers in self._watchers.items() if watchers)
        self._present = [name for name in watched if name in names]
        self._left.extend(name for name in watched if recheck or name not in self._settled or name not in names)
        self._published.intersection_update(watched)
        self._settled.intersection_update(self._present)
        self._crowd.keep(watched)
        self._rechecks.pause()

    def _ask(self, seconds: float) -> bool:
        """Ask for publishers and tell what is new of them, for so long; True where some are left."""
        ends_s = time.monotonic() + seconds
        self._rechecks.go_on()
        while self._left:
            name = self._left.popleft()
            self._tell(name, self._node.get_publishers_info_by_topic(name))
            if self._left and time.monotonic() >= ends_s:
                self._rechecks.pause()
                return True
        if self._recheck_at_s == math.inf:
            self._recheck_at_s = time.monotonic() + self._rechecks.rest_s()
        return False

    def _tell(self, name: str, publishers: Iterable[Any]) -> None:
        publishers = list(publishers)
        known = bool(publishers) and all(each.node_name != UNKNOWN_NODE for each in publishers)
        (self._settled.add if known else self._settled.discard)(name)
        excess = self._crowd.is_beyond(name, publishers)
        if excess and not known:
            return  # it may be a replay's, which has no bound
        one_of_many = self._crowd.is_one_of_many(name, publishers)
        topics: dict[str, Topic] = {}
        for publisher in publishers:
            type_name = publisher.topic_type
            others = topics[type_name].publishers if type_name in topics else ()
            topics[type_name] = Topic(name, type_name, (*others, publisher), excess, one_of_many)
        (self._published.add if topics else self._published.discard)(name)
        for watch in self._watchers.get(name, ()):
            watch.take(name, topics)

    def _who_wants(self, name: str) -> tuple[Watch, ...]:
        return tuple(watch for watch in self._watches if watch.wants(name))

    def _begin_anew(self) -> None:
        self._watchers = {}
        self._left.clear()
        self._recheck_at_s = 0.0
        self.changed()
