"""What is beyond what a process may have is not heard; of one with many a raw stream is followed once it speaks."""

from types import SimpleNamespace

import pytest
from rclpy.qos import QoSProfile
from sense4hri.crowd import TOO_MANY
from sense4hri.discovery import RawStreams
from sense4hri.graph import follow
from sense4hri.topics import Topic
from std_msgs.msg import String

NAME = "/humans/physiological/p1/ecg/flood_1/raw"


def published(excess: bool, gid: bytes = b"1", one_of_many: bool = False) -> Topic:
    publisher = SimpleNamespace(endpoint_gid=gid, node_name="flood", qos_profile=QoSProfile(depth=1))
    return Topic(NAME, "std_msgs/msg/String", (publisher,), excess, one_of_many)


def service(changed: list, heard: dict | None = None) -> SimpleNamespace:
    """One whose graph a test changes, by the function that is put into the list; heard: handlers by topic."""
    heard = {} if heard is None else heard

    def subscribe(message, topic, handler, *_, **__):
        heard[topic] = handler
        return topic

    return SimpleNamespace(
        watch=lambda globs, function, *_, **__: changed.append(function), subscribe=subscribe, unsubscribe=heard.pop
    )


def test_a_follower_hears_it_once_it_has_a_place():
    """Another publisher of it, still without a place, is nothing new."""
    changed, refused, found = [], [], []
    follow(
        service(changed),
        ["/**"],
        lambda topic, message: None,
        on_publishers=lambda topic, profile: found.append(topic.excess),
        on_refused=lambda topic, why: refused.append(why),
        types=[String],
    )
    for topic in (published(True), published(True, b"2"), published(False, b"2")):
        changed[0](topic)
    assert (refused, found) == ([TOO_MANY], [False])


def test_a_raw_stream_is_found_once_it_has_a_place():
    """Until then nobody is told of it."""
    changed, found = [], []
    streams = RawStreams(service(changed), None, print, print, found.append)
    streams._begin = lambda name, instances: found.append(instances)
    changed[0](published(True))
    assert found == []
    changed[0](published(False))
    assert found == [frozenset({b"1"})]


@pytest.fixture
def crowded():
    """RawStreams beside a process with many streams: what changes its graph, what is heard, what it has begun."""
    changed, heard, begun = [], {}, []
    streams = RawStreams(service(changed, heard), None, print, print)
    streams._begin = lambda name, instances: begun.append(instances)
    heard.clear()  # the registry's topic
    return changed[0], heard, begun


def test_a_raw_stream_of_a_process_with_many_is_found_with_its_first_message(crowded):
    """One subscription waits for that, and is given back then."""
    change, heard, begun = crowded
    for gid in (b"1", b"2"):
        change(published(False, gid, one_of_many=True))
    assert (list(heard), begun) == ([NAME], [])
    heard[NAME](b"")
    assert (heard, begun) == ({}, [frozenset({b"2"})])


@pytest.mark.parametrize("publishers", [True, False])
def test_nobody_waits_for_a_silent_stream_that_left_or_whose_process_has_few_by_now(crowded, publishers):
    """The second is found at once, as any other."""
    change, heard, begun = crowded
    change(published(False, one_of_many=True))
    change(published(False) if publishers else published(False, one_of_many=True)._replace(publishers=()))
    assert (heard, begun) == ({}, [frozenset({b"1"} if publishers else ())])
