"""What strangers on the graph can neither fill, nor hold up, nor have called by a wrong name."""

from types import SimpleNamespace

import pytest
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from recorder import taking_part as taking_part_module
from recorder import topics as topics_module
from recorder.nodes import LEFT_OUT, LONGEST_PARAMETERS, MOST_NODES, Nodes
from recorder.taking_part import TakingPart
from recorder.topics import Topics
from sense4hri.topics import Topic
from sense4hri_msgs.msg import SessionState
from sense4hri_recording import recorder_json
from sense4hri_recording.recorder_json import RecorderJson


def event(node: str, name: str, text: str) -> ParameterEvent:
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
    return ParameterEvent(node=node, new_parameters=[Parameter(name=name, value=value)])


def test_a_stranger_cannot_make_the_sidecar_unreadable(tmp_path):
    """Thousands of nodes, and parameters without end, cost a bounded file that says so and can be read."""
    names = [(f"n{k}", "/") for k in range(3 * MOST_NODES)]
    node = SimpleNamespace(get_node_names_and_namespaces=lambda: names)
    asked = []
    service = SimpleNamespace(
        node=node,
        subscribe=lambda *_: None,
        every=lambda *_: None,
        start=lambda work: (asked.append(1), work.close()),
    )
    nodes = Nodes(service)
    nodes._look()
    for k in range(300):
        nodes._changed(event("/n1", f"p{k}", "x" * 60_000))
        nodes._changed(event("/n2", f"p{k}", "x" * 600))
    nodes._changed(event("/n1", "small", "1"))
    told = {one["node"]: one["parameters"] for one in nodes.since(0)}
    assert len(told) == len(asked) == MOST_NODES
    assert told["/n1"]["small"] == "1"
    assert "parameters" in told["/n1"][LEFT_OUT]
    assert 20_000 < sum(map(len, told["/n2"].values())) < LONGEST_PARAMETERS
    recorder_json.write(tmp_path, RecorderJson("complete", nodes=nodes.since(0)))
    assert recorder_json.read(tmp_path).state == "complete"


def test_a_sidecar_is_never_longer_than_it_may_be_to_be_read(tmp_path, monkeypatch):
    """The nodes are left out first, then where messages were lost; the counts stay, and events say so."""
    monkeypatch.setattr(recorder_json, "LARGEST_BYTES", 5000)
    losses = [{"after_ns": 1, "before_ns": 2, "count": 3, "cause": "queue"}] * 200
    content = RecorderJson("complete", topics=[{"topic": "/a", "lost": 600, "losses": losses}], nodes=[{"node": "/n"}])
    recorder_json.write(tmp_path, content)
    read = recorder_json.read(tmp_path)
    assert (read.state, read.trouble, read.nodes, read.topics[0]["lost"]) == ("complete", "", [], 600)
    assert [one["what"].partition(":")[0] for one in read.events] == ["nodes are left out", "losses are left out"]


@pytest.fixture
def topics(monkeypatch):
    monkeypatch.setattr(topics_module, "Hearing", lambda service: SimpleNamespace())
    monkeypatch.setattr(topics_module, "follow", lambda *_, **__: SimpleNamespace(topics=[]))
    config = SimpleNamespace(record_identifying=True, identifying=[], patterns=["/**"], exclude=[])
    service = SimpleNamespace(
        config=config,
        watch=lambda *_, **__: None,
        look_every=lambda seconds: None,
        log=SimpleNamespace(error=lambda text: None),
    )
    return Topics(service, None)


def named(name: str) -> Topic:
    return Topic(name, "T", ())


def test_a_refused_topic_is_forgotten_once_it_is_gone(topics):
    """It holds up a session only while it is there."""
    topics._refuse(named("/a/x"), "no such type")
    assert topics.unheard(["/a/x"]).topic == "/a/x"
    topics._gone(named("/a/x"))
    assert topics.refused == {}
    assert topics.unheard(["/a/x"]) is None


def test_a_refused_topic_holds_up_no_session_that_hears_others_of_the_same_glob(topics):
    """A required glob is heard where one of its topics is; a topic required by its name is not."""
    topics._refuse(named("/a/x"), "no such type")
    assert topics.unheard(["/a/*"]).why == "no such type"
    topics._follower.topics = [named("/a/y")._replace(publishers=(object(),))]
    assert topics.unheard(["/a/*"]) is None
    assert topics.unheard(["/a/*", "/a/x"]).topic == "/a/x"


def test_a_refused_topic_holds_up_a_session_that_heard_others_of_the_same_glob_only_long_ago(topics):
    """What was recorded once and has nobody behind it any more, let go or not, is not heard."""
    topics._refuse(named("/a/x"), "no such type")
    topics.recorded["/a/y", "T"] = SimpleNamespace()
    assert topics.unheard(["/a/*"]).topic == "/a/x"
    topics._follower.topics = [named("/a/y")]
    assert topics.unheard(["/a/*"]).topic == "/a/x"


def test_a_new_session_is_not_acknowledged_with_the_folder_of_another_one(monkeypatch, tmp_path):
    """Until its own file is open there is none to name."""
    told = {}
    monkeypatch.setattr(taking_part_module, "SessionMember", lambda *_, **more: told.update(more))
    service = SimpleNamespace(node=SimpleNamespace(get_name=lambda: "recorder"))
    bag = SimpleNamespace(directory=tmp_path, about=SimpleNamespace(session={"session_id": "s1"}))
    TakingPart(service, None, None, lambda: bag, None)
    assert told["directory"](SessionState(session_id="s1")) == str(tmp_path.resolve())
    assert told["directory"](SessionState(session_id="s2")) == ""


def test_the_last_messages_are_waited_for_at_the_end_of_every_session(monkeypatch):
    """Also of one that bears the id of another one, which was stopped before it had begun."""
    told, finished, clock = {}, [], SimpleNamespace(now_s=100.0)
    monkeypatch.setattr(taking_part_module, "SessionMember", lambda *_, **more: told.update(more))
    monkeypatch.setattr(taking_part_module, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    service = SimpleNamespace(node=SimpleNamespace(get_name=lambda: "recorder"))
    topics = SimpleNamespace(hearing=SimpleNamespace(behind_s=0.0))
    TakingPart(service, None, topics, lambda: None, finished.append)
    for stopped_s in (1, 2):
        state = SessionState(session_id="s1")
        state.stop_at.sec = stopped_s
        assert told["finish"](state) == (False, "writing")
        assert len(finished) == stopped_s - 1
        clock.now_s += 1.0
        told["finish"](state)
        assert finished == ["s1"] * stopped_s
