"""Memory of topics that nobody publishes on any more."""

from types import SimpleNamespace

from recorder import topics as topics_module
from recorder.topics import HOLD_S, Topics


def test_memory_is_given_back_once_no_round_holds_what_was_released(monkeypatch):
    """The hearing thread keeps a subscription alive until its round ends; only then is its memory free."""
    now, gone, given_back = SimpleNamespace(s=0.0), [], []
    hearing = SimpleNamespace(rounds=7)
    follower = SimpleNamespace(release=lambda *key: gone.append(key))
    monkeypatch.setattr(topics_module.time, "monotonic", lambda: now.s)
    monkeypatch.setattr(topics_module, "Hearing", lambda service: hearing)
    monkeypatch.setattr(topics_module, "follow", lambda *_, **__: follower)
    monkeypatch.setattr(topics_module, "trim", lambda: given_back.append(hearing.rounds))
    config = SimpleNamespace(record_identifying=True, identifying=[], patterns=["/**"], exclude=[])
    graph = SimpleNamespace(look_every=lambda seconds: None)
    service = SimpleNamespace(config=config, watch=lambda *_, **__: None, graph=graph, start=lambda work: work.close())
    topics = Topics(service, None)
    topics.recorded["/x", "T"] = SimpleNamespace(
        losses=SimpleNamespace(follow=lambda _: None), channel=SimpleNamespace()
    )
    topics._gone(SimpleNamespace(name="/x", type_name="T", instances=frozenset(), publishers=()))
    for now.s, hearing.rounds in ((HOLD_S - 1, 7), (HOLD_S + 1, 8), (HOLD_S + 2, 8), (HOLD_S + 3, 9), (HOLD_S + 4, 10)):
        topics.release()
    assert (gone, given_back) == ([("/x", "T")], [9])
