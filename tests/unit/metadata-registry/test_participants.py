"""What was, by participant: exported whole, deleted whole, bounded, and never lost once it is acknowledged."""

import json
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from metadata_registry import past
from metadata_registry import store as store_module
from metadata_registry.participants import Participants
from metadata_registry.past import Session, Worn
from metadata_registry.people import MOST_HUMANS, session_of
from metadata_registry.registry import Registry
from metadata_registry.sensors import LONGEST_PARAMETERS
from metadata_registry.store import Assignment, Store, opened
from sense4hri.errors import Refusal
from sense4hri.names import StreamName
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import SessionState

ME = "zqkow77"
ECG = StreamName(ME, "ecg", "h10_1")
DRIVER = {"human_id": ME, "sensor_id": "h10_1", "gain": 1}


def visit(human_ids: tuple[str, ...], start_ns: int = 100, session_id: str = f"visit-{ME}") -> Session:
    metadata = json.dumps({"room": 3, "who": list(human_ids)})
    folder = f"/r/Trust/{'-'.join(human_ids)}/visit"
    return Session(session_id, start_ns, 0, "running", "Trust", "rest", folder, metadata, human_ids)


def study(path: Path) -> tuple[Store, Registry, Participants]:
    """Me, then p2, then me again on one sensor; a second sensor on p2; a session of both, another of p2."""
    store = Store(path / "r.sqlite")
    registry = Registry(store)
    registry.seen(ECG, "/driver_h10", "host", DRIVER, 100)
    told = {"human_id": "p2", "with": ME, "body_location": f"wrist beside {ME}"}
    registry.seen(StreamName("p2", "ppg", "verity_1"), "/driver_verity", "host", told, 110)
    registry.assign("h10_1", "p2", "anna", 190)
    registry.settle({"h10_1": {"p2"}}, 200)
    registry.seen(ECG._replace(human_id="p2"), "/driver_h10", "host", DRIVER | {"human_id": "p2"}, 210)
    registry.assign("h10_1", ME, "berta", 290)
    registry.settle({"h10_1": {ME}}, 300)
    registry.seen(ECG, "/driver_h10", "host", DRIVER | {"gain": 2}, 310)
    store.past.begin(visit((ME, "p2"), 150))
    store.past.begin(visit(("p2",), 250, "visit-2"))
    store.past.end("ended")
    return store, registry, Participants(store, registry)


def test_everything_about_one_participant_is_told(tmp_path: Path) -> None:
    """From when to when it wore what and by whose word, how that sensor was set then, its sessions; nothing of p2."""
    _, _, participants = study(tmp_path)
    everything = participants.of(ME)
    assert [(w.sensor_id, w.since_ns, w.until_ns, w.source, w.person_id) for w in everything.assignments] == [
        ("h10_1", 100, 200, "config", ""),
        ("h10_1", 300, 0, "operator", "berta"),
    ]
    assert [order.since_ns for order in everything.orders] == [290]
    read = [(r.read_ns, r.until_ns, json.loads(r.parameters_json)["gain"]) for r in everything.readings]
    assert read == [(100, 210, 1), (310, 0, 2)]
    assert [s.session_id for s in everything.sessions] == [f"visit-{ME}"]
    assert {s.sensor_id for s in everything.sensors} == {"h10_1"}
    told = [(p.human_id, p.sensors, p.sessions, p.first_ns) for p in participants.all()]
    assert told == [("p2", ("verity_1",), 2, 110), (ME, ("h10_1",), 1, 100)]


@pytest.mark.parametrize("says_who", [True, False], ids=["a driver that says whom", "a driver that does not"])
def test_a_clock_that_is_set_back_mixes_no_readings_up(tmp_path: Path, says_who: bool) -> None:
    """Each is told what was read of the sensor on them, and nothing of the next wearer, whatever the clock showed."""
    registry = Registry(store := Store(tmp_path / "r.sqlite"))
    for human_id, moved_ns, read_ns in ((ME, 1000, 1001), ("p2", 510, 515), ("p3", 5, 7)):
        registry.settle({"h10_1": {human_id}}, moved_ns)
        told = {"sensor_id": "h10_1"} | ({"human_id": human_id} if says_who else {})
        registry.seen(ECG._replace(human_id=human_id), "/driver_h10", "host", told, read_ns)
    participants = Participants(store, registry)
    for human_id, read_ns in ((ME, 1001), ("p2", 515), ("p3", 7)):
        assert [one.read_ns for one in participants.of(human_id).readings] == [read_ns]


def test_nothing_that_was_ends_before_it_begins(tmp_path: Path) -> None:
    """Where the clock was set back, how long a thing lasted is not known: it ends where it began."""
    registry = Registry(store := Store(tmp_path / "r.sqlite"))
    for human_id, now_ns in ((ME, 1000), ("p2", 500), ("p3", 600)):
        registry.seen(ECG._replace(human_id=human_id), "/driver_h10", "host", {"human_id": human_id}, now_ns)
        registry.settle({"h10_1": {human_id}}, now_ns)
    assert [(one.since_ns, one.until_ns) for one in store.past.worn()] == [(1000, 1000), (500, 600), (600, 0)]
    assert [(one.read_ns, one.until_ns) for one in store.past.readings()] == [(1000, 1000), (500, 600), (600, 0)]


def test_parameters_read_after_a_silent_move_are_the_new_wearer_s(tmp_path: Path) -> None:
    """A driver that does not answer when its topics move, and then as before, has been read on the one it is on now."""
    registry = Registry(store := Store(tmp_path / "r.sqlite"))
    for human_id, told, now_ns in ((ME, {"gain": 1}, 100), ("p2", {}, 200), ("p2", {"gain": 1}, 210)):
        registry.settle({"h10_1": {human_id}}, now_ns)
        registry.seen(ECG._replace(human_id=human_id), "/driver_h10", "host", told, now_ns)
    assert [one.read_ns for one in Participants(store, registry).of("p2").readings] == [210]


def test_a_driver_is_read_for_whom_it_says(tmp_path: Path) -> None:
    """What it answers before its topics bear the next wearer's name is the next one's, and kept once."""
    registry = Registry(store := Store(tmp_path / "r.sqlite"))
    for topics, told, now_ns in ((ME, ME, 100), (ME, "p2", 200), ("p2", "p2", 210)):
        registry.seen(ECG._replace(human_id=topics), "/driver_h10", "host", DRIVER | {"human_id": told}, now_ns)
    assert [(one.read_ns, one.until_ns) for one in store.past.readings(ME)] == [(100, 200)]
    assert [(one.read_ns, one.until_ns) for one in store.past.readings("p2")] == [(200, 0)]


def test_a_reader_that_keeps_the_log_is_told(tmp_path: Path) -> None:
    """What the deleted one left is then still in a file, until the registry is started with nobody reading."""
    store, _, participants = study(tmp_path)
    with closing(sqlite3.connect(tmp_path / "r.sqlite", isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM sensors").fetchall()
        assert participants.remove(ME, ()).in_log
    store.close()
    Store(tmp_path / "r.sqlite").close()
    assert not any(ME.encode() in file.read_bytes() for file in tmp_path.iterdir())


def test_a_log_that_cannot_be_emptied_is_told_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is deleted is deleted, and forgotten, also where the disk takes no more once that is written."""
    store, registry, participants = study(tmp_path)
    registry.settle({"h10_1": {"p2"}}, 400)

    def fold() -> bool:
        raise sqlite3.OperationalError("disk I/O error")

    monkeypatch.setattr(store.past, "fold", fold)
    assert participants.remove(ME, ()).in_log
    assert ME not in repr(registry.sensors())
    assert [one.human_id for one in participants.all()] == ["p2"]


def test_a_deleted_participant_is_in_no_byte_and_brings_no_older_wearer_back(tmp_path: Path) -> None:
    """Neither file nor log holds the name; the sensor is on nobody, p2 keeps all it had, also after a restart."""
    store, registry, participants = study(tmp_path)
    before = [w for w in store.past.worn() if w.human_id == "p2"]
    assert any(ME.encode() in file.read_bytes() for file in tmp_path.iterdir())
    removed = participants.remove(ME, ())
    assert (removed.assignments, removed.sensors, removed.sessions) == (3, 1, 1)
    assert not any(ME.encode() in file.read_bytes() for file in tmp_path.iterdir())
    store.close()
    assert not any(ME.encode() in file.read_bytes() for file in tmp_path.iterdir())
    for one in (registry, Registry(again := Store(tmp_path / "r.sqlite"))):
        assert [(a.sensor_id, a.human_id, a.person_id) for a in one.assignments()] == [
            ("h10_1", "unassigned", ""),
            ("verity_1", "p2", ""),
        ]
        assert one.wanted("h10_1") == "unassigned"
    assert [w for w in again.past.worn() if w.human_id == "p2"] == before
    assert [(s.session_id, s.human_ids) for s in again.past.sessions()] == [
        ("visit-withdrawn", ("p2",)),
        ("visit-2", ("p2",)),
    ]
    with pytest.raises(Refusal, match="is not known"):
        Participants(again, Registry(again)).of(ME)


def test_what_others_say_of_a_deleted_participant_goes_too(tmp_path: Path) -> None:
    """As the person of another one, in the name of a node, a host or a channel; the rest of it stays."""
    store, registry, participants = study(tmp_path)
    told = {"human_id": "p2", "eda.unit": f"uS of {ME}", "eda.channel_names": ["eda", f"{ME}-left"]}
    registry.seen(StreamName("p2", "eda", "e4_1"), f"/{ME}/driver_e4", f"{ME}-laptop", told, 120)
    registry.assign("e4_1", "p2", ME, 130)
    participants.remove(ME, ())
    store.close()
    assert not any(ME.encode() in file.read_bytes() for file in tmp_path.iterdir())
    again = Store(tmp_path / "r.sqlite")
    assert again.assignments()["e4_1"] == Assignment("e4_1", "p2", "", 130, "operator")
    (sensor,) = [one for one in again.sensors() if one.sensor_id == "e4_1"]
    assert (sensor.node, sensor.host, sensor.unit) == ("/withdrawn/driver_e4", "withdrawn-laptop", "uS of withdrawn")
    assert sensor.channel_names == ("eda", "withdrawn-left")


def test_a_sensor_that_bears_the_name_is_told_also_where_only_its_past_is_known(tmp_path: Path) -> None:
    """Its description went with who wore it last; who wore it when stays, under the name that it has."""
    store, registry, participants = study(tmp_path)
    registry.seen(StreamName("p3", "eda", f"{ME}_box"), "/driver_box", "host", {"human_id": "p3"}, 120)
    participants.remove("p3", ())
    assert participants.remove(ME, ()).left == (f"{ME}_box",)
    assert [one.sensor_id for one in store.past.worn()] == ["h10_1", "h10_1", "h10_1", "verity_1", f"{ME}_box"]


def test_who_still_takes_part_is_not_deleted(tmp_path: Path) -> None:
    """While its topics live, its session runs or is prepared, a sentence says what to do first; a name is checked."""
    store, _, participants = study(tmp_path)
    with pytest.raises(Refusal, match="is to wear, h10_1: assign it to 'unassigned' first"):
        participants.remove(ME, ["h10_1"])
    store.past.begin(visit((ME,), 400, "third"))
    with pytest.raises(Refusal, match="session 'third', which runs"):
        participants.remove(ME, ())
    store.past.end("ended")
    with pytest.raises(Refusal, match="session 'fourth', which is being prepared: stop it first"):
        participants.remove(ME, (), visit((ME,), 0, "fourth"))
    for name, why in (("nobody_knows", "is not known"), ("a@b.org", "is no pseudonym"), ("unassigned", "no pseudonym")):
        with pytest.raises(Refusal, match=why):
            participants.remove(name, ())
    assert participants.of(ME).sessions


def test_a_delete_that_cannot_be_written_changes_nothing(tmp_path: Path) -> None:
    """Where the file cannot be written, the answer says so and everything is still there."""
    store, _, participants = study(tmp_path)
    whole = participants.of(ME)
    store._db.execute("PRAGMA query_only=ON")
    with pytest.raises(Refusal, match="nothing is deleted"):
        participants.remove(ME, ())
    assert repr(participants.of(ME)) == repr(whole)


def test_a_long_history_is_not_read_through_for_one_participant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To tell or delete one, only what is theirs and what holds now is taken out of the file and checked."""
    store, registry, participants = study(tmp_path)
    for number in range(300):
        registry.assign("h10_1", f"x{number}", "", 1000 + number)
        registry.settle({"h10_1": {f"x{number}"}}, 1000 + number)
        store.past.begin(visit((f"x{number}",), 1000 + number))
    store.past.end("ended")
    read: list[object] = []
    for module, name in ((store_module, "read"), (past, "parse")):
        counted = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *given, counted=counted: (read.append(given), counted(*given))[1])
    everything = participants.of(ME)
    assert everything.orders
    assert everything.sessions
    participants.remove(ME, ())
    assert 0 < len(read) < 20


def test_a_session_that_was_called_ended_and_runs_is_open_again(tmp_path: Path) -> None:
    """Whoever said IDLE in the middle: the coordinator's next word opens the session again, and brings no name back."""
    store, _, participants = study(tmp_path)
    participants.remove(ME, ())
    store.past.end("failed")
    (first, second) = store.past.sessions()
    assert (first.state, second.state) == ("ended", "ended")
    store.past.begin(visit((ME, "p2"), 250, "visit-2"))
    assert store.past.sessions() == [first, replace(second, state="running")]
    store.past.end("ended")
    assert store.past.sessions() == [first, second]


def test_a_stranger_s_session_is_bounded() -> None:
    """Who is no pseudonym and notes without end are left out."""
    humans = ["p1", "Anna Meier", "a@b.org", *(f"p{n}" for n in range(1000))]
    state = SessionState(session_id="s", phase=2, human_ids=humans, metadata_json='"' + "x" * 100_000 + '"')
    state.start_at = from_ns(5)
    kept = session_of(state)
    assert (len(kept.human_ids), kept.metadata_json, kept.start_ns) == (MOST_HUMANS - 2, "{}", 5)


def test_what_was_is_bounded_and_what_is_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that changes for ever costs a bounded file; the newest of every sensor and every order outlive it."""
    monkeypatch.setattr(past, "MOST_ASSIGNMENTS", 30)
    monkeypatch.setattr(past, "MOST_READINGS", 60)
    monkeypatch.setattr(past, "MOST_SESSIONS", 10)
    store, registry, _ = study(tmp_path)
    for number in range(120):
        registry.settle({"h10_1": {f"x{number}"}}, 1000 + number)
        registry.seen(ECG, "/driver_h10", "host", DRIVER | {"gain": number}, 1000 + number)
        store.past.begin(visit((f"x{number}",), 1000 + number))
    assert len(store.past.readings()) <= past.MOST_READINGS_OF_SENSOR + 1
    assert len(store.past.sessions()) == 10
    assert len(store.past.worn()) <= 30
    again = Registry(Store(tmp_path / "r.sqlite"))
    assert (again.wanted("h10_1"), again.assignments()[0].human_id) == (ME, "x119")
    assert again.assignments()[1].human_id == "p2"


def test_parameters_without_end_are_named_not_kept(tmp_path: Path) -> None:
    """A driver that answers with megabytes costs a line."""
    _, registry, _ = study(tmp_path)
    registry.seen(ECG, "/driver_h10", "host", {"sensor_id": "h10_1", "vendor": "x" * LONGEST_PARAMETERS}, 500)
    told = registry.sensors(ME)[0].parameters_json
    assert len(told) < 200
    assert "characters of parameters" in json.loads(told)["!too_long"]


def test_an_older_file_is_taken_over(tmp_path: Path) -> None:
    """A file of the first version keeps its assignments and gets what it lacks."""
    store = Store(tmp_path / "r.sqlite")
    store.assign(Assignment("h10_1", "p1", "", 1, "config"))
    store.close()
    with sqlite3.connect(tmp_path / "r.sqlite") as db:
        db.executescript("DROP TABLE readings; DROP TABLE sessions; PRAGMA user_version=1;")
    db.close()
    again = Store(tmp_path / "r.sqlite")
    assert again.past.worn() == [Worn("h10_1", "p1", "", 1, 0, "config", 1.0)]
    assert again.past.sessions() == []


def test_readings_of_an_older_file_are_whose_they_were(tmp_path: Path) -> None:
    """By the name their parameters say, where it is a wearer's, else by who wore the sensor then."""
    store, registry, _ = study(tmp_path)
    registry.seen(StreamName("p2", "ppg", "verity_1"), "/driver_verity", "host", {"human_id": "no name"}, 120)
    before = {name: store.past.readings(name) for name in (ME, "p2")}
    store.close()
    with sqlite3.connect(tmp_path / "r.sqlite") as db:
        db.executescript("ALTER TABLE readings DROP COLUMN human_id; PRAGMA user_version=2;")
    db.close()
    again = Store(tmp_path / "r.sqlite")
    assert {name: again.past.readings(name) for name in (ME, "p2")} == before
    assert [len(of_one) for of_one in before.values()] == [2, 3]


def test_an_older_file_that_is_damaged_is_set_aside(tmp_path: Path) -> None:
    """A reading that is no JSON is found out as in a file of this version, not taken for a wrong configuration."""
    store, _, _ = study(tmp_path)
    store.close()
    with sqlite3.connect(tmp_path / "r.sqlite") as db:
        db.executescript("ALTER TABLE readings DROP COLUMN human_id; PRAGMA user_version=2;")
        db.execute("UPDATE readings SET parameters_json = '{'")
    db.close()
    said: list[str] = []
    assert opened(str(tmp_path / "r.sqlite"), said.append).sensors() == []
    assert "set aside" in said[0]


WRITER = """
import sys
from metadata_registry.past import Session
from metadata_registry.store import Assignment, Store
store = Store(sys.argv[1])
for number in range(int(sys.argv[2]), 1_000_000):
    store.assign(Assignment("h10_1", f"p{number}", "", number, "operator"))
    store.past.read("h10_1", f"p{number}", "/d", number, f'{{"gain": {number}}}')
    store.past.begin(Session("s", number, 0, "running", "", "", "", "{}", (f"p{number}",)))
    if number % 7 == 3:
        store.past.remove(f"p{number - 1}", ())
    print(number, flush=True)
"""


def test_killed_at_any_moment_nothing_acknowledged_is_lost(tmp_path: Path) -> None:
    """After each kill -9, amid writing and deleting, every acknowledged entry is there and no deleted one is."""
    path, told, first = tmp_path / "r.sqlite", set(), 0
    for after in (1, 9, 4):
        command = [sys.executable, "-c", WRITER, str(path), str(first)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            told |= {int(writer.stdout.readline()) for _ in range(after)}
            writer.send_signal(signal.SIGKILL)
            told |= {int(line) for line in writer.stdout if line.endswith("\n")}
        store = Store(path)
        names = {one.since_ns: one.human_id for one in store.history("h10_1")}
        gone = {number - 1 for number in told if number % 7 == 3}
        assert {names[number] for number in told & gone} <= {"unassigned"}
        assert all(names[number] == f"p{number}" for number in told - gone if number + 1 in told)
        assert {one.start_ns for one in store.past.sessions()} >= told
        assert max(reading.read_ns for reading in store.past.readings()) >= max(told)
        first = max(names) + 1  # what was written and not yet said is there, or not at all
        store.close()
