"""What may be asked for, what is refused and with which words, and what is kept on disk."""

import json
import math
import os
import random
from dataclasses import asdict, fields
from typing import Any

import pytest
from sense4hri.errors import Refusal
from sense4hri.shapes import read
from sense4hri.strict_json import parse
from session_coordinator.config import Config
from session_coordinator.request import MarkerWish, Request, StartWish, StopWish, ended, press, request
from session_coordinator.session import Phase, Session
from session_coordinator.store import Store


def test_a_study_may_bear_any_name():
    """Study and task are free text in any script; the recorder makes folder names of them."""
    asked = request(read(StartWish, {"study": "Prüfung 1/b", "task": "リーチング"}))
    assert asked == Request("Prüfung 1/b", task="リーチング")


@pytest.mark.parametrize(
    ("fields", "names"),
    [
        ({"study": ""}, "study is empty"),
        ({}, "study is empty"),
        ({"study": "a\nb"}, "study"),
        ({"study": "s" * 101}, "101 characters"),
        ({"study": 3}, "study is 3"),
        ({"study": "s", "session_id": "a/b"}, "session_id 'a/b'"),
        ({"study": "s", "session_id": "../up"}, "session_id"),
        ({"study": "s", "session_id": "größe"}, "session_id"),
        ({"study": "s", "session_id": "x" * 64}, "session_id"),
        ({"study": "s", "human_ids": ["Anna Maria"]}, "'Anna Maria'"),
        ({"study": "s", "human_ids": ["unassigned"]}, "'unassigned' is no participant: it means a sensor that nobody"),
        ({"study": "s", "human_ids": ["p1", "Nobody"]}, "'Nobody' is no participant: it means the folder of sessions"),
        ({"study": "s", "human_ids": ["everyone"]}, "'everyone' is no participant: it means all of them"),
        ({"study": "s", "human_ids": ["withdrawn"]}, "'withdrawn' is no participant: it means one who was taken out"),
        ({"study": "s", "human_ids": ["p1", "p1"]}, "named twice"),
        ({"study": "s", "human_ids": "p1"}, "a list"),
        ({"study": "s", "required_streams": ["camera"]}, "'camera'"),
        ({"study": "s", "required_streams": ["/a b"]}, "'/a b'"),
        ({"study": "s", "metadata_json": r'{"notes": "a\u0000"}'}, "metadata_json .* notes holds the character NUL"),
        ({"study": "s", "metadata_json": "{"}, "not JSON"),
        ({"study": "s", "metadata_json": "[1]"}, "JSON object"),
        (
            {"study": "s", "metadata_json": r'{"room": "\ud800"}'},
            "metadata_json .* room holds half of a surrogate pair",
        ),
        ({"study": "s", "metadata_json": '{"room": "\ud800"}'}, "metadata_json .* half of a surrogate pair"),
        ({"study": "s", "metadata_json": '{"a": 1' + "0" * 400 + "}"}, "metadata_json .* beyond 64 bits"),
        ({"study": "s", "metadata_json": "[" * 50_000}, "metadata_json .* nested deeper"),
        ({"study": "s", "metadata_json": '{"a": "' + "x" * 70_000 + '"}'}, "metadata_json .* longer than 65536"),
        ({"study": "s", "metadata": {"a": "x" * 70_000}}, "metadata_json has 7"),
        ({"study": "s", "required_streams": ["/a"] * 257}, "required_streams: 257 globs, at most 256"),
        ({"study": "s", "required_streams": ["/" + "*" * 256]}, "required_streams: a glob of 257 characters"),
        ({"study": "s", "human_ids": [f"p{n}" for n in range(101)]}, "human_ids names 101 people, at most 100"),
        ({"study": "s", "allow_warmup": "yes"}, "allow_warmup"),
        ({"study": "s", "participants": ["p1"]}, "'participants' is not a field"),
    ],
)
def test_what_cannot_be_is_refused_by_name(fields, names):
    """The error names the field and what is wrong with it."""
    with pytest.raises(ValueError, match=names):
        request(read(StartWish, fields))


def test_globs_and_the_robots_topics_may_be_required():
    """A required stream is a full topic name or glob, whoever publishes it."""
    streams = ("/humans/physiological/*/ecg/**", "/tf", "/head_camera/image_raw")
    assert request(read(StartWish, {"study": "s", "required_streams": list(streams)})).required_streams == streams


def test_an_accepted_warm_up_stands_in_the_metadata():
    """allow_warmup travels in metadata_json, beside what the experimenter wrote."""
    asked = request(read(StartWish, {"study": "s", "metadata_json": '{"room": "B2"}', "allow_warmup": True}))
    assert json.loads(asked.metadata_json) == {"room": "B2", "allow_warmup": True}
    assert request(read(StartWish, {"study": "s", "metadata": {"room": "B2"}})).metadata_json == '{"room": "B2"}'


def test_a_marker_is_stamped_at_the_press():
    """age_ms is how long ago the key was pressed; how well that is known stays unknown unless told."""
    asked = press(MarkerWish("stimulus", "blue", "p1", 250.0))
    assert asked.age_s == 0.25
    assert math.isnan(asked.uncertainty_s)
    assert press(MarkerWish("note", uncertainty_ms=2.0)).uncertainty_s == 0.002


@pytest.mark.parametrize(
    ("fields", "names"),
    [
        ({}, "name is empty"),
        ({"name": "a", "age_ms": -1}, "age_ms"),
        ({"name": "a", "age_ms": math.nan}, "age_ms"),
        ({"name": "a", "age_ms": "now"}, "age_ms"),
        ({"name": "a", "human_id": "p 1"}, "human_id"),
        ({"name": "a", "uncertainty_ms": -1}, "uncertainty_ms"),
        ({"name": "a", "at": 3}, "'at' is not a field"),
    ],
)
def test_a_wrong_marker_is_refused_by_name(fields, names):
    """The error names the field."""
    with pytest.raises(ValueError, match=names):
        press(read(MarkerWish, fields))


@pytest.mark.parametrize("session_id", ["a\0", "a\nb", "\u202e", "x" * 101])
def test_a_stop_that_names_no_session_is_refused_by_name(session_id):
    """What cannot be a session's id is neither looked for nor said again; an empty one is whichever runs."""
    with pytest.raises(Refusal, match="session_id") as refused:
        ended(StopWish(session_id))
    assert refused.value.field == "session_id"
    assert ended(StopWish()) == ""


def test_a_session_outlives_the_process(tmp_path):
    """What was kept comes back as it was, with the time since the last heartbeat."""
    store = Store(tmp_path / "session.json")
    assert store.load() is None
    session = Session(Phase.RECORDING, "s1", "Prüfung", human_ids=("p1",), expected=("a", "b"), start_ns=7)
    store.save(session, ("s0", "s1"))
    store.beat()
    then = os.stat(tmp_path / "session.json").st_mtime - 50
    os.utime(tmp_path / "session.json", (then, then))
    kept = store.load()
    assert (kept.session, kept.used) == (session, ("s0", "s1"))
    assert kept.gone_for_s == pytest.approx(50, abs=5)


def test_an_absence_over_a_clock_that_was_set_back_is_not_called_none(tmp_path):
    """Nobody can say how long it was."""
    store = Store(tmp_path / "session.json")
    store.save(Session(Phase.RECORDING, "s1", "study"), ())
    then = os.stat(tmp_path / "session.json").st_mtime + 3600
    os.utime(tmp_path / "session.json", (then, then))
    assert math.isnan(store.load().gone_for_s)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}",
        b"[1]",
        b"\x00",
        b"\xff\xfe",
        b'{"session": {"colour": 1}, "used": []}',
        b'{"session": {"phase": 7}, "used": []}',
        b'{"session": {"phase": []}, "used": []}',
        b'{"session": {"phase": 2, "study": 5}, "used": []}',
        b'{"session": {"phase": 2, "study": ""}, "used": []}',
        rb'{"session": {"phase": 2, "study": "s", "metadata_json": "{\"a\": \"\\ud800\"}"}, "used": []}',
        b'{"session": {"phase": 0, "detail": "\\ud800"}, "used": []}',
        b'{"session": {"phase": 0, "start_ns": 9000000000000000000}, "used": []}',
        b'{"session": {"phase": 0, "start_ns": 1' + b"0" * 400 + b'}, "used": []}',
        b'{"session": ' + b"[" * 100_000,
        b'{"session": {}, "used": [5]}',
        b" " * (1 << 23),
    ],
)
def test_a_damaged_file_is_named_and_set_aside(tmp_path, content):
    """A state file that is not what a coordinator keeps is refused by name, and lies beside under another one."""
    file = tmp_path / "session.json"
    file.write_bytes(content)
    store = Store(file)
    with pytest.raises(ValueError, match=r"session\.json holds no session of ours"):
        store.load()
    aside = store.set_aside()
    assert aside.name.startswith("session.json.damaged-")
    assert aside.read_bytes() == content
    assert store.load() is None
    file.write_bytes(b"again")
    assert store.set_aside() not in (aside, file)


def test_a_folder_is_not_set_aside(tmp_path):
    """What is no file at all is a mistake of the configuration."""
    with pytest.raises(OSError, match="no regular file"):
        Store(tmp_path).set_aside()


@pytest.mark.parametrize(("name", "value"), [("lead_s", 0.0), ("answer_timeout_s", 0.0), ("state_file", "")])
def test_a_wrong_parameter_is_named(name, value):
    """A configuration that cannot work is refused with the parameter's name."""
    with pytest.raises(ValueError, match=name):
        Config(**{name: value})


def hostile(dice: random.Random) -> Any:
    """Return a value that somebody might send, of any type."""
    texts = ("", "s", "p1", "p__1", "\ud800", "\x00", "/*/" + "*" * 200 + "X/**", "/a/" * 500, "ü" * 99, "[" * 9000)
    texts += ('{"a": 1' + "0" * 400 + "}", r'{"a": "\udfff"}', '{"a": NaN}', '{"allow_warmup": 1}', '{"a": {"b": []}}')
    lists = ([], ["p1", "p2"], ["/tf", "/**"], ["p1"] * 200, ["/a"] * 300, [5], [[]])
    return dice.choice((*texts, *lists, 10**400, math.inf, None, True, {}, {"a": [1, "\ud800"]}, {"room": "B2"}))


def test_whatever_a_start_accepts_is_kept_and_read_back(tmp_path):
    """Of 10 000 random starts each is refused in a sentence, or can be published, kept and gone on with as it was."""
    dice, store, accepted = random.Random(8), Store(tmp_path / "session.json"), 0
    refused: list[str] = []
    names = [one.name for one in fields(StartWish)]
    for _ in range(10_000):
        wish = {"study": "s"} | {name: hostile(dice) for name in dice.sample(names, dice.randint(0, 3))}
        try:
            asked = request(read(StartWish, parse(json.dumps(wish))))
        except ValueError as err:
            refused.append(str(err))
            continue
        accepted += 1
        session = Session(Phase.PREPARING, "s1", asked.study, asked.task, asked.metadata_json, *asked[4:])
        json.dumps(asdict(session), ensure_ascii=False).encode()
        if accepted % 50 == 0:
            store.save(session, ())
            assert store.load().session == session
    assert accepted > 500
    assert all(refused)
    "".join(refused).encode()
