"""An export leaves nothing out in silence, explains every column by its own message, and is text to every program."""

import csv
import json

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
import sense4hri_session
from sense4hri_session.definitions import unit_of
from sense4hri_session.export import export
from sense4hri_session.file_names import Names
from sense4hri_session.plain_text import cell, plain

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
