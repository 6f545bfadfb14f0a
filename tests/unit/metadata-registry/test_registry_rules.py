"""Who wears what: operator against configuration, over restarts, and requests that cannot be done."""

import json
import math
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from metadata_registry import cli
from metadata_registry.registry import MOST_SENSORS, Registry
from metadata_registry.sensors import Claim, Duplicates, Sensor, describe, parameters_json
from metadata_registry.store import Assignment, Store, opened
from sense4hri.errors import ConfigError
from sense4hri.names import StreamName

ECG = StreamName("p1", "ecg", "h10_1")
PARAMETERS = {
    "human_id": "p1",
    "sensor_id": "h10_1",
    "vendor": "Polar",
    "model": "H10",
    "serial_number": "6080292F",
    "transport_delay_s": 0,
    "ecg.sampling_frequency_hz": 130,
    "ecg.unit": "uV",
    "ecg.range_min": -20000.0,
    "ecg.range_max": 20000.0,
    "ecg.resolution_bits": 14,
    "ecg.channel_names": ["ecg"],
    "accelerometer.unit": "m/s^2",
}


def registry(path: Path) -> Registry:
    return Registry(Store(path / "r.sqlite"))


def test_parameters_become_a_description() -> None:
    """A driver's parameters describe the stream they belong to, whole numbers accepted for floats."""
    sensor = describe(Sensor("h10_1", "ecg", "p1"), PARAMETERS)
    assert (sensor.vendor, sensor.model, sensor.serial_number) == ("Polar", "H10", "6080292F")
    assert (sensor.unit, sensor.sampling_frequency_hz, sensor.resolution_bits) == ("uV", 130.0, 14)
    assert sensor.channel_names == ("ecg",)
    assert json.loads(sensor.parameters_json)["accelerometer.unit"] == "m/s^2"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ecg.unit", 5),
        ("ecg.sampling_frequency_hz", "fast"),
        ("ecg.sampling_frequency_hz", True),
        ("ecg.resolution_bits", -1),
        ("ecg.resolution_bits", 1.5),
        ("ecg.channel_names", "ecg"),
        ("ecg.channel_names", [1, 2]),
        ("ecg.channel_names", True),
        ("vendor", None),
    ],
)
def test_mistyped_parameters_are_left_out(name: str, value: object) -> None:
    """A parameter of a wrong type leaves what was known, and stays readable in parameters_json."""
    known = describe(Sensor("h10_1", "ecg", "p1"), PARAMETERS)
    again = describe(known, {name: value})
    assert again.unit == "uV"
    assert again.sampling_frequency_hz == 130.0
    assert again.resolution_bits == 14
    assert again.channel_names == ("ecg",)
    assert json.loads(again.parameters_json) == {name: value}


NUMBERS = st.floats() | st.integers(-(2**40), 2**40)
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)  # all that a message can carry
VALUES = st.none() | st.booleans() | NUMBERS | TEXTS | st.lists(TEXTS, max_size=4) | st.lists(NUMBERS, max_size=4)
WILD = st.dictionaries(st.sampled_from([*PARAMETERS, "firmware_version", "body_location"]), VALUES)


@settings(max_examples=200, deadline=None)
@given(WILD)
@example({"transport_delay_s": math.nan})
@example({"ecg.channel_names": ["x" * 60_000] * 20})
def test_whatever_a_driver_says_can_be_read_back(told: dict[str, Any]) -> None:
    """What is kept of any parameters is the same after a restart: no driver can make the file unreadable."""
    sensor = describe(Sensor("h10_1", "ecg", "p1"), told)
    store = Store(":memory:")
    store.save(sensor)
    assert repr(store.sensors()) == repr([sensor])
    store.close()


def test_a_delay_that_nobody_knows_stays_as_it_was(tmp_path: Path) -> None:
    """Half a second stays half a second where the driver then says NaN; a file that holds none is read as NaN."""
    known = describe(Sensor("h10_1", "ecg", "p1"), {"transport_delay_s": 0.5})
    assert describe(known, {"transport_delay_s": math.nan}).transport_delay_s == 0.5
    path = tmp_path / "r.sqlite"
    registry(tmp_path).seen(ECG, "/d", "h", PARAMETERS, 1)
    changed(path, "UPDATE sensors SET transport_delay_s = ?", None)
    assert math.isnan(Store(path).sensors()[0].transport_delay_s)


def test_nan_is_null_in_json() -> None:
    """What JSON cannot say becomes null, not the illegal token NaN."""
    assert (
        parameters_json({"b": math.nan, "a": [1.0, math.inf], "c": b"\x01"})
        == '{"a": [1.0, null], "b": null, "c": [1]}'
    )


def test_configuration_counts_where_no_operator_spoke(tmp_path: Path) -> None:
    """A driver's own human_id is its assignment, source config, and follows the driver."""
    r = registry(tmp_path)
    r.seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    r.settle({"h10_1": {"p2"}}, 200)
    assert r.assignments() == [Assignment("h10_1", "p2", "", 200, "config")]
    assert r.wanted("h10_1") is None


def test_operator_outlives_registry_and_driver(tmp_path: Path) -> None:
    """The newest operator assignment is still wanted after both have restarted, whatever the driver's YAML says."""
    r = registry(tmp_path)
    r.seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    assert r.assign("h10_1", "p7", "", 200).success
    assert r.assign("h10_1", "p8", "anna", 300).success
    again = registry(tmp_path)
    again.seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 400)
    assert again.wanted("h10_1") == "p8"
    again.settle({"h10_1": {"p8"}}, 500)
    assert again.assignments() == [Assignment("h10_1", "p8", "anna", 500, "operator")]
    assert registry(tmp_path).assignments() == again.assignments()


def test_an_assignment_holds_once_the_topics_bear_it(tmp_path: Path) -> None:
    """Until the graph shows it the old one holds, on disk too, and a sentence says what was asked for."""
    r = registry(tmp_path)
    r.seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    assert r.assign("h10_1", "p2", "anna", 200).success
    for worn in ({"p1"}, {"p1", "p2"}):
        r.settle({"h10_1": worn}, 300)
        assert registry(tmp_path).assignments() == r.assignments() == [Assignment("h10_1", "p1", "", 100, "config")]
        assert "human_id 'p2' was asked for" in r.not_done({"h10_1": worn})["h10_1"]
    r.settle({"h10_1": {"p2"}}, 400)
    assert r.assignments() == [Assignment("h10_1", "p2", "anna", 400, "operator")]
    assert r.not_done({"h10_1": {"p2"}}) == {}


def test_a_driver_that_goes_back_is_not_believed_to_have_stayed(tmp_path: Path) -> None:
    """Where a driver comes back under its own name, that is who wears it until its topics bear the order again."""
    r = registry(tmp_path)
    r.seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    r.assign("h10_1", "p2", "anna", 200)
    for at_ns, human_id in ((300, "p2"), (400, "p1"), (500, "p2")):
        r.settle({"h10_1": {human_id}}, at_ns)
    told = [
        (a.human_id, a.person_id, a.since_ns, a.source, a.confidence)
        for a in Store(tmp_path / "r.sqlite").history("h10_1")
    ]
    assert told == [
        ("p1", "", 100, "config", 1.0),
        ("p2", "anna", 200, "operator", 0.0),
        ("p2", "anna", 300, "operator", 1.0),
        ("p1", "", 400, "config", 1.0),
        ("p2", "anna", 500, "operator", 1.0),
    ]


def test_another_person_on_the_same_human_holds_at_once(tmp_path: Path) -> None:
    """Nothing has to move where only the ROS4HRI person is another."""
    r = registry(tmp_path)
    r.seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    r.assign("h10_1", "p1", "anna", 200)
    assert r.assignments() == [Assignment("h10_1", "p1", "anna", 200, "operator")]


def test_history_is_kept(tmp_path: Path) -> None:
    """Every assignment ever made stays in the store, in order."""
    store = Store(tmp_path / "r.sqlite")
    for number, human_id in enumerate(("p1", "p2", "p1")):
        store.assign(Assignment("h10_1", human_id, "", number, "operator"))
    assert [a.human_id for a in store.history("h10_1")] == ["p1", "p2", "p1"]


def test_a_later_config_does_not_displace_an_order(tmp_path: Path) -> None:
    """What an operator wants stays wanted, whatever the topics have borne since."""
    store = Store(tmp_path / "r.sqlite")
    store.assign(Assignment("h10_1", "p1", "", 1, "operator"))
    store.assign(Assignment("h10_1", "p2", "", 2, "config"))
    assert store.orders()["h10_1"].human_id == "p1"
    assert store.assignments()["h10_1"].human_id == "p2"


@pytest.mark.parametrize("human_id", ["", "1p", "p__1", "p-1", "p 1", "p/1", "a" * 64, "é"])
def test_illegal_human_id_is_named(tmp_path: Path, human_id: str) -> None:
    """A human_id that cannot stand in a topic name is refused by name, and nothing is kept."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    outcome = r.assign("h10_1", human_id, "", 2)
    assert not outcome.success
    assert "human_id" in outcome.message
    assert repr(human_id) in outcome.message
    assert r.wanted("h10_1") is None


@pytest.mark.parametrize("human_id", ["nobody", "Everyone", "withdrawn", "UNASSIGNED"])
def test_a_word_that_means_something_else_is_nobody_s_pseudonym(tmp_path: Path, human_id: str) -> None:
    """However it is written, and with its meaning; one that only contains it is somebody's."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    outcome = r.assign("h10_1", human_id, "", 2)
    assert (outcome.success, outcome.field) == (False, "human_id")
    assert f"human_id '{human_id}' is no participant: it means " in outcome.message
    assert r.assign("h10_1", f"{human_id}_1", "", 3).success


@pytest.mark.parametrize(
    ("sensor_id", "named"), [("H10", "not legal"), ("", "not legal"), ("h10_2", "known are: h10_1")]
)
def test_unknown_sensor_is_named(tmp_path: Path, sensor_id: str, named: str) -> None:
    """A sensor_id that is illegal or never seen is refused, with what is known."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    outcome = r.assign(sensor_id, "p1", "", 2)
    assert not outcome.success
    assert repr(sensor_id) in outcome.message
    assert named in outcome.message


def test_illegal_person_id_is_named(tmp_path: Path) -> None:
    """A person_id that cannot be a ROS4HRI topic, also by its length, is refused."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    assert "person_id 'a b'" in r.assign("h10_1", "p1", "a b", 2).message
    assert r.assign("h10_1", "p1", "a" * 101, 2).field == "person_id"
    assert r.assign("h10_1", "p1", "a" * 100, 2).success


def test_a_sensor_that_nobody_wears_names_no_person(tmp_path: Path) -> None:
    """Who takes a sensor off does not say whose face it is: that would take the face from who wears another one."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    outcome = r.assign("h10_1", "unassigned", "anna", 2)
    assert (outcome.success, outcome.field) == (False, "person_id")
    assert "person_id 'anna'" in outcome.message
    assert r.wanted("h10_1") is None


@pytest.mark.parametrize("wrong", ["sensor_id", "human_id", "person_id"])
def test_what_is_refused_is_said_in_one_short_line(tmp_path: Path, wrong: str) -> None:
    """However long it is: every refusal is logged, and anybody on the graph may ask."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    outcome = r.assign(**{"sensor_id": "h10_1", "human_id": "p1", "person_id": "", wrong: "X-" * 500_000}, now_ns=2)
    assert (outcome.success, outcome.field) == (False, wrong)
    assert len(outcome.message) < 300


def test_absent_driver_is_said(tmp_path: Path) -> None:
    """An assignment to a sensor whose driver is away succeeds and says when it will take effect."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    r.online(set())
    outcome = r.assign("h10_1", "p2", "", 2)
    assert outcome.success
    assert "will be set when it is back" in outcome.message
    assert not r.sensors()[0].online


def test_one_person_on_two_humans_is_said(tmp_path: Path) -> None:
    """A person_id named for two human_ids is accepted, since a swap passes through that, and said."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    r.seen(StreamName("p2", "ppg", "verity_1"), "/e", "", {}, 1)
    r.assign("h10_1", "p1", "anna", 2)
    outcome = r.assign("verity_1", "p2", "anna", 3)
    assert outcome.success
    assert "still named for p1" in outcome.message


def test_duplicate_keeps_first_and_cannot_be_assigned(tmp_path: Path) -> None:
    """A sensor_id claimed by two nodes keeps the description of the first, and an assignment names both nodes."""
    r = registry(tmp_path)
    r.seen(ECG, "/driver_a_h10_1", "", PARAMETERS, 1)
    r.duplicates = {"h10_1": ("/driver_a_h10_1", "/driver_b_h10_1")}
    r.seen(ECG, "/driver_b_h10_1", "", {**PARAMETERS, "vendor": "Other"}, 2)
    assert r.sensors()[0].vendor == "Polar"
    outcome = r.assign("h10_1", "p2", "", 3)
    assert not outcome.success
    assert "/driver_a_h10_1 and /driver_b_h10_1" in outcome.message


def test_other_node_is_a_duplicate_at_once() -> None:
    """Two different nodes with one sensor_id are found after a second, and forgotten when one goes."""
    finder, a, b = Duplicates(), Claim("x", "/a", "1"), Claim("x", "/b", "2")
    assert finder.find([a, b], 0.0) == {}
    assert finder.find([a, a, b], 1.5) == {"x": ("/a", "/b")}
    assert finder.find([b], 2.0) == {}


def test_a_crashed_run_is_no_duplicate() -> None:
    """A driver that crashes and comes back again and again is not taken for two, although DDS still shows dead runs."""
    finder = Duplicates()
    for second in range(0, 100, 5):
        runs = [Claim("x", "/a", str(second // 5 - age)) for age in range(4)]
        assert finder.find(runs, float(second)) == {}


def test_the_same_node_twice_is_found_in_the_end() -> None:
    """Two runs of one node that both stay longer than any lease are a duplicate."""
    finder, runs = Duplicates(), [Claim("x", "/a", "1"), Claim("x", "/a", "2")]
    finder.find(runs, 0.0)
    assert finder.find(runs, 25.0) == {}
    assert finder.find(runs, 31.0) == {"x": ("/a", "/a")}


def test_sensors_come_back_offline_and_whole(tmp_path: Path) -> None:
    """After a restart every sensor is known as before, NaN included, but offline."""
    store = Store(tmp_path / "r.sqlite")
    whole = describe(Sensor("h10_1", "ecg", "p1", online=True), PARAMETERS)
    bare = Sensor("x", "eda", "p2")
    store.save(whole)
    store.save(bare)
    loaded = Store(tmp_path / "r.sqlite").sensors()
    assert repr(loaded) == repr([describe(Sensor("h10_1", "ecg", "p1"), PARAMETERS), bare])


def test_list_by_person(tmp_path: Path) -> None:
    """The sensors of one person are those that publish under it."""
    r = registry(tmp_path)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    r.seen(StreamName("p2", "ppg", "verity_1"), "/e", "", {}, 1)
    assert [s.sensor_id for s in r.sensors("p2")] == ["verity_1"]
    assert len(r.sensors()) == 2


def test_full_disk_is_said(tmp_path: Path) -> None:
    """Where the assignment cannot be written it is not made, and the operator hears why."""
    store = Store(tmp_path / "r.sqlite")
    r = Registry(store)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    store._db.execute("PRAGMA query_only=ON")
    outcome = r.assign("h10_1", "p2", "", 2)
    assert not outcome.success
    assert "cannot write its database" in outcome.message
    assert r.wanted("h10_1") is None
    with pytest.raises(sqlite3.Error):
        r.seen(ECG._replace(human_id="p3"), "/d", "", PARAMETERS, 3)


def test_what_a_full_disk_did_not_take_is_written_once_it_does(tmp_path: Path) -> None:
    """What the graph shows is told at once, and kept with the times at which it was true as soon as it can be."""
    store = Store(tmp_path / "r.sqlite")
    r = Registry(store)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    store._db.execute("PRAGMA query_only=ON")
    new = StreamName("p2", "ppg", "verity_1")
    for keep in (
        lambda: r.seen(new, "/e", "", {"sensor_id": "verity_1", "vendor": "Polar"}, 2),
        lambda: r.settle({"h10_1": {"p3"}}, 3),
        lambda: r.settle({}, 4),
    ):
        with pytest.raises(sqlite3.Error):
            keep()
    assert [(s.sensor_id, s.human_id) for s in r.sensors()] == [("h10_1", "p3"), ("verity_1", "p2")]
    store._db.execute("PRAGMA query_only=OFF")
    r.settle({}, 5)
    again = Store(tmp_path / "r.sqlite")
    assert [(w.sensor_id, w.human_id, w.since_ns) for w in again.past.worn()] == [
        ("h10_1", "p1", 1),
        ("h10_1", "p3", 3),
        ("verity_1", "p2", 2),
    ]
    assert {s.sensor_id: s.vendor for s in again.sensors()} == {"h10_1": "Polar", "verity_1": "Polar"}
    assert [(reading.sensor_id, reading.read_ns) for reading in again.past.readings()] == [
        ("h10_1", 1),
        ("verity_1", 2),
    ]
    r.settle({}, 6)
    assert len(again.past.worn()) == 3


def test_an_order_comes_after_what_was_true_before_it(tmp_path: Path) -> None:
    """What waits for the disk is written before an order, so that a restart takes the newest for true."""
    store = Store(tmp_path / "r.sqlite")
    r = Registry(store)
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    store._db.execute("PRAGMA query_only=ON")
    with pytest.raises(sqlite3.Error):
        r.settle({"h10_1": {"p3"}}, 2)
    assert not r.assign("h10_1", "p3", "anna", 3).success
    store._db.execute("PRAGMA query_only=OFF")
    assert r.assign("h10_1", "p3", "anna", 4).success
    again = registry(tmp_path).assignments()
    assert [(a.human_id, a.person_id, a.since_ns) for a in again] == [("p3", "anna", 4)]


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    """A file that cannot be made, another program's or a newer version's is a configuration error that names it."""
    foreign = tmp_path / "foreign.sqlite"
    sqlite3.connect(foreign).execute("CREATE TABLE t (x)").connection.close()
    newer = tmp_path / "newer.sqlite"
    sqlite3.connect(newer).execute("PRAGMA user_version=99").connection.close()
    for path in (foreign, newer, tmp_path / "no" / "folder.sqlite"):
        with pytest.raises(ConfigError, match=path.name):
            Store(path)


@pytest.mark.parametrize("version", [0, 1, 2, 3])
def test_a_foreign_file_stays_as_it_is(tmp_path: Path, version: int) -> None:
    """Whatever version its program counts: no byte of it changes, and nothing comes to lie beside it."""
    path = tmp_path / "foreign.sqlite"
    sqlite3.connect(path).executescript(f"CREATE TABLE t (x); PRAGMA user_version={version}").connection.close()
    before = path.read_bytes()
    with pytest.raises(ConfigError, match="somebody else's"):
        Store(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


DAMAGE = {
    "no SQLite at all": lambda path: path.write_bytes(b"garbage" * 2000),
    "a page of it is gone": lambda path: path.write_bytes(path.read_bytes()[:4096] + b"\x01" * 8192),
    "channel names nested for ever": lambda path: changed(path, "UPDATE sensors SET channel_names = ?", "[" * 90_000),
    "channel names that are no list": lambda path: changed(path, "UPDATE sensors SET channel_names = ?", "5"),
    "parameters that are no JSON": lambda path: changed(path, "UPDATE sensors SET parameters_json = ?", "{"),
    "a number that is text": lambda path: changed(path, "UPDATE sensors SET resolution_bits = ?", "many"),
    "text that is no UTF-8": lambda path: changed(path, "UPDATE sensors SET unit = CAST(? AS TEXT)", b"\xff\xfe"),
    "the page without which nothing can be assigned": lambda path: zeroed(path, "sqlite_sequence"),
    "the index of sessions": lambda path: zeroed(path, "sqlite_autoindex_sessions_1"),
    "a reading that is no JSON": lambda path: changed(path, "UPDATE readings SET parameters_json = ?", "{"),
    "an assignment since never": lambda path: changed(path, "UPDATE assignments SET since_ns = ?", "never"),
}


def zeroed(path: Path, name: str) -> None:
    with sqlite3.connect(path) as db:
        (page,) = db.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (name,)).fetchone()
    db.close()
    content = bytearray(path.read_bytes())
    content[4096 * (page - 1) : 4096 * page] = bytes(4096)
    path.write_bytes(content)


def changed(path: Path, statement: str, value: object) -> None:
    with sqlite3.connect(path) as db:
        db.execute(statement, (value,))
    db.close()


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_damaged_store_is_set_aside(tmp_path: Path, damage: Callable[[Path], object]) -> None:
    """One line says where it lies now; the registry begins anew, and again with what it keeps from then on."""
    path = tmp_path / "r.sqlite"
    store = Store(path)
    Registry(store).seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    store.close()
    damage(path)
    before, said = path.read_bytes(), []
    store = opened(str(path), said.append)
    assert store.sensors() == []
    Registry(store).seen(ECG, "/driver_polar_h10_1", "host", PARAMETERS, 100)
    store.close()
    assert len(opened(str(path), said.append).sensors()) == 1
    (line,) = said
    (aside,) = tmp_path.glob("r.sqlite.damaged-*")
    assert str(aside) in line
    assert aside.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["h10_1"], "Name the participant too"),
        (["H10", "p1"], "'H10' is no sensor_id"),
        (["h10_1", "p 1"], "'p 1' is no pseudonym"),
        (["h10_1", "p1", "x"], "unrecognized arguments: x"),
    ],
)
def test_what_cannot_be_assigned_is_said_at_once(capsys, arguments: list[str], said: str) -> None:
    """The command names what is wrong before it looks for a registry; status 2."""
    with pytest.raises(SystemExit, match="2"):
        cli.main(arguments)
    assert said in capsys.readouterr().err


def test_the_number_of_streams_is_bounded(tmp_path: Path) -> None:
    """What a stranger publishes without end is left out, and those that were known go on."""
    r = registry(tmp_path)
    r._sensors |= {(f"x_{n}", "ecg"): Sensor(f"x_{n}", "ecg", "p1") for n in range(MOST_SENSORS - 1)}
    r.seen(ECG, "/d", "", PARAMETERS, 1)
    assert not r.full
    r.seen(ECG._replace(sensor_id="one_more"), "/d", "", {}, 2)
    assert r.full
    assert len(r.sensors()) == MOST_SENSORS
    assert r.assign("h10_1", "p2", "", 3).success
