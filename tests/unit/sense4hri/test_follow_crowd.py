"""What is beyond what a process may have is not heard, is told once, and is heard once it has a place."""

from types import SimpleNamespace

from rclpy.qos import QoSProfile
from sense4hri.crowd import TOO_MANY
from sense4hri.discovery import RawStreams
from sense4hri.graph import follow
from sense4hri.topics import Topic
from std_msgs.msg import String

NAME = "/humans/physiological/p1/ecg/flood_1/raw"


def published(excess: bool, gid: bytes = b"1") -> Topic:
    publisher = SimpleNamespace(endpoint_gid=gid, node_name="flood", qos_profile=QoSProfile(depth=1))
    return Topic(NAME, "std_msgs/msg/String", (publisher,), excess)


def service(changed: list) -> SimpleNamespace:
    """One whose graph a test changes, by the function that is put into the list."""
    return SimpleNamespace(
        watch=lambda globs, function, *_, **__: changed.append(function),
        subscribe=lambda *_, **__: object(),
        unsubscribe=lambda subscription: None,
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
