"""Memory of topics that nobody publishes on any more."""

from types import SimpleNamespace

import pytest
from recorder import topics as topics_module
from recorder.queued import Queue
from recorder.taken import Taken
from recorder.topics import HOLD_S, Topic, Topics
from sense4hri.topics import Topic as Published


@pytest.fixture
def now(monkeypatch):
    time = SimpleNamespace(s=0.0)
    monkeypatch.setattr(topics_module.time, "monotonic", lambda: time.s)
    return time


@pytest.fixture
def gone():
    return []


@pytest.fixture
def subscribed():
    return set()


@pytest.fixture
def topics(monkeypatch, gone, subscribed):
    follower = SimpleNamespace(
        release=lambda *key: gone.append(key),
        subscription=lambda *key: object() if key in subscribed else None,
    )
    monkeypatch.setattr(topics_module, "Hearing", lambda service: SimpleNamespace(rounds=0))
    monkeypatch.setattr(topics_module, "follow", lambda *_, **__: follower)
    config = SimpleNamespace(record_identifying=True, identifying=[], patterns=["/**"], exclude=[])
    service = SimpleNamespace(config=config, watch=lambda *_, **__: None, look_every=lambda seconds: None)
    return Topics(service, None)


def silent_topic():
    """One that nothing has come on."""
    return Topic(None, SimpleNamespace(publishers=1), False, True)


def test_a_topic_is_let_go_once_some_time_after_its_last_publisher_left(topics, now, gone):
    """One that comes back before is kept, so that nothing of it is missed."""
    for name in ("/x", "/back"):
        topics.recorded[name, "T"] = silent_topic()
        topics._gone(Published(name, "T", ()))
    topics._left.pop(("/back", "T"))
    for now.s in (HOLD_S - 1, HOLD_S + 1, HOLD_S + 2):
        topics.release()
    assert gone == [("/x", "T")]


def test_a_topic_whose_last_publisher_left_is_marked_until_one_is_back(topics, monkeypatch):
    """So that the next recording does not begin with what it said."""
    recorded = topics.recorded["/x", "T"] = silent_topic()
    recorded.channel.qos = []
    topics._gone(Published("/x", "T", ()))
    assert recorded.channel.gone
    topics._publishers(Published("/x", "T", (object(),)), SimpleNamespace(durability=None))
    assert not recorded.channel.gone


def test_a_topic_that_never_said_anything_is_forgotten_once_it_is_not_heard_any_more(topics, now, subscribed):
    """Names that a stranger thinks of stay no longer than he does; what sent something keeps its account."""
    for name in ("/silent", "/heard", "/back"):
        topics.recorded[name, "T"] = silent_topic()
        topics._gone(Published(name, "T", ()))
    topics.recorded["/heard", "T"].received = 1
    now.s = HOLD_S + 1
    topics.release()
    assert len(topics.recorded) == 3, "a round may still take messages of them"
    subscribed.add(("/back", "T"))
    topics.hearing.rounds += 1
    topics.release()
    assert sorted(name for name, _ in topics.recorded) == ["/back", "/heard"]


def test_a_topic_is_not_forgotten_while_a_round_that_began_before_may_still_take_of_it(topics, now):
    """A flooded round takes longer than a second: the message of a late publisher is kept, and ends nothing."""
    topics.recorded["/x", "T"] = Topic(queue := Queue(), SimpleNamespace(publishers=1), False, True)
    topics._gone(published := Published("/x", "T", ()))
    now.s = HOLD_S + 1
    for _ in range(3):
        topics.release()
    topics._take(published, Taken(b"late", 1, 1, 1, b""))
    assert len(queue) == 1
    topics.recorded["/x", "T"].received = 0
    topics.hearing.rounds += 1
    topics.release()
    assert not topics.recorded
