"""Markers of a coordinator that has just begun reach those who are still being connected."""

from types import SimpleNamespace

import pytest
from sense4hri_msgs.msg import Marker
from session_coordinator import markers


class Graph:
    """A node's view of who listens, which cannot be slowed down on the real graph."""

    def __init__(self) -> None:
        self.known: list[str] = []
        self.connected = 0
        self.sent: list[str] = []
        self.node = SimpleNamespace(
            get_subscriptions_info_by_topic=lambda topic: [SimpleNamespace(node_name=name) for name in self.known]
        )

    def publisher(self, *about: object) -> SimpleNamespace:
        return SimpleNamespace(
            get_subscription_count=lambda: self.connected, publish=lambda marker: self.sent.append(marker.name)
        )


@pytest.fixture
def graph() -> Graph:
    return Graph()


def test_a_marker_waits_until_all_who_are_known_are_connected(graph):
    """One of two is not enough; then all go out in their order, and later ones at once."""
    out = markers.Markers(graph, tuple)
    out.put(Marker(name="a"))
    graph.known, graph.connected = ["web_gui", "recorder"], 1
    out.put(Marker(name="b"))
    assert graph.sent == []
    graph.connected = 2
    out.send()
    out.put(Marker(name="c"))
    assert graph.sent == ["a", "b", "c"]


def test_a_marker_waits_for_the_recorder_of_a_session_that_goes_on(graph):
    """To a process that has just begun the page may be known before the recorder, which is there all the same."""
    out = markers.Markers(graph, lambda: ["recorder"])
    graph.known, graph.connected = ["web_gui"], 1
    out.put(Marker(name="a"))
    assert graph.sent == []
    graph.known, graph.connected = ["web_gui", "recorder"], 2
    out.send()
    assert graph.sent == ["a"]


def test_a_process_that_is_no_longer_young_waits_for_nobody(graph, monkeypatch):
    """A listener that can never be connected delays nothing for ever."""
    out, graph.known = markers.Markers(graph, tuple), ["web_gui"]
    out.put(Marker(name="a"))
    monkeypatch.setattr(markers, "YOUNG_S", -1.0)
    out.send()
    assert graph.sent == ["a"]


def test_at_the_end_nothing_is_kept_back(graph):
    """Who listens already gets it."""
    out, graph.known = markers.Markers(graph, tuple), ["web_gui"]
    out.put(Marker(name="a"))
    out.close()
    assert graph.sent == ["a"]
