"""What is noticed of the graph: with a node that only answers what it is asked."""

import asyncio
import math
from types import SimpleNamespace

import pytest
from sense4hri import topics
from sense4hri.topics import Graph


class Node:
    """A graph that a test changes: publishers by topic, as (id, type)."""

    def __init__(self):
        self.published, self.subscribed, self.asked, self.node_name = {}, set(), [], "driver"

    def get_topic_names_and_types(self):
        return [(name, ["t"]) for name in {*self.published, *self.subscribed}]

    def get_publishers_info_by_topic(self, name):
        self.asked.append(name)
        return [
            SimpleNamespace(endpoint_gid=gid, topic_type=kind, node_name=self.node_name)
            for gid, kind in self.published.get(name, [])
        ]


@pytest.fixture(autouse=True)
def always_recheck(monkeypatch):
    """Every look is a thorough one: no test waits."""
    monkeypatch.setattr(topics, "RECHECK_S", 0.0)
    monkeypatch.setattr(topics, "SHARE", math.inf)


@pytest.fixture
def node():
    return Node()


def told_of(graph, *globs, **how):
    """The list in which a watcher notes (name, type, number of publishers)."""
    told = []
    graph.watch(globs, lambda topic: told.append((topic.name, topic.type_name, len(topic.publishers))), **how)
    return told


def test_a_topic_comes_and_goes(node):
    """It is told once when it is published and once when its last publisher is gone, also where a subscriber stays."""
    graph = Graph(node)
    told = told_of(graph, "/a/*")
    node.subscribed = {"/a/x"}
    graph.look()
    assert told == []
    node.published = {"/a/x": [(b"1", "t")], "/b": [(b"2", "t")]}
    graph.look()
    graph.look()
    assert told == [("/a/x", "t", 1)]
    node.published = {}
    graph.look()
    node.subscribed = set()
    graph.look()
    assert told == [("/a/x", "t", 1), ("/a/x", "t", 0)]


def test_a_restarted_publisher_is_another_one(node):
    """Where the publisher of a topic is replaced between two looks, that is told."""
    graph = Graph(node)
    told = told_of(graph, "/a")
    for gid in (b"1", b"2"):
        node.published = {"/a": [(gid, "t")]}
        graph.look()
    assert told == [("/a", "t", 1)] * 2


def test_what_is_known_of_a_publisher_is_kept_up_to_date(node):
    """The name of a node that DDS did not know at first is there as soon as it is known, though nothing is told."""
    graph, told = Graph(node), []
    watch = graph.watch(["/a"], told.append)
    node.published = {"/a": [(b"1", "t")]}
    graph.look()
    first = watch.topics["/a", "t"].publishers[0]
    graph.look()
    assert watch.topics["/a", "t"].publishers[0] is not first
    assert len(told) == 1


def test_types_are_kept_apart(node):
    """A topic with two types is two topics; a watcher of one type hears nothing of the other."""
    graph = Graph(node)
    every, one = told_of(graph, "/a"), told_of(graph, "/a", types=["t"])
    node.published = {"/a": [(b"1", "t"), (b"2", "u"), (b"3", "t")]}
    graph.look()
    assert sorted(every) == [("/a", "t", 2), ("/a", "u", 1)]
    assert one == [("/a", "t", 2)]
    node.published = {"/a": [(b"2", "u")]}
    graph.look()
    assert one[1:] == [("/a", "t", 0)]


def test_what_is_excluded_is_not_told(node):
    """A topic that matches a glob and an exclusion is left out."""
    graph = Graph(node)
    told = told_of(graph, "/**", exclude=["/a/**"])
    node.published = {"/a/x": [(b"1", "t")], "/b": [(b"2", "t")]}
    graph.look()
    assert told == [("/b", "t", 1)]


def test_a_late_watcher_learns_what_is_there(node):
    """Who begins to watch later is told of what others know already, and the others are not told again."""
    graph = Graph(node)
    first = told_of(graph, "/a")
    node.published = {"/a": [(b"1", "t")]}
    graph.look()
    second = told_of(graph, "/a")
    graph.look()
    assert first == second == [("/a", "t", 1)]


def test_who_has_ended_is_told_no_more(node):
    """After unwatch nothing is told, and nothing is asked for its sake."""
    graph, told = Graph(node), []
    watch = graph.watch(["/a"], told.append)
    graph.unwatch(watch)
    node.published = {"/a": [(b"1", "t")]}
    graph.look()
    assert (told, node.asked) == ([], [])


def test_one_look_asks_once_however_many_watch(node, monkeypatch):
    """Ten watchers of a topic cost one question, and between two rechecks a known topic costs none."""
    monkeypatch.setattr(topics, "RECHECK_S", 1000.0)
    graph = Graph(node)
    for _ in range(10):
        told_of(graph, "/a")
    node.published = {"/a": [(b"1", "t")], "/b": [(b"2", "t")]}
    graph.look()
    graph.look()
    graph.look()
    assert node.asked == ["/a"]


def test_a_publisher_without_a_name_is_looked_at_again_at_once(node, monkeypatch):
    """Until DDS knows the name of a topic's node every look asks for it, not only the thorough ones."""
    monkeypatch.setattr(topics, "RECHECK_S", 1000.0)
    graph, told = Graph(node), []
    watch = graph.watch(["/a"], told.append)
    node.published, node.node_name = {"/a": [(b"1", "t")]}, topics.UNKNOWN_NODE
    graph.look()
    node.node_name = "driver"
    graph.look()
    assert watch.topics["/a", "t"].publishers[0].node_name == "driver"
    asked = len(node.asked)
    graph.look()
    assert (len(node.asked), len(told)) == (asked, 1)


def test_a_topic_whose_name_rclpy_would_not_take_is_left_out(node):
    """Another DDS program may use any name: nobody is told of it, and its publishers are not asked for."""
    graph = Graph(node)
    told = told_of(graph, "/**")
    node.published = {name: [(b"1", "t")] for name in ("/1st", "/a b", "/a//b", "/a/", "/ö", "/a\n", "/good")}
    graph.look()
    assert told == [("/good", "t", 1)]
    assert node.asked == ["/good"]


def test_a_large_graph_is_looked_at_less_often(node, monkeypatch):
    """Where the publishers of all topics take 10 ms of CPU to ask for, they are asked for once a second, not twice."""
    monkeypatch.setattr(topics, "RECHECK_S", 0.5)
    monkeypatch.setattr(topics, "SHARE", 0.01)
    now, used = [100.0], [0.0]
    monkeypatch.setattr(topics.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(topics.time, "thread_time", lambda: used[0])
    ask = node.get_publishers_info_by_topic

    def slowly(name):
        used[0] += 0.010
        return ask(name)

    node.get_publishers_info_by_topic = slowly
    node.published = {"/a": [(b"1", "t")]}
    graph = Graph(node)
    told_of(graph, "/a")
    asked_at = []
    for _ in range(400):
        before = len(node.asked)
        graph.look()
        asked_at += [round(now[0] - 100.0, 2)] * (len(node.asked) - before)
        now[0] += 0.01
    assert asked_at == [0.0, 1.0, 2.0, 3.0]


def in_turns(graph, meanwhile):
    """Look at the graph a topic at a time, and call meanwhile() between two turns, until it returns True."""

    async def look_on():
        looking = asyncio.ensure_future(graph.keep_looking())
        async with asyncio.timeout(30.0):
            while not meanwhile():
                await asyncio.sleep(0)
        looking.cancel()

    asyncio.run(look_on())


@pytest.fixture
def short_turns(monkeypatch):
    """A turn ends after one topic, however fast this machine is."""
    monkeypatch.setattr(topics, "TURN_S", 0.0)
    monkeypatch.setattr(topics, "SHORTEST_S", 0.0)


@pytest.mark.usefixtures("short_turns")
def test_others_have_their_turn_while_a_large_graph_is_looked_at(node):
    """What a watcher does about a new topic may take long, on a busy machine above all: others come in between."""
    node.published = {f"/a{number}": [(b"1", "t")] for number in range(20)}
    graph, told_at_once = Graph(node), []
    told = told_of(graph, "/**")

    def meanwhile():
        told_at_once.append(len(told) - sum(told_at_once))
        return len(told) == 20

    in_turns(graph, meanwhile)
    assert max(told_at_once) == 1


@pytest.mark.usefixtures("short_turns")
def test_who_begins_to_watch_between_two_turns_learns_everything_once(node):
    """A watcher that comes in the middle of a look is told of each topic once, and the first one is not told again."""
    node.published = {f"/a{number}": [(b"1", "t")] for number in range(5)}
    everything = sorted((name, "t", 1) for name in node.published)
    graph = Graph(node)
    first, second = told_of(graph, "/**"), []

    def meanwhile():
        if len(first) == 2 and not second:
            second.append(told_of(graph, "/**"))
        return second and len(second[0]) >= 5

    in_turns(graph, meanwhile)
    graph.look()
    assert sorted(first) == sorted(second[0]) == everything


@pytest.mark.usefixtures("short_turns")
def test_what_goes_between_two_turns_is_told_gone(node):
    """A topic that goes in the middle of a look, its publishers told already or not, is in the end told as it is."""
    node.published = {f"/a{number}": [(b"1", "t")] for number in range(5)}
    graph, there = Graph(node), {}
    graph.watch(["/**"], lambda topic: there.update({topic.name: len(topic.publishers)}))

    def meanwhile():
        if len(there) == 2:
            node.published = {"/a4": [(b"1", "t")]}
            graph.watch([], there.update)
        return sum(there.values()) == 1 and there.get("/a4") == 1

    in_turns(graph, meanwhile)
    assert {name for name, publishers in there.items() if publishers} == {"/a4"}


@pytest.mark.usefixtures("short_turns")
def test_a_look_between_two_turns_is_a_whole_one(node):
    """Who needs to know now looks at everything, what a turn has left over included."""
    node.published = {f"/a{number}": [(b"1", "t")] for number in range(5)}
    graph = Graph(node)
    told = told_of(graph, "/**")

    def meanwhile():
        if not told:
            return False
        node.published["/b"] = [(b"2", "t")]
        graph.look()
        return True

    in_turns(graph, meanwhile)
    assert sorted(told) == sorted((name, "t", 1) for name in node.published)


def test_a_graph_that_does_not_change_is_left_alone_and_a_change_is_looked_at_at_once(node, monkeypatch):
    """Nothing is asked until something has changed, a known topic that has another publisher as well as a new one."""
    monkeypatch.setattr(topics, "SHORTEST_S", 0.0)
    monkeypatch.setattr(topics, "UNTOLD_S", 3600.0)
    node.published, graph, asked = {"/a": [(b"1", "t")]}, Graph(node), []
    told = told_of(graph, "/**")
    names = node.get_topic_names_and_types
    node.get_topic_names_and_types = lambda: asked.append("") or names()

    async def change_now_and_then():
        looking = asyncio.ensure_future(graph.keep_looking())
        for _ in range(1000):
            await asyncio.sleep(0)
        looks = len(asked)
        node.published = {"/a": [(b"2", "t")], "/b": [(b"3", "t")]}
        graph.changed()
        async with asyncio.timeout(30.0):
            while len(told) < 3:
                await asyncio.sleep(0.001)
        looking.cancel()
        return looks

    assert asyncio.run(change_now_and_then()) == 1
    assert sorted(told) == [("/a", "t", 1), ("/a", "t", 1), ("/b", "t", 1)]


def test_a_change_that_nobody_told_of_is_noticed_all_the_same(node, monkeypatch):
    """Should the middleware keep one to itself, a look comes after UNTOLD_S."""
    monkeypatch.setattr(topics, "UNTOLD_S", 0.05)
    node.published, graph = {"/a": [(b"1", "t")]}, Graph(node)
    told = told_of(graph, "/**")

    async def change_in_silence():
        looking = asyncio.ensure_future(graph.keep_looking())
        async with asyncio.timeout(30.0):
            while len(told) < 2:
                await asyncio.sleep(0.001)
                if told:
                    node.published = {"/a": [(b"2", "t")]}
        looking.cancel()

    asyncio.run(change_in_silence())
    assert told == [("/a", "t", 1), ("/a", "t", 1)]
