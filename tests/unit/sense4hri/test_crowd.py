"""How many topics of one process are read: a driver's, a bridge's, not a flood."""

from types import SimpleNamespace

import pytest
from sense4hri.crowd import FEW, MOST, Crowd
from sense4hri.topics import UNKNOWN_NODE, Graph

ROOT = "/humans/physiological"


def by(process: bytes, node: str = "flood", kind: str = "t") -> SimpleNamespace:
    """A publisher: the first twelve bytes of its id are those of its process."""
    return SimpleNamespace(endpoint_gid=process.ljust(12, b"\0") + b"1234", node_name=node, topic_type=kind)


def raw(number: int, field: str = "raw") -> str:
    return f"{ROOT}/p{number}/ecg/flood_1/{field}"


@pytest.fixture
def full():
    """A crowd in which process `a` has all its places for raw topics."""
    crowd = Crowd()
    assert not any(crowd.is_beyond(raw(number), [by(b"a")]) for number in range(MOST))
    return crowd


def test_a_process_has_so_many_raw_topics_and_no_more(full):
    """What has a place keeps it however often it is looked at; another process, or another field, has its own."""
    assert full.is_beyond(raw(MOST), [by(b"a")])
    assert not full.is_beyond(raw(0), [by(b"a")])
    assert not full.is_beyond(raw(MOST), [by(b"b")])
    assert not full.is_beyond(raw(MOST, "health"), [by(b"a")])


def test_a_place_is_free_again_once_its_topic_has_left_or_is_not_watched_any_more(full):
    """Also where somebody else publishes it now."""
    for leave in (
        lambda: full.is_beyond(raw(0), []),
        lambda: full.is_beyond(raw(1), [by(b"b")]),
        lambda: full.keep([raw(number) for number in range(MOST + 2) if number != 2]),
    ):
        beyond = next(number for number in range(MOST, 2 * MOST) if full.is_beyond(raw(number), [by(b"a")]))
        leave()
        assert not full.is_beyond(raw(beyond), [by(b"a")])


def test_a_topic_that_others_publish_too_is_read(full):
    """A flood that publishes what a driver publishes cannot have it left out."""
    assert not full.is_beyond(raw(MOST), [by(b"a"), by(b"b", "driver_polar_h10_1")])


def test_a_replay_publishes_a_whole_study(full):
    """It is known by the node's name, once that is known; until then it counts as any other."""
    assert full.is_beyond(raw(MOST), [by(b"a", UNKNOWN_NODE)])
    assert not full.is_beyond(raw(MOST), [by(b"a", "replay")])
    assert not full.is_beyond(raw(MOST + 1), [by(b"a", "replay")])


def test_streams_are_one_of_many_while_their_process_has_more_than_a_device():
    """Not where a process with few publishes it too; a replay's are not, once its name is known."""
    crowd = Crowd()
    for number in range(FEW + 1):
        publishers = [by(b"a", UNKNOWN_NODE)]
        assert not crowd.is_beyond(raw(number), publishers)
        assert crowd.is_one_of_many(raw(number), publishers) == (number == FEW)
    assert crowd.is_one_of_many(raw(0), publishers)
    assert not crowd.is_one_of_many(raw(0), [by(b"a", "replay")])
    crowd.is_beyond(raw(1), [by(b"a"), by(b"b")])
    assert not crowd.is_one_of_many(raw(1), [by(b"a"), by(b"b")])
    crowd.is_beyond(raw(2), [])
    assert not crowd.is_one_of_many(raw(0), publishers)


@pytest.mark.parametrize("form", ["/robot_{}/raw", f"{ROOT}/p{{}}/ecg/x/features", f"{ROOT}/p{{}}/ecg/x/clock"])
def test_what_no_driver_publishes_is_not_counted(form):
    """A robot's topics, and those of interpreters and clock-sync, which have one for every stream of the study."""
    crowd = Crowd()
    assert not any(crowd.is_beyond(form.format(number), [by(b"a")]) for number in range(2 * MOST))


@pytest.fixture
def published():
    """Publishers by topic: one process with one raw topic too many."""
    return {name: [by(b"a")] for name in sorted(raw(number) for number in range(MOST + 1))}


@pytest.fixture
def graph(published):
    return Graph(
        SimpleNamespace(
            get_topic_names_and_types=lambda: [(name, ["t"]) for name in published],
            get_publishers_info_by_topic=lambda name: published.get(name, []),
        )
    )


def test_watchers_are_told_which_topics_are_beyond_and_when_they_are_no_longer(graph, published):
    """They keep the first by name, so that every service of a study reads the same ones."""
    told, names = [], list(published)
    graph.watch([f"{ROOT}/**"], lambda topic: told.append((topic.name, bool(topic.publishers), topic.excess)))
    graph.look()
    assert told == [(name, True, name == names[-1]) for name in names]
    graph._recheck_at_s = 0.0
    graph.look()
    del published[names[0]], told[:]
    graph._recheck_at_s = 0.0
    graph.look()
    assert told == [(names[0], False, False), (names[-1], True, False)]


def test_watchers_are_told_again_which_topics_are_one_of_many(graph, published):
    """The first of a process are told before it is known to have many, and again once it is, or has few by now."""
    del published[[*published][-1]]  # which is too many
    told, names = [], list(published)
    graph.watch([f"{ROOT}/**"], lambda topic: told.append((topic.name, topic.one_of_many)))
    graph.look()
    assert told == [(name, number >= FEW) for number, name in enumerate(names)]
    del told[:]
    graph._recheck_at_s = 0.0
    graph.look()
    assert told == [(name, True) for name in names[:FEW]]
    for name in names[FEW:]:
        published.pop(name)
    graph.look()
    del told[:]
    graph._recheck_at_s = 0.0
    graph.look()
    assert told == [(name, False) for name in names[:FEW]]


def test_what_left_while_nobody_watched_has_no_place_any_more(graph, published):
    """Whoever watches again is told of another in its place."""
    names = list(published)
    watch = graph.watch([f"{ROOT}/**"], lambda topic: None)
    graph.look()
    assert watch.topics[names[-1], "t"].excess
    graph.unwatch(watch)
    graph.look()
    del published[names[0]]
    again = graph.watch([f"{ROOT}/**"], lambda topic: None)
    graph.look()
    assert not again.topics[names[-1], "t"].excess


def test_nobody_is_told_of_what_may_be_a_replays(graph, published):
    """Until a node has said its name its topics beyond the bound are neither read nor called too many."""
    told, last = [], [*published][-1]
    graph.watch([f"{ROOT}/**"], lambda topic: told.append((topic.name, topic.excess)))
    published[last] = [by(b"a", UNKNOWN_NODE)]
    graph.look()
    assert len(told) == MOST
    published[last] = [by(b"a", "replay")]
    graph.look()
    assert told[MOST:] == [(last, False)]
