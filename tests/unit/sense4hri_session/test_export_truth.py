"""An export leaves nothing out in silence, explains every column by its own message, and is text to every program."""

import csv
import json

import mne
import numpy as np
import pandas as pd
import pyarrow.parquet
import pyedflib
import pytest
import pyxdf
import sense4hri_session
from sense4hri.plain_text import plain
from sense4hri_report.collect import collect
from sense4hri_report.summary import summarise
from sense4hri_session import tables
from sense4hri_session.__main__ import main
from sense4hri_session.definitions import unit_of
from sense4hri_session.export import export
from sense4hri_session.file_names import Names
from sense4hri_session.plain_text import cell

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
TWIST = "/humans/physiological/p2/eda/e4_1/raw"


def ecg(study, key="p1/ecg/h10_1", seconds=10):
    for i in range(seconds * 10):
        samples = {"ecg": np.sin(np.arange(13) + i)}
        study.raw(key, START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, samples)


def header(at_ns):
    return {"stamp": {"sec": at_ns // SECOND, "nanosec": at_ns % SECOND}, "frame_id": ""}


def mark(study, at_s, name, value):
    at_ns = START_NS + round(at_s * SECOND)
    study.add("/study/markers", "Marker", at_ns, header=header(at_ns), name=name, value=value)


def exported(study, *formats):
    session = sense4hri_session.open(study.write())
    export(session, study.parent / "out", formats or ("parquet", "csv"))
    return session, study.parent / "out"


def test_nothing_that_was_recorded_is_missing_from_an_export(study):
    """A stream of a wrong name has its samples, a topic of a wrong type its table, and the notes name both and why."""
    ecg(study)
    ecg(study, "p1/ecg/Shimmer_1")
    ecg(study, "p1/ecg/shimmer_1")
    for i in range(20):
        study.add(TWIST, "std_msgs/msg/Float64", START_NS + i, data=float(i))
        study.add("/robot/battery", "std_msgs/msg/Float64", START_NS + i, data=float(i))
    session, out = exported(study)
    notes = json.loads((out / "session.json").read_text())["notes"]
    assert session["p1/ecg/Shimmer_1"].seen.samples == 1300
    assert any("p1/ecg/Shimmer_1" in note and "small letters" in note for note in notes)
    assert any(TWIST in note and "std_msgs/msg/Float64" in note for note in notes)
    rows = {path.stem: pyarrow.parquet.read_metadata(path).num_rows for path in (out / "parquet").iterdir()}
    assert [rows[name] for name in ("p1_ecg_h10_1", "p1_ecg_Shimmer_1", "p1_ecg_shimmer_1_2")] == [1300] * 3
    table = pyarrow.parquet.read_table(out / "parquet" / "humans_physiological_p2_eda_e4_1_raw.parquet")
    assert table["data"].to_pylist() == list(range(20))
    topics = json.loads((out / "session.json").read_text())["topics"]
    assert {topic for topic, about in topics.items() if not about["exported"]} == {"/robot/battery"}


def test_streams_whose_names_read_alike_have_files_of_their_own(study):
    """`p1/eye_tracking/x` and `p1_eye/tracking/x`, a stream `h10_health` beside the health of `h10`: all are there."""
    keys = ("p1/eye_tracking/x", "p1_eye/tracking/x", "p1/ecg/h10", "p1/ecg/h10_health", "p1/ecg/mg_1", "p1/ecgm/g_1")
    for number, key in enumerate(keys):
        for i in range(20):
            values = {"a": np.full(4, float(number))}
            study.raw(key, START_NS + i * SECOND + number, (i + 10) * SECOND, values)
    topic = "/humans/physiological/p1/ecg/h10/health"
    study.add(topic, "StreamHealth", START_NS, header=header(START_NS), battery_percent=50.0)
    _, out = exported(study, "parquet", "csv", "edf", "bids")
    tables = [pyarrow.parquet.read_table(path) for path in (out / "parquet").iterdir()]
    found = sorted((table["a"][0].as_py(), table.num_rows) for table in tables if "a" in table.column_names)
    assert found == [(float(number), 80) for number in range(len(keys))]
    assert len(list((out / "csv").glob("*health*"))) == 2
    assert len(list((out / "edf").iterdir())) == len(keys)
    assert len(list((out / "bids").rglob("*_physio.json"))) == len(keys)
    assert not pd.read_csv(out / "codebook.csv").duplicated(["table", "column"]).any()


def test_the_codebook_explains_a_column_by_its_own_message(study):
    """`name` of a marker and of a device value, `state` of a driver and a person are explained apart, units whole."""
    ecg(study)
    mark(study, 1.0, "stimulus", "x")
    base = "/humans/physiological/p1"
    study.add(f"{base}/ecg/h10_1/health", "StreamHealth", START_NS, header=header(START_NS), battery_percent=50.0)
    study.add(f"{base}/state", "UserState", START_NS, header=header(START_NS), state="unknown", human_id="p1")
    study.add(f"{base}/eda/e4_1/features", "EDA", START_NS, header=header(START_NS), tonic_slope_us_per_min=1.0)
    study.add(f"{base}/ecg/h10_1/features", "ECG", START_NS, header=header(START_NS), hrv={"lf_power_ms2": 1.0})
    study.add(f"{base}/ecg/h10_1/clock", "ClockModel", START_NS, header=header(START_NS), segment=1)
    _, out = exported(study, "csv")
    book = {
        (row.table, row.column): row for row in pd.read_csv(out / "codebook.csv", keep_default_na=False).itertuples()
    }
    assert book["p1_eda_e4_1_features", "tonic_slope_us_per_min"].unit == "uS/min"
    assert book["p1_ecg_h10_1_features", "hrv_lf_power_ms2"].unit == "ms^2"
    assert book["p1_ecg_h10_1_health", "battery_percent"].unit == "%"
    assert "CONNECTING" in book["p1_ecg_h10_1_health", "state"].description
    assert "calm_relaxed" in book["states", "state"].description
    assert "baseline_start" in book["markers", "name"].description
    assert book["markers", "uncertainty_s"].description.startswith("s, >= 0; 95 % half width of header.stamp")
    assert "uncertainty_s" in pd.read_csv(out / "csv" / "clock_models.csv").columns


def test_a_messages_constants_are_no_columns(study):
    """What a message only names, as the states of a driver, is in no table."""
    ecg(study)
    study.add("/humans/physiological/p1/ecg/h10_1/health", "StreamHealth", START_NS, header=header(START_NS))
    study.add("/humans/faces/f1/expression", "hri_msgs/msg/Expression", START_NS, header=header(START_NS))
    _, out = exported(study, "csv")
    columns = {name for path in (out / "csv").iterdir() for name in pd.read_csv(path, nrows=0).columns}
    assert [name for name in columns if name.isupper()] == []


@pytest.mark.parametrize(
    ("comment", "unit"),
    [
        ("uS/min; linear trend", "uS/min"),
        ("ms^2; 0.04-0.15 Hz", "ms^2"),
        ("%, 0..100; NaN = unknown", "%"),
        ("uS s; area", "uS s"),
        ("m/s^2; root mean square", "m/s^2"),
        ("Hz of the device clock", "Hz"),
        ("0..1; share of samples", ""),
        ("stamp of the event", ""),
        ("s; receipt", "s"),
    ],
)
def test_a_unit_is_read_whole(comment, unit):
    """A comment begins with the whole unit or with none."""
    assert unit_of(comment) == unit


HOSTILE = {
    "=1+1": "'=1+1",
    "@SUM(A1)": "'@SUM(A1)",
    "+cmd|' /C calc'!A0": "'+cmd|' /C calc'!A0",
    "-5": "-5",
    "'=x": "''=x",
    "a\tb\nc\rd": "a\u2409b\u240ac\u240dd",
    "\x15\x14": "\u2415\u2414",
    "\u202eevil": "\ufffdevil",
    'ä, "b"': 'ä, "b"',
    "a\ufffeb": "a\ufffdb",
}


@pytest.mark.parametrize(("text", "shown"), HOSTILE.items())
def test_a_cell_is_one_line_of_text_and_no_formula(text, shown):
    """Formulas get a `'`, numbers do not, control characters become their pictures."""
    assert cell(text) == shown
    assert plain(text) == shown.removeprefix("'") or text.startswith("'")


def test_a_csv_has_no_formula_and_parquet_the_text_as_it_came(study):
    """Values, names and channels of hostile text are one harmless cell each in CSV, and unchanged in Parquet."""
    for i in range(40):
        study.raw("p1/ecg/h10_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, {"=A1": np.arange(13.0)})
    for i, text in enumerate(HOSTILE):
        mark(study, i / 10, text, text)
    _, out = exported(study)
    with (out / "csv" / "markers.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["value"] for row in rows] == [row["name"] for row in rows] == list(HOSTILE.values())
    assert pyarrow.parquet.read_table(out / "parquet" / "markers.parquet")["value"].to_pylist() == list(HOSTILE)
    assert "'=A1" in pd.read_csv(out / "csv" / "p1_ecg_h10_1.csv", nrows=0).columns
    lines = [line for path in out.rglob("*.csv") for line in path.read_text("utf-8").splitlines()]
    texts = [text for row in csv.reader(lines) for text in row]
    assert [text for text in texts if text.startswith(("=", "@"))] == []


def test_a_name_is_given_once():
    """Names that differ by case, by what cannot stand in a file's name, or behind its longest length stay apart."""
    names = Names()
    texts = ["p1_a", "P1_A", "p1/a", "..", "", "a" * 300, "a" * 301]
    given = [names.of(text) for text in texts]
    assert len({name.casefold() for name in given}) == len(texts)
    assert given == [names.of(text) for text in texts]
    assert max(map(len, given)) < 160


def test_hostile_markers_and_labels_leave_every_format_readable(study):
    """EDF, XDF and BIDS with control characters in markers and labels are read by others, every marker in its place."""
    for i in range(60):
        samples = {"=\x15\t\ufffelabel": np.sin(np.arange(13.0) + i)}
        study.raw("p1/ecg/h10_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, samples)
    for i, text in enumerate([*HOSTILE, "a" + "ä" * 60]):
        mark(study, i / 10, "stimulus", text)
    _, out = exported(study, "edf", "xdf", "bids")
    (edf,) = (out / "edf").iterdir()
    raw = mne.io.read_raw(edf, verbose="error")
    shown = [a["description"] for a in raw.annotations if a["description"].startswith("stimulus")]
    assert shown[:-1] == [f"stimulus: {plain(text)}" for text in HOSTILE]
    assert shown[-1].endswith("ä…")
    (markers, *_) = [s for s in pyxdf.load_xdf(out / "session.xdf")[0] if s["info"]["name"] == ["markers"]]
    assert [row[0] for row in markers["time_series"]][:-1] == [f"stimulus: {plain(text)}" for text in HOSTILE]
    events = pd.read_csv(next(out.rglob("*_events.tsv")), sep="\t", quoting=3, keep_default_na=False)
    assert events["value"].tolist()[:2] == ["'=1+1", "'@SUM(A1)"]
    assert len(events) == len(HOSTILE) + 1
    about = json.loads(next(out.rglob("*_events.json")).read_text())
    assert about["onset"]["Description"].startswith("seconds from the first message received")


def test_one_stamp_a_day_off_costs_its_samples_and_no_more(study):
    """EDF and BIDS end with the recording, hold the rest, and say how many samples they left out."""
    for i in range(300):
        late_ns = 86_400 * SECOND if i == 200 else 0
        study.add(
            "/humans/physiological/p1/ecg/h10_1/raw",
            "PhysioRaw",
            START_NS + i * SECOND // 10,
            header=header(START_NS + i * SECOND // 10 + late_ns),
            channels=[{"channel_name": "ecg", "samples": np.arange(13.0)}],
        )
    about = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["ecg"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    _, out = exported(study, "edf", "bids")
    raw = mne.io.read_raw(next((out / "edf").iterdir()), verbose="error")
    assert 28 < raw.times[-1] < 33
    notes = json.loads((out / "session.json").read_text())["notes"]
    assert "p1/ecg/h10_1, EDF: 13 left out: time outside" in notes
    assert sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) < 1_000_000


def test_a_span_that_no_study_has_is_not_put_on_a_grid(study):
    """Ten seconds in a recording whose stamps lie a year apart are in Parquet, and the notes say why not in EDF."""
    ecg(study)
    mark(study, 365 * 86_400.0, "note", "late")
    _, out = exported(study)
    session, out = sense4hri_session.open(next(study.parent.glob("1970*"))), study.parent / "grid"
    notes = export(session, out, ("edf", "bids"))
    assert any("p1/ecg/h10_1 fills 0.0 h of the 8760 h" in note for note in notes)
    assert not list((out / "edf").iterdir())


def test_nobody_is_called_in_bids_as_somebody_else_is_in_the_study(study):
    """`sub-pa` is `pa` also where there is a `p_a`, which comes before it, and `sub-p2` is `p2`."""
    for human in ("p_2", "p_a", "pa", "p2"):
        ecg(study, f"{human}/ecg/h10_{human.replace('_', '0')}", 2)
    _, out = exported(study, "bids")
    people = pd.read_csv(out / "bids" / "participants.tsv", sep="\t", index_col="pseudonym")["participant_id"]
    assert (people["pa"], people["p2"]) == ("sub-pa", "sub-p2")
    assert people["p_a"] not in people.drop("p_a").tolist()


def test_people_and_sensors_whose_labels_are_the_same_have_their_own_files(study):
    """BIDS knows letters and digits only: `p_1` and `p1`, `a_b1` and `ab_1` each have files of their own."""
    for key in ("p_1/ecg/a_b1", "p1/ecg/a_b1", "p1/ecg/ab_1"):
        ecg(study, key)
    _, out = exported(study, "bids")
    assert len(list(out.rglob("*_physio.tsv.gz"))) == 3


def test_features_without_a_header_are_a_table_of_their_own(study):
    """A stranger's text where features of an unknown sensor are looked for ends neither export nor report."""
    ecg(study)
    topic = "/humans/physiological/p1/foo/bar_1/features"
    study.add(topic, "std_msgs/msg/String", START_NS + 5, data="hello")
    session, out = exported(study)
    assert "has no header" in session.strange[topic]
    table = pyarrow.parquet.read_table(out / "parquet" / "humans_physiological_p1_foo_bar_1_features.parquet")
    assert table["data"].to_pylist() == ["hello"]
    report = summarise(collect([session.path]), START_NS)
    (entry,) = [each for each in report["streams"] if each["stream"] == topic]
    assert "has no header" in entry["why"]


@pytest.mark.parametrize("topic", ["markers", "session", "sensors", "assignments", "host_clocks"])
def test_a_topic_of_the_study_is_believed_in_its_own_type_alone(study, topic):
    """Samples where markers are looked for are a table of their own in the export, and the report names them."""
    ecg(study)
    mark(study, 1.0, "note", "a")
    study.messages = [message for message in study.messages if message[2] != f"/study/{topic}"]
    about = {"header": header(START_NS + 5), "device_timestamp": header(START_NS)["stamp"]}
    study.add(f"/study/{topic}", "PhysioRaw", START_NS + 5, **about)
    session, out = exported(study, "parquet", "edf", "xdf", "bids")
    assert f"it is recorded as sense4hri_msgs/msg/PhysioRaw, /study/{topic} is" in session.strange[f"/study/{topic}"]
    assert pyarrow.parquet.read_metadata(out / "parquet" / f"study_{topic}.parquet").num_rows == 1
    assert len(session.markers) == (topic != "markers")
    report = summarise(collect([session.path]), START_NS)
    (entry,) = [each for each in report["streams"] if each["stream"] == f"/study/{topic}"]
    assert f"it is recorded as sense4hri_msgs/msg/PhysioRaw, /study/{topic} is" in entry["why"]


def test_a_state_of_a_person_is_believed_in_its_own_type_alone(study):
    """A text where the state of a person is looked for is not among the states, but a table of its own."""
    ecg(study)
    topic = "/humans/physiological/p1/state"
    study.add(topic, "std_msgs/msg/String", START_NS + 5, data="calm")
    session, _ = exported(study)
    assert topic in session.strange
    assert session.states.empty
    assert session.table(topic)["data"].tolist() == ["calm"]


def test_fields_called_as_ours_are_of_any_type_in_a_third_partys_message(study):
    """`extra`, `reasons`, `header` and `device_timestamp` of somebody's own message are columns like any other."""
    ecg(study)
    names = ("extra", "header", "device_timestamp")
    study.definitions["lab_msgs/msg/Thing"] = "".join(f"string {name}\n" for name in names) + "float64 reasons\n"
    given = {"extra": "more", "header": "head", "device_timestamp": "noon", "reasons": 2.5}
    study.add("/humans/physiological/p1/robot", "lab_msgs/msg/Thing", START_NS + 5, **given)
    _, out = exported(study)
    (row,) = pyarrow.parquet.read_table(out / "parquet" / "humans_physiological_p1_robot.parquet").to_pylist()
    assert given.items() <= row.items()


def test_fields_called_as_a_tables_own_columns_are_beside_them(study):
    """A robot's `time`, `received` and `frame_id` take the place of no stamp of ours: `field_` is before them."""
    ecg(study)
    study.definitions["lab_msgs/msg/Pose"] = (
        "std_msgs/Header header\n"
        "builtin_interfaces/Time time  # when it was planned\n"
        "string received_ns\nfloat64 time_s\nstring frame_id\n"
        f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    given = {"received_ns": "soon", "time_s": 0.5, "frame_id": "map"}
    log_ns = START_NS + 5 * SECOND
    about = {"header": header(log_ns - 7) | {"frame_id": "odom"}, "time": {"sec": 12, "nanosec": 0}}
    study.add("/humans/physiological/p1/robot", "lab_msgs/msg/Pose", log_ns, **about, **given)
    _, out = exported(study)
    table = pyarrow.parquet.read_table(out / "parquet" / "humans_physiological_p1_robot.parquet")
    (row,) = table.to_pylist()
    assert {f"field_{name}": value for name, value in given.items()}.items() <= row.items()
    assert (row["field_time_ns"], row["frame_id"]) == (12 * SECOND, "odom")
    assert (row["time_ns"], row["received_ns"]) == (log_ns, log_ns - 7)
    codebook = pd.read_csv(out / "codebook.csv", keep_default_na=False).set_index(["table", "column"])
    assert codebook.loc["humans_physiological_p1_robot", "field_time_ns"]["description"] == "when it was planned"


@pytest.mark.parametrize(
    ("kind", "topic"),
    [
        ("UserState", "/humans/physiological/p1/state"),
        ("ECG", "/humans/physiological/p1/ecg/h10_1/features"),
        ("PhysioDeviceFeature", "/humans/physiological/p1/ecg/h10_1/device"),
    ],
)
def test_a_file_whose_own_definition_lacks_what_is_read_says_so(study, kind, topic):
    """Another version's, or a hostile one: the messages are left out and named, everything else is exported."""
    ecg(study)
    study.definitions[f"sense4hri_msgs/msg/{kind}"] = "string x\n"
    study.add(topic, kind, START_NS + 5, x="?")
    session, out = exported(study)
    assert any(topic in note and f"{kind} has no" in note for note in session.notes), session.notes
    assert pyarrow.parquet.read_metadata(out / "parquet" / "p1_ecg_h10_1.parquet").num_rows == 1300


def test_only_times_of_a_message_are_converted_as_times(study):
    """`..._timestamps` in `extra`, and numbers of that name in a third party's features, are exported as they came."""
    ecg(study)
    now = {"header": header(START_NS + SECOND), "device_timestamp": {"sec": 2, "nanosec": 0}}
    extra = [{"name": "t_wave_timestamps", "unit": "s", "values": [1.5, 1.6]}]
    study.add("/humans/physiological/p1/ecg/h10_1/features", "ECG", START_NS + SECOND, **now, extra=extra)
    study.definitions["lab_msgs/msg/Foo"] = (
        "std_msgs/Header header\nfloat64[] odd_timestamps\n"
        f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    odd = {"header": now["header"], "odd_timestamps": [7.0]}
    study.add("/humans/physiological/p1/foo/bar_1/features", "lab_msgs/msg/Foo", START_NS + SECOND, **odd)
    session, _ = exported(study)
    assert session.features("p1/ecg/h10_1")["extra_t_wave_timestamps"].tolist() == [[1.5, 1.6]]
    assert session.features("p1/foo/bar_1")["odd_timestamps"].tolist() == [[7.0]]


def test_values_in_extra_keep_their_units_and_one_that_could_not_be_computed_is_none(study):
    """A column of numbers stays one where a message has no value; the codebook has the unit that messages tell."""
    ecg(study)
    topic, told = "/humans/physiological/p1/ecg/h10_1/features", ([1.5], [], [2.5])
    for at_s, values in enumerate(told):
        extra = [{"name": "qrs", "unit": "ms", "values": values}, {"name": "waves", "unit": "s", "values": values * 2}]
        study.add(topic, "ECG", START_NS + at_s * SECOND, header=header(START_NS + at_s * SECOND), extra=extra)
    _, out = exported(study)
    table = pyarrow.parquet.read_table(out / "parquet" / "p1_ecg_h10_1_features.parquet")
    assert table["extra_qrs"].to_pylist() == [1.5, None, 2.5]
    assert table["extra_waves"].to_pylist() == ["[1.5, 1.5]", None, "[2.5, 2.5]"]
    codebook = pd.read_csv(out / "codebook.csv", keep_default_na=False).set_index(["table", "column"])["unit"]
    assert [codebook["p1_ecg_h10_1_features", f"extra_{name}"] for name in ("qrs", "waves")] == ["ms", "s"]


def test_more_names_in_extra_than_a_table_has_room_for_are_one_column():
    """Each row keeps its values, as JSON; below the limit each name is a column."""
    most = tables.MOST_EXTRA
    few = tables.frame([{"time_ns": n, f"extra_a{n}": float(n)} for n in range(most)])
    many = tables.frame([{"time_ns": n, f"extra_a{n}": float(n)} for n in range(most + 1)])
    assert len(few.columns) == most + 1
    assert list(many.columns) == ["time_ns", "extra"]
    assert many["extra"][7] == '{"a7": 7.0}'


@pytest.mark.parametrize("epoch_ns", [0, 1000 * SECOND])  # without and with device time
@pytest.mark.parametrize(("declared_hz", "true_hz", "frame"), [(30, 15, 1), (250, 50, 10), (100, 128, 16)])
def test_a_wrong_declared_rate_empties_no_file_and_moves_no_sample(study, epoch_ns, declared_hz, true_hz, frame):
    """A camera in dim light, or a driver's wrong word: the signal is in EDF and BIDS, at its time; a note says so."""
    for i in range(60 * true_hz // frame):
        at_s = (np.arange(frame) + i * frame + 1) / true_hz
        last_ns = round(at_s[-1] * SECOND)
        device_ns = epoch_ns + last_ns if epoch_ns else 0
        study.raw("p1/ecg/h10_1", START_NS + last_ns, device_ns, {"c": np.sin(at_s)})
    sensor = study.sensor("p1/ecg/h10_1", float(declared_hz), "uV", ["c"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, header=header(START_NS), sensors=[sensor])
    session, out = exported(study, "edf", "bids")
    time_ns, samples = session["p1/ecg/h10_1"].arrays()
    np.testing.assert_allclose(np.sin((time_ns - START_NS) / SECOND), samples[:, 0], atol=5e-3)
    raw = mne.io.read_raw_edf(out / "edf" / "p1_ecg_h10_1.edf", preload=True, verbose="error")
    assert raw.info["sfreq"] == true_hz
    at_s = raw.times + raw.info["meas_date"].timestamp() - START_NS / SECOND
    inside = (at_s > 1) & (at_s < 59)
    assert np.abs(raw.get_data()[0] * 1e6 - np.sin(at_s))[inside].max() < 5e-3
    (table,) = out.rglob("*_physio.tsv.gz")
    assert pd.read_csv(table, sep="\t", header=None)[0].isna().mean() < 0.01
    assert any(f"declares {declared_hz} Hz" in note for note in session.notes)


def test_messages_that_were_lost_make_no_other_rate(study):
    """Without device time one message in five may be missing: the declared rate stays."""
    for i in set(range(500)) - set(range(0, 500, 5)):
        study.raw("p1/ecg/h10_1", START_NS + i * SECOND // 10, 0, {"c": np.zeros(13)})
    sensor = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["c"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, header=header(START_NS), sensors=[sensor])
    session = sense4hri_session.open(study.write())
    assert session["p1/ecg/h10_1"].measured_rate_hz < 110
    assert session["p1/ecg/h10_1"].true_rate_hz == 130
    assert session.notes == []


def test_what_bids_has_no_participant_for_is_named(study):
    """Streams that nobody wore, and markers that are no participant's, are left out of BIDS with a note each."""
    ecg(study, "unassigned/ecg/h10_1")
    mark(study, 1.0, "stimulus", "x")
    _, out = exported(study, "bids")
    notes = json.loads((out / "session.json").read_text())["notes"]
    assert "unassigned/ecg/h10_1, BIDS: left out, nobody wore it" in notes
    assert "BIDS: 1 marker left out, there is no participant" in notes


def test_whoever_took_part_is_a_participant(study):
    """Who had a device's own values only, or is named by the session alone, has a row and the markers; a table none."""
    ecg(study)
    device = {"header": header(START_NS + SECOND), "features": [{"name": "hr", "unit": "1/min", "values": [60.0]}]}
    study.add("/humans/physiological/p2/ecg/h10_2/device", "PhysioDeviceFeature", START_NS + SECOND, **device)
    about = {"session_id": "s1", "human_ids": ["p1", "p2", "p3"]}
    study.add("/study/session", "SessionState", START_NS, header=header(START_NS), **about)
    mark(study, 1.0, "stimulus", "for all")
    at_ns = START_NS + 2 * SECOND
    about = {"header": header(at_ns), "human_id": "table_2", "name": "moved"}
    study.add("/study/markers", "Marker", at_ns, **about)
    _, out = exported(study, "bids")
    people = pd.read_csv(out / "bids" / "participants.tsv", sep="\t")
    assert people["pseudonym"].tolist() == ["p1", "p2", "p3"]
    assert len(list((out / "bids").rglob("beh/*_events.tsv"))) == 3
    notes = json.loads((out / "session.json").read_text())["notes"]
    assert [note for note in notes if "BIDS" in note] == ["BIDS: 1 marker left out, 'table_2' is no participant"]


def test_a_change_of_wearer_is_an_event_of_those_concerned_in_every_format(study):
    """The strap went from p1 to p2 when the registry says: a row for each of them with both names, none for p3."""
    for i in range(200):
        samples = {"ecg": np.sin(np.arange(13) + i)}
        at_ns = START_NS + i * SECOND // 10
        study.raw(f"{'p1' if i < 100 else 'p2'}/ecg/h10_1", at_ns, at_ns - 1000 * SECOND, samples)
        study.raw("p3/ecg/h10_2", at_ns, at_ns - 1000 * SECOND, samples)
        study.raw(f"{'unassigned' if i < 50 else 'p3'}/eda/e4_1", at_ns, 0, {"eda": samples["ecg"]})
    about = [study.sensor(f"p1/ecg/h10_{number}", 130.0, "uV", ["ecg"], 14) for number in (1, 2)]
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=about)
    since_ns = START_NS + 9_950_000_000
    for at_ns, human in ((START_NS, "p1"), (since_ns, "p2")):
        worn = [{"sensor_id": "h10_1", "human_id": human, "since": header(at_ns)["stamp"], "source": "operator"}]
        study.add("/study/assignments", "SensorAssignmentArray", at_ns, assignments=worn)
    _, out = exported(study, "csv", "edf", "xdf", "bids")
    truth = {
        "p1": [(9.95, "sensor_left", "h10_1 went from p1 to p2")],
        "p2": [(9.95, "sensor_came", "h10_1 went from p1 to p2")],
        "p3": [(4.9, "sensor_came", "e4_1 went from unassigned to p3")],
    }
    for human, told in truth.items():
        stem = out / "bids" / f"sub-{human}" / "beh" / f"sub-{human}_task-study_events"
        events = pd.read_csv(f"{stem}.tsv", sep="\t")
        assert [*zip(events["onset"], events["trial_type"], events["value"], strict=True)] == told
        assert "a sensor of" in json.loads(stem.with_suffix(".json").read_text())["trial_type"]["Levels"][told[0][1]]
    rows = [(at, name, value) for told in truth.values() for at, name, value in told]
    table = pd.read_csv(out / "csv" / "timeline.csv")
    assert {*zip(table["time_s"].round(6), table["name"], table["value"], strict=True)} == {*rows}
    texts = {f"{name}: {value}" for _, name, value in rows}
    told = {s["info"]["name"][0]: s for s in pyxdf.load_xdf(out / "session.xdf")[0]}
    markers, people = told["markers"], told["markers/human_id"]
    assert {row[0] for row in markers["time_series"]} == texts
    assert people["time_stamps"].tolist() == markers["time_stamps"].tolist()
    concerned = zip(people["time_series"], markers["time_series"], strict=True)
    assert {human[0]: text[0] for human, text in concerned} == {h: f"{r[0][1]}: {r[0][2]}" for h, r in truth.items()}
    raw = mne.io.read_raw_edf(out / "edf" / "p2_ecg_h10_1.edf", verbose="error")
    assert "sensor_came: h10_1 went from p1 to p2" in raw.annotations.description


def test_bids_has_the_samples_from_before_the_first_message(study):
    """What the first message brought was taken before it came: it is there at its time, after a StartTime below 0."""
    for i in range(20):
        values = {"eda": np.arange(4.0) + 4 * i}
        study.raw("p1/eda/e4_1", START_NS + i * SECOND + SECOND // 4, START_NS - 99 * SECOND + i * SECOND, values)
    about = study.sensor("p1/eda/e4_1", 4.0, "uS", ["eda"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS + SECOND, sensors=[about])
    session, out = exported(study, "bids")
    (sidecar,) = (out / "bids").rglob("*_physio.json")
    told = json.loads(sidecar.read_text())
    values = pd.read_csv(sidecar.with_suffix(".tsv.gz"), sep="\t", header=None, names=told["Columns"])["eda"]
    at = told["StartTime"] + np.arange(len(values)) / told["SamplingFrequency"]
    time_ns, samples = session["p1/eda/e4_1"].arrays()
    assert (time_ns[0] - session.start_ns) * 1e-9 == pytest.approx(-0.75, abs=1e-3)
    assert values.count() == len(samples) == 80
    np.testing.assert_allclose(np.interp((time_ns - session.start_ns) * 1e-9, at, values), samples[:, 0], atol=0.01)


def test_a_unit_that_was_told_otherwise_before_is_named(study):
    """A driver that came back with another scale: samples have one unit in every format, and the notes say since when.

    What the registry keeps of a driver that is not there, and a unit that nobody told, say nothing of these samples.
    """
    ecg(study)
    ecg(study, "p1/ecg/h10_2")
    for at_s, units, online in ((-1, ("mV", "mV"), False), (0, ("counts", ""), True), (4, ("uV", "uV"), True)):
        sensors = [
            study.sensor(f"p1/ecg/h10_{number}", 130.0, unit, ["ecg"], 14, online=online)
            for number, unit in enumerate(units, 1)
        ]
        study.add("/study/sensors", "SensorInfoArray", START_NS + at_s * SECOND, sensors=sensors)
    _, out = exported(study, "csv")
    told = "p1/ecg/h10_1: its unit was told as counts from 1.0 s on, as uV from 5.0 s on: all of it is written as uV"
    assert json.loads((out / "session.json").read_text())["notes"] == [told]


def test_a_marker_that_edf_has_no_room_for_is_named(study):
    """Up to the end of the file's last second every marker is in it; how many came later, a note says."""
    ecg(study)
    mark(study, 5.0, "during", "")
    mark(study, 9.95, "in the last second", "")
    mark(study, 15.0, "later", "")
    mark(study, 16.0, "later", "")
    about = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["ecg"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    _, out = exported(study, "edf")
    raw = mne.io.read_raw_edf(out / "edf" / "p1_ecg_h10_1.edf", verbose="error")
    assert {"during", "in the last second"} == {*raw.annotations.description} - {"BAD_gap"}
    notes = json.loads((out / "session.json").read_text())["notes"]
    assert notes == ["p1/ecg/h10_1, EDF: 2 markers left out, the file ends before them"]


def test_a_marker_from_before_an_edf_file_begins_is_named(study):
    """It has no place in the file, where time begins at 0; at the first whole second it has one."""
    ecg(study)
    for at_s in (-3.5, -1.5, -1.0):
        at_ns = START_NS + round(at_s * SECOND)
        study.add("/study/markers", "Marker", START_NS, header=header(at_ns), name=f"at {at_s}")
    about = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["ecg"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    _, out = exported(study, "edf")
    raw = mne.io.read_raw_edf(out / "edf" / "p1_ecg_h10_1.edf", verbose="error")
    assert {*raw.annotations.description} - {"BAD_gap"} == {"at -1.0"}
    notes = json.loads((out / "session.json").read_text())["notes"]
    assert notes == ["p1/ecg/h10_1, EDF: 2 markers left out, the file begins after them"]


def test_many_short_holes_of_single_channels_leave_every_annotation_its_room(study):
    """Ten lost samples a second in each of two channels: each hole is annotated, and the markers are there too."""
    for i in range(100):
        x, y = np.sin(np.arange(13) + i), np.cos(np.arange(13) + i)
        x[3] = y[7] = np.nan
        study.raw("p1/ecg/h10_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, {"x": x, "y": y})
    mark(study, 5.0, "during", "")
    mark(study, 9.5, "late", "")
    about = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["x", "y"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    _, out = exported(study, "edf")
    raw = mne.io.read_raw_edf(out / "edf" / "p1_ecg_h10_1.edf", verbose="error")
    found = [(each["description"], each["ch_names"]) for each in raw.annotations]
    assert [found.count(("BAD_gap", (name,))) for name in "xy"] == [100, 100]
    assert {"during", "late"} <= {name for name, _ in found}
    assert json.loads((out / "session.json").read_text())["notes"] == []


@pytest.mark.parametrize("frame", [1, 13])
def test_a_message_that_came_after_newer_ones_is_in_edf_and_bids(study, frame):
    """Its samples have their time by the device's stamp: no hole is where it was, and nothing is left out."""
    for i in range(1300 // frame):
        at_s = (np.arange(frame) + i * frame + 1) / 130
        late_s = 0.15 if i in (40, 70) else 0.0
        received_ns = START_NS + round((at_s[-1] + late_s) * SECOND)
        study.raw("p1/ecg/h10_1", received_ns, round((at_s[-1] + 9) * SECOND), {"c": 100 * np.sin(6 * at_s)})
    about = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["c"], 16)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    session, out = exported(study, "edf", "bids")
    assert json.loads((out / "session.json").read_text())["notes"] == []
    time_ns, samples = session["p1/ecg/h10_1"].arrays()
    np.testing.assert_allclose(100 * np.sin(6 * (time_ns - START_NS) / SECOND), samples[:, 0], atol=1)
    (table,) = out.rglob("*_physio.tsv.gz")
    values = pd.read_csv(table, sep="\t", header=None)[0]
    assert values.iloc[2:].notna().all()
    raw = mne.io.read_raw_edf(out / "edf" / "p1_ecg_h10_1.edf", preload=True, verbose="error")
    at_s = raw.times + raw.info["meas_date"].timestamp() - START_NS / SECOND
    inside = (at_s > 0.1) & (at_s < 9.9)
    np.testing.assert_allclose(raw.get_data()[0][inside] * 1e6, 100 * np.sin(6 * at_s[inside]), atol=1)


def test_a_rate_that_nobody_could_measure_is_no_number(study):
    """Of a single message: no file says that its samples came at 0 Hz."""
    study.raw("p1/eda/e4_1", START_NS, SECOND, {"eda": np.arange(4.0)})
    about = study.sensor("p1/eda/e4_1", 4.0, "uS", ["eda"], 14)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    _, out = exported(study, "edf", "bids")
    assert json.loads((out / "session.json").read_text())["streams"]["p1/eda/e4_1"]["measured_rate_hz"] is None
    (sidecar,) = (out / "bids").rglob("*_physio.json")
    assert "from an unknown rate" in json.loads(sidecar.read_text())["Resampled"]
    (file,) = (out / "edf").iterdir()
    assert b"(cubic spline) from an unknown rate" in file.read_bytes()


@pytest.mark.parametrize("table", ["p1_ecg_h10_1_features", "p1_ecg_h10_1_device", "timeline"])
def test_times_keep_their_nanoseconds_where_others_are_missing(study, table):
    """Device and receipt stamps are whole ns also in a table where one row has none, so that tables can be joined."""
    ecg(study)
    device_ns = [1_700_000_001_987_654_321, 0, 1_700_000_003_987_654_323]
    for n, told_ns in enumerate(device_ns, 1):
        now_ns = START_NS + n * SECOND + 123_456_789
        told = {"header": header(now_ns), "device_timestamp": {"sec": told_ns // SECOND, "nanosec": told_ns % SECOND}}
        base = "/humans/physiological/p1/ecg/h10_1"
        study.add(f"{base}/features", "ECG", now_ns, **told)
        study.add(f"{base}/device", "PhysioDeviceFeature", now_ns, **told, features=[{"name": "hr", "values": [60.0]}])
        study.add("/study/markers", "Marker", now_ns, **told, name="stimulus")
    started = {"sec": START_NS // SECOND + 1, "nanosec": 0}
    study.add("/study/session", "SessionState", START_NS, header=header(START_NS), session_id="s1", start_at=started)
    _, out = exported(study)
    found = pyarrow.parquet.read_table(out / "parquet" / f"{table}.parquet").to_pandas(integer_object_nulls=True)
    text = pd.read_csv(out / "csv" / f"{table}.csv", dtype=str)
    assert found["device_time_ns"].dropna().tolist() == text["device_time_ns"].dropna().map(int).tolist()
    assert found["device_time_ns"].dropna().tolist() == [ns for ns in device_ns if ns]
    assert {ns % SECOND for ns in found["received_ns"].dropna().tolist()} == {123_456_789}


def test_a_number_that_is_called_like_a_time_is_a_number(study):
    """A third party's `latency_ns` of 1.5, and of NaN, is exported as it came."""
    ecg(study)
    study.definitions["lab_msgs/msg/Lag"] = "float64 latency_ns\n"
    for n, latency_ns in enumerate((1.5, float("nan"))):
        study.add("/humans/physiological/p1/robot", "lab_msgs/msg/Lag", START_NS + n, latency_ns=latency_ns)
    _, out = exported(study)
    table = pyarrow.parquet.read_table(out / "parquet" / "humans_physiological_p1_robot.parquet")
    assert table["latency_ns"].to_pylist() == [1.5, None]


def test_messages_that_cannot_be_decoded_are_in_the_notes(study):
    """Of a stream with how many; of a table that is read only while it is written too; nowhere with a folder's path."""
    ecg(study)
    base = "/humans/physiological/p1/ecg/h10_1"
    for field, kind in (("raw", "PhysioRaw"), ("health", "StreamHealth"), ("features", "ECG")):
        for n in range(2):
            study.add_bytes(f"{base}/{field}", kind, START_NS + n, b"\x00\x01\x00\x00garbage")
    folder = study.write()
    out = folder.with_name("out")
    notes = export(sense4hri_session.open(folder), out, ("csv",))
    assert "p1/ecg/h10_1: 2 raw messages cannot be decoded: left out" in notes
    assert {f"{base}/health", f"{base}/features"} <= {word for note in notes for word in note.split()}
    assert json.loads((out / "session.json").read_text())["notes"] == notes
    assert str(folder.parent) not in (out / "session.json").read_text()


def test_an_edf_header_has_the_whole_pseudonym(study):
    """The longest that the contract allows; two that differ in their last sign alone stay two."""
    people = ["p" * 62 + last for last in "ab"]
    for person in people:
        for i in range(20):
            samples = {"a": np.sin(np.arange(13.0) + i)}
            study.raw(f"{person}/ecg/x_{person[-1]}", START_NS + i * SECOND // 10, (i + 1) * SECOND // 10, samples)
    sensors = [study.sensor(f"{person}/ecg/x_{person[-1]}", 130.0, "uV", ["a"], 16) for person in people]
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=sensors)
    out = study.parent / "out"
    export(sense4hri_session.open(study.write()), out, ("edf",))
    found = []
    for file in sorted((out / "edf").iterdir()):
        with pyedflib.EdfReader(str(file)) as reader:
            found.append(reader.getPatientCode())
    assert found == people


def test_what_an_edf_header_has_no_room_for_is_told(study):
    """A long unit ends with `~`, a channel that readers take for triggers has a number: the notes say both."""
    names = ("Status", "trigger", "a name of more than sixteen signs")
    for i in range(20):
        samples = {name: np.sin(np.arange(13.0) + i + at) for at, name in enumerate(names)}
        study.raw("p1/skin/x_1", START_NS + i * SECOND // 10, (i + 1) * SECOND // 10, samples)
    for i in range(20):
        samples = {"a": 1e7 * np.sin(np.arange(13.0) + i)}
        study.raw("p1/ppg/x_2", START_NS + i * SECOND // 10, (i + 1) * SECOND // 10, samples)
    sensors = [study.sensor("p1/skin/x_1", 130.0, "counts/s^2", list(names), 16)]
    sensors.append(study.sensor("p1/ppg/x_2", 130.0, "counts", ["a"], 24))
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=sensors)
    out = study.parent / "out"
    notes = export(sense4hri_session.open(study.write()), out, ("edf", "bids"))
    found = mne.io.read_raw(next((out / "edf").glob("p1_skin_x_1.?df")), verbose="error")
    assert found.ch_names == ["Status_2", "trigger_2", "a name of more t"]
    assert "stim" not in found.get_channel_types()
    with pyedflib.EdfReader(str(next((out / "edf").glob("p1_ppg_x_2.?df")))) as file:
        assert file.getPhysicalDimension(0) == "1000 co~"
    assert [note for note in notes if "header" in note] == [
        "p1/ppg/x_2, EDF: its header has '1000 co~' for the unit 1000 counts",
        "p1/skin/x_1, EDF: its header has 'counts/~' for the unit counts/s^2",
        "p1/skin/x_1, EDF: its header has 'Status_2' for the channel Status",
        "p1/skin/x_1, EDF: its header has 'trigger_2' for the channel trigger",
        "p1/skin/x_1, EDF: its header has 'a name of more t' for the channel a name of more than sixteen signs",
    ]


def test_a_repeated_message_is_in_no_count_of_what_was_exported(study, capsys):
    """session.json and --list have as many samples as the tables, and as the report."""
    ecg(study)
    study.messages.insert(50, study.messages[50])
    session, out = exported(study)
    told = json.loads((out / "session.json").read_text())["streams"]["p1/ecg/h10_1"]["samples"]
    (reported,) = summarise(collect([session.path]), START_NS)["streams"]
    assert told == reported["samples"] == len(pd.read_parquet(out / "parquet" / "p1_ecg_h10_1.parquet")) == 1300
    assert main([str(session.path), "--list"]) == 0
    assert "p1/ecg/h10_1\t1300 samples\t" in capsys.readouterr().out


def test_a_list_in_a_table_is_json_to_every_program(study):
    """The interval after a gap is NaN in the message and null in the table: JSON knows no NaN."""
    ecg(study)
    times = [header(at_ns)["stamp"] for at_ns in (SECOND, 2 * SECOND)]
    intervals = {"peak_timestamps": times, "rr_intervals_ms": [np.nan, 1000.0]}
    study.add("/humans/physiological/p1/ecg/h10_1/features", "ECG", START_NS + SECOND, **intervals)
    _, out = exported(study)
    for table in (
        pd.read_parquet(out / "parquet" / "p1_ecg_h10_1_features.parquet"),
        pd.read_csv(out / "csv" / "p1_ecg_h10_1_features.csv"),
    ):
        assert table["rr_intervals_ms"].tolist() == ["[null, 1000.0]"]


def test_no_cell_of_a_bids_table_is_a_formula_empty_or_broken(study):
    """A pseudonym, a unit and a marker without a name, as a stranger may send them."""
    for i in range(60):
        study.raw("p1/eeg/cap_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, {"Cz": np.full(13, float(i))})
    about = study.sensor("p1/eeg/cap_1", 130.0, "=1\t2\n", ["Cz"], 24)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    study.add("/study/session", "SessionState", START_NS, session_id="s", human_ids=["p1", "=1+1", "a\tb\nc"], phase=2)
    mark(study, 1, "", "yes")
    _, out = exported(study, "bids")
    rows = [line.split("\t") for path in out.rglob("*.tsv") for line in path.read_text().splitlines()[1:]]
    assert {len(row) for row in rows if row[0].startswith("sub-")} == {2}
    assert {"'=1+1", "a␉b␊c", "p1", "'=1␉2"} <= {text for row in rows for text in row}
    assert all(text and not text.startswith("=") for row in rows for text in row)
