"""What a browser may ask for, and what it is sent."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.frames import decode, encode
from web_gui.messages import Ack, parse
from web_gui.model import Study
from web_gui.steady import Steady
from web_gui.stream import Info
from web_gui.view import Request, View

S = 1_000_000_000
NOW = 1_700_000_000 * S
NAME = StreamName("p1", "ecg", "h10_1")
GOOD = {
    "type": "view",
    "view": 1,
    "columns": 1000,
    "window_s": 10,
    "end_ms": None,
    "lanes": [{"stream": "p1/ecg/h10_1", "channels": [0]}],
}


def feed(study, seconds, start_ns=NOW):
    """Some seconds of 100 Hz that end at start_ns + seconds."""
    stream = study.stream(NAME, start_ns)
    stream.learn(Info(100.0, "uV", {}))
    for k in range(seconds * 10):
        at = start_ns + (k + 1) * S // 10
        stream.raw(Chunk(("ecg",), np.full((10, 1), float(k)), at - NOW + S, at), at)
    return start_ns + seconds * S


def test_a_good_view_is_understood():
    """Whole seconds and milliseconds become ns."""
    asked = parse(json.dumps({**GOOD, "end_ms": 1_700_000_000_000}))
    assert isinstance(asked, Request)
    assert (asked.window_ns, asked.end_ns) == (10 * S, 1_700_000_000_000_000_000)
    assert parse('{"type": "ack", "number": 7}') == Ack(7)


@pytest.mark.parametrize(
    "change",
    [
        {"type": "delete"},
        {"view": -1},
        {"view": 1.5},
        {"columns": 0},
        {"columns": 10**9},
        {"columns": True},
        {"window_s": "10"},
        {"window_s": 0},
        {"window_s": 1e9},
        {"end_ms": "now"},
        {"end_ms": -5},
        {"lanes": {}},
        {"lanes": [1]},
        {"lanes": [{"stream": "p1"}]},
        {"lanes": [{"stream": "../../etc"}]},
        {"lanes": [{"stream": "p1/ecg/h10_1", "channels": [-1]}]},
        {"lanes": [{"stream": "p1/ecg/h10_1", "channels": ["0"]}]},
        {"lanes": [{"stream": "p1/ecg/h10_1"}] * 600},
    ],
)
def test_a_bad_view_is_refused_by_name(change):
    """Every field is checked; the error says which one is wrong."""
    with pytest.raises(
        ValueError, match=r"type|view|columns|window_s|end_ms|lane|stream|channels|sensor_type|human_id"
    ):
        parse(json.dumps({**GOOD, **change}))


@given(st.text() | st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_no_text_crashes_the_parser(text):
    """Anything else raises ValueError."""
    with pytest.raises(ValueError, match=r".+"):
        parse(text)


def test_deep_nesting_is_refused():
    """A message that would exhaust the stack is an error like any other."""
    with pytest.raises(ValueError, match="nested deeper"):
        parse("[" * 30_000)


def test_a_frame_carries_only_what_is_new():
    """First everything in the window, then what came since, then nothing."""
    study = Study()
    now = feed(study, 20)
    view = View(parse(json.dumps(GOOD)))
    first = view.frame(study, 1, now)
    assert first.lanes[0].full
    assert 1000 < len(first.lanes[0].line.times_ns) <= 1101
    assert view.frame(study, 2, now).lanes == []
    now = feed(study, 1, now)
    second = view.frame(study, 3, now)
    assert not second.lanes[0].full
    assert 100 <= len(second.lanes[0].line.times_ns) <= 110


def test_a_client_that_was_slow_gets_a_window_not_a_backlog():
    """However long it was away, a frame never holds more than the window."""
    study = Study()
    now = feed(study, 5)
    view = View(parse(json.dumps(GOOD)))
    view.frame(study, 1, now)
    now = feed(study, 120, now)
    late = view.frame(study, 2, now)
    assert len(late.lanes[0].line.times_ns) <= 1110


def test_a_view_of_the_past_ends_where_it_was_asked_to():
    """A paused page is not sent what comes later."""
    study = Study()
    now = feed(study, 30)
    view = View(parse(json.dumps({**GOOD, "end_ms": (now - 10 * S) / 1e6})))
    line = view.frame(study, 1, now).lanes[0].line
    assert line.times_ns[-1] < now - 10 * S
    assert line.times_ns[0] >= now - 22 * S
    feed(study, 1, now)
    assert view.frame(study, 2, now + S).lanes == []


def test_the_edge_may_go_back_before_what_has_been_sent():
    """By a few seconds, as that of a replay that is sought: nothing is new until it is where that ended."""
    study = Study(clock=Steady(lambda: NOW, lambda: NOW))
    view = View(parse(json.dumps({**GOOD, "columns": 100})))
    now = feed(study, 20)
    view.frame(study, 1, now)
    now = feed(study, 1, now)
    assert view.frame(study, 2, now - 4 * S).lanes == []
    (part,) = view.frame(study, 3, feed(study, 1, now)).lanes
    first_s, last_s = ((part.line.times_ns[at] - now) / S for at in (0, -1))
    assert (first_s, last_s) == pytest.approx((-3.0, 1.0), abs=0.3)  # a column


def test_an_unknown_stream_is_an_empty_lane():
    """A stream that has just gone is no error."""
    study = Study()
    view = View(parse(json.dumps({**GOOD, "lanes": [{"stream": "p9/ecg/gone"}]})))
    assert view.frame(study, 1, NOW).lanes == []


def test_an_hour_ago_is_drawn_where_it_was():
    """As far back as `history_s` allows, the page is sent the times of the samples."""
    study = Study(3600.0, clock=Steady(lambda: NOW, lambda: NOW))
    feed(study, 20)
    now_ns = NOW + 3500 * S
    asked = parse(json.dumps({**GOOD, "end_ms": (NOW + 15 * S) / 1e6}))
    frame = decode(encode(View(asked).frame(study, 1, now_ns)))
    times_ns = frame.lanes[0].line.times_ns
    assert frame.now_ns == now_ns
    assert NOW + 4 * S <= times_ns[0] < times_ns[-1] <= NOW + 15 * S
