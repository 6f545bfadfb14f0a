"""Orders of a page: what is understood and what is refused."""

import json

import pytest
from web_gui.config import MARKER_KEYS, Config
from web_gui.messages import Assign, Ping, Press, Start, Stop, parse

START = {
    "type": "start",
    "number": 3,
    "study": "demo",
    "session_id": "",
    "task": "rest",
    "metadata_json": '{"note": "x"}',
    "human_ids": ["p1"],
    "required_streams": ["/humans/**/raw"],
    "allow_warmup": True,
}
PRESS = {"type": "marker", "number": 4, "name": "note", "value": "<b>", "human_id": "p1"}
PRESS |= {"at_ms": 1_700_000_000_000.25, "uncertainty_ms": 1.5}


def test_orders_are_understood():
    """Every field arrives; ms become ns and s."""
    streams = ("/humans/**/raw",)
    assert parse(json.dumps(START)) == Start(3, "demo", "", "rest", '{"note": "x"}', ("p1",), streams, True)
    assert parse('{"type": "stop", "number": 1}') == Stop(1, "")
    assert parse('{"type": "ping", "number": 0}') == Ping(0)
    press = parse(json.dumps(PRESS))
    assert isinstance(press, Press)
    assert press._replace(at_ns=0) == Press(4, "note", "<b>", "p1", 0, 0.0015)
    assert abs(press.at_ns - 1_700_000_000_000_250_000) < 500  # a double holds a time of day to a quarter of a µs


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ({**START, "allow_warmup": 1}, "allow_warmup"),
        ({**START, "human_ids": "p1"}, "human_ids"),
        ({**START, "human_ids": [1]}, "human_ids"),
        ({**START, "required_streams": ["/a"] * 2000}, "required_streams"),
        ({**START, "study": None}, "study"),
        ({**START, "task": "x" * 2000}, "task"),
        ({**START, "study": "\ud800"}, "study"),
        ({**START, "human_ids": ["p1\0p2"]}, "human_ids"),
        ({**PRESS, "value": "image 7\0"}, "value"),  # a message would end there: half of it would be recorded
        ({**START, "number": -1}, "number"),
        ({**PRESS, "name": ""}, "name"),
        ({**PRESS, "name": "x" * 257}, "name"),  # every service would refuse such a marker
        ({**PRESS, "human_id": "p 1"}, "human_id"),
        ({**PRESS, "at_ms": None}, "at_ms"),
        ({**PRESS, "at_ms": "now"}, "at_ms"),
        ({**PRESS, "uncertainty_ms": -1}, "uncertainty_ms"),
        ({**PRESS, "uncertainty_ms": float("nan")}, "uncertainty_ms"),
        ({"type": "assign", "number": 5, "sensor_id": ["h10_1"], "human_id": "p1"}, "sensor_id"),
        ({"type": ["start"]}, "type"),
    ],
)
def test_a_wrong_order_names_its_field(message, named):
    """Nothing of it is guessed."""
    with pytest.raises(ValueError, match=named):
        parse(json.dumps(message))


@pytest.mark.parametrize(
    ("sensor_id", "human_id", "fault"),
    [
        ("h10_1", "p3", ""),
        ("h10_1", "unassigned", ""),
        ("h10_1", "p 3", "'p 3' is no pseudonym"),
        ("h10_1", "", "'' is no pseudonym"),
        ("h10_1", "everyone", "'everyone' is no participant: it means all of them"),
        ("h10_1", "Unassigned", "'Unassigned' is no participant: it means a sensor that nobody wears"),
        ("h10_1", "p__3", "no pseudonym"),
        ("h10_1", "p" * 64, "no pseudonym"),
        ("H10", "p3", "'H10' is no sensor_id"),
        ("h10/1", "p3", "no sensor_id"),
    ],
)
def test_an_assignment_names_the_id_that_is_none(sensor_id, human_id, fault):
    """By the kit's rules; a slip of the pen is a sentence, the connection stays."""
    order = {"type": "assign", "number": 5, "sensor_id": sensor_id, "human_id": human_id}
    asked = parse(json.dumps(order))
    assert asked == Assign(5, sensor_id, human_id)
    assert fault in asked.fault
    assert bool(asked.fault) == bool(fault)


def test_the_contracts_markers_have_keys():
    """Every name of the contract, each with its own key."""
    names = ["baseline_start", "baseline_end", "condition_start", "condition_end"]
    names += ["stimulus", "response", "sync", "note", "mvc"]
    assert sorted(name for _, name in Config().markers()) == sorted(names)
    assert Config(marker_keys=(*MARKER_KEYS, "7=my own")).markers()[-1] == ("7", "my own")


@pytest.mark.parametrize(
    "entry", ["", "x", "x=", "=note", "xy=note", "g=note", "1=note", " =note", "ä=note", "b=again"]
)
def test_a_wrong_marker_key_is_named(entry):
    """One key, not the page's own, and a name."""
    with pytest.raises(ValueError, match="marker_keys"):
        Config(marker_keys=("b=baseline_start", entry))
