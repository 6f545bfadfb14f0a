"""Which topics the recorder takes in first: those of the study, of as many as a node has."""

from types import SimpleNamespace

from recorder.topics import MOST_OWN, is_own
from sense4hri.topics import UNKNOWN_NODE, Topic

RAW = "sense4hri_msgs/msg/PhysioRaw"


def raw(human_id: str, *nodes: str) -> Topic:
    publishers = [SimpleNamespace(node_namespace="/", node_name=node) for node in nodes]
    return Topic(f"/humans/physiological/{human_id}/ecg/h10_1/raw", RAW, tuple(publishers))


def test_a_sensor_that_was_moved_often_is_still_the_studys_own() -> None:
    """Topics that a node has left do not count: after a hundred wearers its stream is taken in first as ever."""
    left = [raw(f"p{number}") for number in range(100)]
    assert is_own(raw("p100", "driver_polar_h10_1"), left)


def test_a_node_with_more_streams_than_a_driver_has_is_a_stranger() -> None:
    """One more than a node has is taken in after the others; another node's are not, nor those of another place."""
    there = [raw(f"p{number}", "flood") for number in range(MOST_OWN["raw"])]
    assert not is_own(raw("q", "flood"), there)
    assert is_own(raw("q", "flood"), there[1:])
    assert is_own(raw("q", "driver_polar_h10_1"), there)
    assert not is_own(raw("q", "driver")._replace(name="/flood_1/raw"), [])


def test_nodes_that_have_not_said_their_names_share_no_bound() -> None:
    """At the start of a study nobody is named yet: that makes no stranger of its drivers."""
    there = [raw(f"p{number}", UNKNOWN_NODE) for number in range(50)]
    assert is_own(raw("q", UNKNOWN_NODE), there)
