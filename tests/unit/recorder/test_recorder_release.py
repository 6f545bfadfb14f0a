"""Memory of topics that nobody publishes on any more."""

from types import SimpleNamespace

import pytest
from recorder import topics as topics_module
from recorder.topics import HOLD_S, Topic, Topics
from sense4hri.topics import Topic as Published


@pytest.fixture
def now(monkeypatch):
    time = SimpleNamespace(s=0.0)
    monkeypatch.setattr(topics_module.time, "monotonic", lambda: time.s)
    return time


@pytest.fixture
def hearing():
    return SimpleNamespace(rounds=7)


@pytest.fixture
def gone():
    return []


@pytest.fixture
def subscribed():
    return set()


@pytest.fixture
def given_back(hearing, monkeypatch):
    rounds = []
    monkeypatch.setattr(topics_module, "trim", lambda: rounds.append(hearing.rounds))
    return rounds


@pytest.fixture
def topics(monkeypatch, hearing, gone, subscribed):
    follower = SimpleNamespace(
        release=lambda *key: gone.append(key),
        subscription=lambda *key: object() if key in subscribed else None,
    )
    monkeypatch.setattr(topics_module, "Hearing", lambda service: hearing)
    monkeypatch.setattr(topics_module, "follow", lambda *_, **__: follower)
    config = SimpleNamespace(record_identifying=True, identifying=[], patterns=["/**"], exclude=[])
    graph = SimpleNamespace(look_every=lambda seconds: None)
    service = SimpleNamespace(config=config, watch=lambda *_, **__: None, graph=graph, start=lambda work: work.close())
    return Topics(service, None)


def silent_topic():
    """One that nothing has come on."""
    return Topic(None, SimpleNamespace(publishers=1), False, True)


def test_memory_is_given_back_once_no_round_holds_what_was_released(topics, hearing, now, gone, given_back):
    """The hearing thread keeps a subscription alive until its round ends; only then is its memory free."""
    topics.recorded["/x", "T"] = silent_topic()
    topics._gone(Published("/x", "T", ()))
    for now.s, hearing.rounds in ((HOLD_S - 1, 7), (HOLD_S + 1, 8), (HOLD_S + 2, 8), (HOLD_S + 3, 9), (HOLD_S + 4, 10)):
        topics.release()
    assert (gone, given_back) == ([("/x", "T")], [9])


def test_a_topic_that_never_said_anything_is_forgotten_once_it_is_not_heard_any_more(topics, hearing, now, subscribed):
    """Names that a stranger thinks of stay no longer than he does; what sent something keeps its account."""
    for name in ("/silent", "/heard", "/back"):
        topics.recorded[name, "T"] = silent_topic()
        topics._gone(Published(name, "T", ()))
    topics.recorded["/heard", "T"].received = 1
    now.s = HOLD_S + 1
    topics.release()
    assert len(topics.recorded) == 3, "a round may still take messages of them"
    subscribed.add(("/back", "T"))
    hearing.rounds += 1
    topics.release()
    assert sorted(name for name, _ in topics.recorded) == ["/back", "/heard"]
