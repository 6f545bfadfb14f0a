"""The registry and sense4hri-withdraw agree on one session: what either leaves of it, the other leaves too."""

import json
from pathlib import Path

import sense4hri_session
from metadata_registry.participants import Participants
from metadata_registry.people import session_of
from metadata_registry.registry import Registry
from metadata_registry.store import Assignment, Store
from sense4hri.names import StreamName
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import SessionState
from sense4hri_session.withdraw import withdraw

ME, SECOND = "zqkow77", 1_000_000_000
START_NS = 1_700_000_000 * SECOND
WORN = {"h10_1": ME, "verity_1": "p2", "eda_1": "p2"}
PARAMETERS = {
    "h10_1": {"human_id": ME, "gain": 2},
    "verity_1": {"human_id": "p2", "seen": ME, "rate": 55},
    "eda_1": {"human_id": "p2"},
}
SESSION = {
    "session_id": f"visit-{ME}",
    "study": "Trust",
    "task": f"{ME}_alone",
    "human_ids": [ME, "p2"],
    "directory": f"/r/Trust/{ME}-p2/visit-{ME}",
    "metadata_json": json.dumps({"room": 3, ME: {"age": 30}, "who": [ME, "p2"]}),
    "phase": SessionState.RECORDING,
}


def record(study) -> Path:
    """The session as a recording: who wears what, the sensors as their drivers describe themselves, the session."""
    assignments = [{"sensor_id": sensor, "human_id": human} for sensor, human in WORN.items()]
    study.add("/study/assignments", "SensorAssignmentArray", START_NS, assignments=assignments)
    sensors = [
        study.sensor(f"{human}/ecg/{sensor}", 130.0, "uV", ["ecg"], 14, parameters_json=json.dumps(PARAMETERS[sensor]))
        for sensor, human in WORN.items()
    ]
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=sensors)
    study.add("/study/session", "SessionState", START_NS, **SESSION)
    return study.write()


def keep(path: Path) -> tuple[Store, Registry]:
    """The same in a registry."""
    store = Store(path)
    registry = Registry(store)
    for sensor, human in WORN.items():
        registry.seen(StreamName(human, "ecg", sensor), f"/driver_{sensor}", "", PARAMETERS[sensor], START_NS)
    store.past.begin(session_of(SessionState(**SESSION, start_at=from_ns(START_NS))))
    store.past.end("ended")
    return store, registry


def test_both_leave_the_same_of_a_session(study, tmp_path: Path) -> None:
    """Assignments, sensors with their parameters, and the session: equal, and nowhere the pseudonym."""
    folder = withdraw(record(study), ME).now
    store, registry = keep(tmp_path / "r.sqlite")
    Participants(store, registry).remove(ME, ())
    recorded = sense4hri_session.open(folder)

    (worn,) = recorded.table("/study/assignments")["assignments"]
    kept: list[Assignment] = [a for a in registry.assignments() if a.human_id != "unassigned"]
    assert {a["sensor_id"]: a["human_id"] for a in worn} == {a.sensor_id: a.human_id for a in kept}

    (sensors,) = recorded.table("/study/sensors")["sensors"]
    told = {s["sensor_id"]: json.loads(s["parameters_json"]) for s in sensors}
    assert told == {s.sensor_id: json.loads(s.parameters_json) for s in registry.sensors()}
    assert told == {r.sensor_id: json.loads(r.parameters_json) for r in store.past.readings()}
    assert told["verity_1"] == {"human_id": "p2", "rate": 55}

    session, (row,) = recorded.table("/study/session").iloc[0], store.past.sessions()
    for field in ("session_id", "study", "task", "directory"):
        assert session[field] == getattr(row, field), field
    assert list(session["human_ids"]) == list(row.human_ids) == ["p2"]
    assert json.loads(session["metadata_json"]) == json.loads(row.metadata_json) == {"room": 3, "who": ["p2"]}
    assert not any(ME.encode() in file.read_bytes() for file in tmp_path.glob("r.sqlite*"))


def test_whose_folder_would_bear_the_same_name_keeps_everything(study, tmp_path: Path) -> None:
    """`p1_` is taken out of both, `p1` stays in both: a folder's name has no room for what tells them apart."""
    people = {"study": "Trust", "human_ids": ["p1", "p1_"], "directory": "/r/Trust/p1-p1/visit-p1"}
    said = {**SESSION, **people, "session_id": "visit-p1", "task": "", "metadata_json": '{"p1": {"age": 30}, "p1_": 1}'}
    worn = [{"sensor_id": "h10_1", "human_id": "p1"}, {"sensor_id": "h10_2", "human_id": "p1_"}]
    study.add("/study/assignments", "SensorAssignmentArray", START_NS, assignments=worn)
    study.add("/study/session", "SessionState", START_NS, **said)
    study.add("/study/markers", "Marker", START_NS, name="note", value="p1 moved", human_id="p1")
    recorded = sense4hri_session.open(withdraw(study.write(), "p1_").now)
    store = Store(tmp_path / "r.sqlite")
    store.past.begin(session_of(SessionState(**said, start_at=from_ns(START_NS))))
    store.past.end("ended")
    Participants(store, Registry(store)).remove("p1_", ())

    session, (row,) = recorded.table("/study/session").iloc[0], store.past.sessions()
    for field in ("session_id", "directory"):
        assert session[field] == getattr(row, field) == said[field], field
    assert list(session["human_ids"]) == list(row.human_ids) == ["p1"]
    assert json.loads(session["metadata_json"]) == json.loads(row.metadata_json) == {"p1": {"age": 30}}
    assert list(recorded.table("/study/markers")["value"]) == ["p1 moved"]
