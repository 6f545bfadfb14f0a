"""What is exported, read back by the readers of others."""

import json
import shutil
import subprocess
import sys
import sysconfig
from datetime import UTC, datetime
from pathlib import Path

import mne
import numpy as np
import pandas as pd
import pyarrow.parquet
import pyedflib
import pytest
import pyxdf
import sense4hri_session
from sense4hri.cdr import read_raw
from sense4hri_report import make_report
from sense4hri_session import SessionError, edf
from sense4hri_session.__main__ import main
from sense4hri_session.export import export

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
MARKERS = {"baseline_start": 10.5, "stimulus: image 7": 30.25, "my_own: ä": 60.0}


@pytest.fixture(scope="module")
def session(recording):
    return sense4hri_session.open(recording)


@pytest.fixture(scope="module")
def out(session, tmp_path_factory):
    """Everything, exported once."""
    folder = tmp_path_factory.mktemp("export") / "out"
    export(session, folder)
    return folder


def test_parquet_is_the_frame(session, out):
    """pyarrow reads every sample with its corrected time and both raw stamps; the unit is in the file."""
    for key, stream in session.streams.items():
        table = pyarrow.parquet.read_table(out / "parquet" / f"{key.replace('/', '_')}.parquet")
        frame = stream.frame()
        assert table["time_ns"].to_pylist() == frame.index.as_unit("ns").asi8.tolist()
        assert table["received_ns"].to_pylist() == frame["received_ns"].tolist()
        for channel in stream.channels:
            assert table[channel].to_pylist() == frame[channel].tolist()
        assert table.schema.metadata[b"unit"].decode() == stream.unit


def test_csv_is_parquet(out):
    """Every CSV has the rows and columns of its Parquet file, numbers without loss."""
    files = sorted((out / "csv").glob("*.csv"))
    assert len(files) == len(list((out / "parquet").iterdir())) >= 9
    for file in files:
        ours = pd.read_csv(file, float_precision="round_trip")
        theirs = pyarrow.parquet.read_table(out / "parquet" / f"{file.stem}.parquet").to_pandas()
        assert list(ours.columns) == list(theirs.columns)
        assert len(ours) == len(theirs)
        numbers = theirs.select_dtypes("number").columns
        np.testing.assert_array_equal(ours[numbers].astype(float), theirs[numbers].astype(float))


def test_edf_opens_in_mne_with_the_events_where_they_happened(session, out):
    """MNE finds the markers at their time, the gap as BAD_gap, and beats on the beats."""
    raw = mne.io.read_raw_edf(out / "edf" / "p1_ecg_h10_1.edf", preload=True, verbose="error")
    start_s = raw.info["meas_date"].timestamp()
    assert raw.info["sfreq"] == 130
    found = {a["description"]: start_s + a["onset"] - START_NS / SECOND for a in raw.annotations}
    for text, at in MARKERS.items():
        assert found[text] == pytest.approx(at, abs=1e-3)
    gaps = [
        (start_s + a["onset"] - START_NS / SECOND, a["duration"])
        for a in raw.annotations
        if a["description"] == "BAD_gap"
    ]
    assert any(abs(onset - 40) < 0.2 and abs(duration - 5) < 0.2 for onset, duration in gaps)
    events = session.events("p1/ecg/h10_1")["time_ns"] / SECOND - start_s
    clean = [t for t in events if not any(o - 0.1 < t + start_s - START_NS / SECOND < o + d + 0.1 for o, d in gaps)]
    heights = np.interp(clean, raw.times, raw.get_data()[0] * 1e6)
    assert len(clean) > 80
    assert np.median(heights) > 900


def test_pyedflib_reads_the_header(session, out):
    """The header says whose, which sensor, that it was resampled; files of a session begin at one second."""
    starts = set()
    for file in sorted((out / "edf").iterdir()):
        with pyedflib.EdfReader(str(file)) as reader:
            starts.add(reader.getStartdatetime())
            assert reader.getPatientCode() in ("p1", "p2")
            assert "resampled" in reader.getPrefilter(0)
            assert reader.getFileDuration() >= 89
    first = min(int(stream.arrays()[0][0]) for stream in session.streams.values())
    assert starts == {datetime.fromtimestamp(min(first, session.start_ns) // SECOND, UTC).replace(tzinfo=None)}


def test_above_16_bits_it_is_bdf(session, out):
    """22 bits of PPG go into BDF+, whose values are those of the stream within a 24-bit step."""
    assert {file.name for file in (out / "edf").iterdir()} == {
        "p1_accelerometer_h10_1.edf",
        "p1_ecg_h10_1.edf",
        "p1_ppg_verity_1.bdf",
        "p2_eda_e4_1.edf",
    }
    raw = mne.io.read_raw_bdf(out / "edf" / "p1_ppg_verity_1.bdf", preload=True, verbose="error")
    time_ns, samples = session["p1/ppg/verity_1"].arrays()
    at = time_ns / SECOND - raw.info["meas_date"].timestamp()
    found = np.interp(at, raw.times, raw.get_data()[0])
    np.testing.assert_allclose(found[2:-2], samples[2:-2, 0], atol=20)


def test_pyxdf_brings_the_streams_together(session, out):
    """With its clock offsets pyxdf puts every sample within 0.5 ms of the corrected timeline, markers exactly."""
    streams, _ = pyxdf.load_xdf(out / "session.xdf", dejitter_timestamps=False)
    by_name = {stream["info"]["name"][0]: stream for stream in streams}
    for key, stream in session.streams.items():
        time_ns, samples = stream.arrays()
        found = by_name[key]
        np.testing.assert_array_equal(found["time_series"], samples)
        np.testing.assert_allclose(found["time_stamps"], (time_ns - session.start_ns) * 1e-9, atol=5e-4)
    markers = by_name["markers"]
    assert [row[0] for row in markers["time_series"]] == list(MARKERS)
    offset = (session.start_ns - START_NS) / SECOND
    np.testing.assert_allclose(markers["time_stamps"] + offset, list(MARKERS.values()), atol=1e-6)


def test_xdf_keeps_the_device_stamps(session, out):
    """Without clock offsets pyxdf shows the device's own clock."""
    streams, _ = pyxdf.load_xdf(out / "session.xdf", synchronize_clocks=False, dejitter_timestamps=False)
    found = next(stream for stream in streams if stream["info"]["name"][0] == "p1/ecg/h10_1")
    origin = int(found["info"]["desc"][0]["clock_origin_ns"][0])
    device = session["p1/ecg/h10_1"].frame()["device_time_ns"].to_numpy(np.int64)
    np.testing.assert_allclose(found["time_stamps"], (device - origin) * 1e-9, atol=1e-9)


def test_bids_is_valid(out):
    """bids-validator-deno finds no error."""
    command = Path(sysconfig.get_path("scripts")) / "bids-validator-deno"
    done = subprocess.run([command, "--json", out / "bids"], capture_output=True, text=True, check=False, timeout=400)
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue.get("severity") == "error"] == []
    participants = pd.read_csv(out / "bids" / "participants.tsv", sep="\t")
    assert participants["participant_id"].tolist() == ["sub-p1", "sub-p2"]


def test_bids_physio_is_the_signal(session, out):
    """A physio file begins at StartTime with a constant rate; missing samples are n/a, and events fit."""
    folder = out / "bids" / "sub-p1" / "beh"
    start = folder / "sub-p1_task-rest_recording-ecgh101_physio"
    about = json.loads(start.with_suffix(".json").read_text())
    values = pd.read_csv(f"{start}.tsv.gz", sep="\t", header=None, names=about["Columns"])["ecg"].to_numpy()
    at = about["StartTime"] + np.arange(len(values)) / about["SamplingFrequency"]
    hole = (at + (session.start_ns - START_NS) / SECOND > 40.3) & (at + (session.start_ns - START_NS) / SECOND < 44.7)
    assert np.isnan(values[hole]).all()
    events = pd.read_csv(folder / "sub-p1_task-rest_events.tsv", sep="\t")
    assert events["onset"].to_numpy() + (session.start_ns - START_NS) / SECOND == pytest.approx([10.5, 30.25, 60.0])


def test_the_codebook_explains_every_column(out):
    """Every column of every CSV has a row with a description, and so has every marker name."""
    book = pd.read_csv(out / "codebook.csv", keep_default_na=False)
    rows = {(row.table, row.column): row for row in book.itertuples()}
    for file in (out / "csv").glob("*.csv"):
        for column in pd.read_csv(file, nrows=0).columns:
            assert rows[file.stem, column].description, (file.stem, column)
    assert rows["p1_ecg_h10_1", "ecg"].unit == "uV"
    assert rows["p1_ecg_h10_1_features", "hrv_rmssd_ms"].unit == "ms"
    assert rows["markers", "name=my_own"].description.endswith("1 in this session")
    assert rows["p1_ecg_h10_1", "device_time_ns"].clock == "device"


def test_the_recording_is_read_once_for_all_formats(recording, tmp_path, monkeypatch):
    """Every raw message is read twice: when the session is opened, and for all formats together; the streams go on."""
    read = []

    def counted(message):
        read.append(message)
        return read_raw(message)

    for module in ("scan", "session", "kept"):
        monkeypatch.setattr(f"sense4hri_session.{module}.read_raw", counted)
    session = sense4hri_session.open(recording)
    opened, before = len(read), session["p1/ecg/h10_1"].frame()
    read.clear()
    export(session, tmp_path / "out")
    assert len(read) == opened > 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(
        ["bids", "codebook.csv", "csv", "edf", "parquet", "session.json", "session.xdf"]
    )
    assert session["p1/ecg/h10_1"].frame().equals(before)


def test_without_its_library_all_but_edf_is_written_and_said_to_be(session, tmp_path, monkeypatch):
    """As on a Python for which there is no wheel of it: nothing fails, a note says what is missing and what helps."""
    monkeypatch.setattr(edf, "pyedflib", None)
    notes = export(session, tmp_path / "all")
    assert edf.LACKING in notes
    assert "sense4hri_session[edf]" in edf.LACKING
    assert {path.name for path in (tmp_path / "all").iterdir()} >= {"parquet", "csv", "session.xdf", "bids"}
    assert [*(tmp_path / "all").rglob("*.?df")] == [tmp_path / "all" / "session.xdf"]
    with pytest.raises(SessionError, match="no EDF"):
        export(session, tmp_path / "asked", ("edf",))
    assert not (tmp_path / "asked").exists()
    assert edf.LACKING not in export(session, tmp_path / "table", ("csv",))


def test_an_existing_folder_is_left_alone(session, tmp_path):
    """Nothing is ever overwritten."""
    (tmp_path / "out").mkdir()
    with pytest.raises(SessionError, match="exists already"):
        export(session, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_file_where_a_folder_must_be_is_named(session, tmp_path):
    """Below a file there is no folder: that file is there, not the export."""
    (tmp_path / "notes").write_text("")
    with pytest.raises(SessionError, match=r"notes/out cannot be made: .*/notes: File exists"):
        export(session, tmp_path / "notes" / "out")


def test_a_failure_leaves_nothing_behind(session, tmp_path, monkeypatch):
    """Where the disk refuses half-way, neither the target nor a half of it is there."""

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sense4hri_session.export.xdf.write", full)
    with pytest.raises(SessionError, match="No space left"):
        export(session, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_the_command(recording, tmp_path, capsys):
    """`sense4hri-export --formats csv` writes only that; `--list` says what is in it."""
    assert main([str(recording), "--out", str(tmp_path / "out"), "--formats", "csv"]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["codebook.csv", "csv", "session.json"]
    capsys.readouterr()
    assert main([str(recording), "--list"]) == 0
    assert "p1/ecg/h10_1\t" in capsys.readouterr().out


def test_the_list_shows_what_others_called_their_channels_on_one_line(study, capsys):
    """A newline, a tab and what moves a terminal's cursor are shown by their pictures."""
    study.raw("p1/ecg/h10_1", START_NS, 0, {"a\n\tb\x1b[2J": np.zeros(13)})
    assert main([str(study.write()), "--list"]) == 0
    told = capsys.readouterr()
    assert "\ta␊␉b␛[2J\t" in told.out
    assert all(line.replace("\t", "").isprintable() for line in (told.out + told.err).splitlines())


@pytest.mark.parametrize("device_time", [True, False])
def test_a_repeated_message_of_an_irregular_stream_is_there_once(study, device_time):
    """The whole message again is left out; another value, or the same one received anew at an equal stamp, is kept."""
    key, pressed = "p1/button/box_1", [(1, 1.0), (1, 1.0), (2, np.nan), (2, np.nan), (3, 5.0), (3, 6.0), (4, 7.0)]
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[study.sensor(key, 0.0, "", ["pressed"], 0)])
    for second, value in pressed:
        device_ns = (100 + second) * SECOND if device_time else 0
        study.raw(key, START_NS + second * SECOND, device_ns, {"pressed": np.array([value])})
    study.raw(key, START_NS + 4 * SECOND + 1, device_ns, {"pressed": np.array([7.0])})
    folder = study.write()
    _, samples = sense4hri_session.open(folder)[key].arrays()
    np.testing.assert_array_equal(samples.ravel(), [1.0, np.nan, 5.0, 6.0, 7.0, 7.0])
    (reported,) = make_report(folder)["streams"]
    assert (reported["samples"], reported["duplicates"], reported["conflicting_stamps"]) == (6, 2, 0)


@pytest.mark.parametrize("reset", [False, True])
def test_samples_that_a_device_sends_once_more_are_there_once(study, reset):
    """Received anew after newer ones, of the same device time. After a reset the same stamps and values are new."""
    key, sent = "p1/ecg/h10_1", [*range(100), 60, *range(100, 200), *(range(100) if reset else ())]
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[study.sensor(key, 130.0, "uV", ["ecg"], 14)])
    for i, device in enumerate(sent, 1):
        study.raw(key, START_NS + i * SECOND // 10, (device + 1) * SECOND // 10, {"ecg": np.full(13, float(device))})
    folder = study.write()
    _, samples = sense4hri_session.open(folder)[key].arrays()
    assert samples[::13, 0].tolist() == [*range(200), *(range(100) if reset else ())]
    if not reset:
        assert make_report(folder)["streams"][0]["samples"] == len(samples)


@pytest.mark.parametrize("device_time", [True, False])
@pytest.mark.parametrize("later", [1, 5])
def test_a_message_that_comes_again_after_newer_ones_is_there_once(study, device_time, later):
    """As the report has it, with device time or without: nothing is doubled, and the samples lie as without it."""
    key = "p1/ecg/h10_1"
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[study.sensor(key, 130.0, "uV", ["ecg"], 14)])
    for i in range(100):
        at_ns = START_NS + (i + 1) * SECOND // 10
        study.raw(key, at_ns, at_ns - START_NS if device_time else 0, {"ecg": np.full(13, float(i))})
    _, (log_ns, number, *rest) = study.messages[0], study.messages[41]
    study.messages.append((log_ns + later * SECOND // 10 + 1, number + 1000, *rest))
    folder = study.write()
    times_ns, samples = sense4hri_session.open(folder)[key].arrays()
    assert samples[::13, 0].tolist() == list(range(100))
    assert np.abs(np.diff(times_ns) * 130 / SECOND - 1).max() < 0.01
    assert make_report(folder)["streams"][0]["duplicates"] == 1


def test_an_irregular_stream_keeps_its_times(study, tmp_path, capsys):
    """Parquet, CSV and XDF have every fixation at its time, EDF and BIDS none, and the command says so."""
    at = START_NS + np.cumsum(np.random.default_rng(2).integers(SECOND // 20, SECOND, 50))
    for i, log_ns in enumerate(at.tolist()):
        study.raw("p1/eye_tracking/pupil_1", log_ns, 0, {"x": np.array([float(i)])})
    sensor = study.sensor("p1/eye_tracking/pupil_1", 0.0, "px", ["x"], 0)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[sensor])
    out = tmp_path / "out"
    assert main([str(study.write()), "--out", str(out)]) == 0
    assert "p1/eye_tracking/pupil_1 is irregular" in capsys.readouterr().err
    table = pyarrow.parquet.read_table(out / "parquet" / "p1_eye_tracking_pupil_1.parquet")
    assert table["x"].to_pylist() == list(range(50))
    assert np.abs(table["time_ns"].to_numpy() - at).max() < 1000
    streams, _ = pyxdf.load_xdf(out / "session.xdf", dejitter_timestamps=False)
    found = next(stream for stream in streams if stream["info"]["name"][0] == "p1/eye_tracking/pupil_1")
    np.testing.assert_allclose(found["time_stamps"], (at - START_NS) * 1e-9, atol=1e-6)
    assert not list(out.rglob("*.edf")) + list(out.rglob("*.bdf")) + list(out.rglob("*physio*"))


def test_a_channel_may_be_called_as_a_column_of_its_table(study):
    """It has `channel_` before its name there and in the codebook, unless another channel has that; EDF as ever."""
    names = ["segment", "time_ns", "channel_time_ns", "ecg"]
    for i in range(100):
        samples = {name: np.full(13, 10.0 * at) for at, name in enumerate(names)}
        study.raw("p1/ecg/x_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, samples)
    about = study.sensor("p1/ecg/x_1", 130.0, "uV", names, 16)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    session, out = sense4hri_session.open(study.write()), study.parent / "out"
    export(session, out)
    columns = ["channel_segment", "channel_channel_time_ns", "channel_time_ns", "ecg"]
    whole = ["time_s", "time_ns", *columns, "device_time_ns", "received_ns", "segment"]
    table = pyarrow.parquet.read_table(out / "parquet" / "p1_ecg_x_1.parquet")
    assert table.column_names == pd.read_csv(out / "csv" / "p1_ecg_x_1.csv").columns.tolist() == whole
    for at, column in enumerate(columns):
        assert set(table[column].to_pylist()) == {10.0 * at}
    assert set(table["segment"].to_pylist()) == {1}
    assert abs(table["time_ns"][0].as_py() - START_NS) < SECOND
    frame = session["p1/ecg/x_1"].frame()
    assert frame["channel_segment"].tolist() == table["channel_segment"].to_pylist()
    codebook = pd.read_csv(out / "codebook.csv", keep_default_na=False)
    told = codebook[codebook["table"] == "p1_ecg_x_1"].set_index("column")["description"]
    assert told["channel_channel_time_ns"] == "sample of channel time_ns, ecg of x_1"
    assert told["time_ns"].startswith("time of the sample")
    assert mne.io.read_raw_edf(out / "edf" / "p1_ecg_x_1.edf", verbose="error").ch_names == names


def test_a_number_beyond_any_unit_takes_no_room_in_edf(study):
    """One damaged sample does not stretch the range of its channel until the signal is a flat line."""
    for i in range(100):
        samples = 100 * np.sin(np.arange(i * 13, i * 13 + 13) / 20)
        samples[7] = 1e300 if i == 50 else samples[7]
        study.raw("p1/ecg/x_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, {"ecg": samples})
    about = study.sensor("p1/ecg/x_1", 130.0, "uV", ["ecg"], 16)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    export(sense4hri_session.open(study.write()), study.parent / "out", ("edf",))
    raw = mne.io.read_raw_edf(study.parent / "out" / "edf" / "p1_ecg_x_1.edf", preload=True, verbose="error")
    assert np.abs(raw.get_data()).max() == pytest.approx(100e-6, rel=0.05)
    assert "BAD_gap" in raw.annotations.description


@pytest.mark.parametrize(("code", "step_us", "told"), [(-9999.0, 0.002, False), (1e6, 0.2, True)])
def test_a_value_beyond_the_sensors_range_does_not_flatten_edf(study, code, step_us, told):
    """An error code among microsiemens: the file has 24 bits then, and where those are too few a note says so."""
    for i in range(100):
        samples = 2 + np.sin(np.arange(i * 4, i * 4 + 4) / 20)
        samples[2] = code if i == 50 else samples[2]
        study.raw("p1/eda/x_1", START_NS + i * SECOND, (i + 10) * SECOND, {"eda": samples})
    about = study.sensor("p1/eda/x_1", 4.0, "uS", ["eda"], 16, range_min=0.0, range_max=100.0)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    session = sense4hri_session.open(study.write())
    notes = export(session, study.parent / "out", ("edf",))
    (file,) = (study.parent / "out" / "edf").iterdir()
    with pyedflib.EdfReader(str(file)) as reader:
        begun_s, values = reader.getStartdatetime().replace(tzinfo=UTC).timestamp(), reader.readSignal(0)
    time_ns, samples = session["p1/eda/x_1"].arrays()
    found = np.interp(time_ns[4:180] / SECOND - begun_s, np.arange(len(values)) / 4, values)
    np.testing.assert_allclose(found, samples[4:180, 0], atol=step_us)
    assert any("beyond the sensor's range" in note for note in notes) == told


@pytest.mark.parametrize(("code", "ending", "told"), [(0.0, ".edf", False), (7e6, ".bdf", False), (1e12, ".bdf", True)])
def test_where_no_range_is_told_one_value_does_not_flatten_edf_in_silence(study, code, ending, told):
    """The usual change in a second is held against the file's steps: 24 bits, and where these are too few a note."""
    truth = 500 * np.sin(np.arange(1300) / 20)
    for i in range(100):
        samples = truth[13 * i : 13 * i + 13].copy()
        samples[2] += code if i == 50 else 0.0
        study.raw("p1/ecg/x_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, {"ecg": samples})
    about = study.sensor("p1/ecg/x_1", 130.0, "uV", ["ecg"], 12)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    notes = export(sense4hri_session.open(study.write()), study.parent / "out", ("edf",))
    (file,) = (study.parent / "out" / "edf").iterdir()
    assert (file.suffix, any("less than 16 steps of the file" in note for note in notes)) == (ending, told)
    with pyedflib.EdfReader(str(file)) as reader:
        assert (np.ptp(reader.readSignal(0)[260:520]) == pytest.approx(1000, abs=5)) != told


@pytest.fixture
def changed(study):
    """Channel a is near 100, b near 200, c near 300: a and b for 20 s, b and c for 10 s, b and a for 10 s."""
    level = {"a": 100.0, "b": 200.0, "c": 300.0}
    for i in range(400):
        names = ("a", "b") if i < 200 else ("b", "c") if i < 300 else ("b", "a")
        samples = {name: level[name] + np.sin(i / 10 + np.arange(13) / 130) for name in names}
        study.raw("p1/eog/x_1", START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, samples)
    about = study.sensor("p1/eog/x_1", 130.0, "uV", ["a", "b"], 16)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[about])
    export(sense4hri_session.open(study.write()), study.parent / "out")
    return study.parent / "out"


def test_changed_channels_stay_apart_in_every_format(changed):
    """Each channel has its own values where it came and none where it did not, whatever place it had in a message."""
    came = {"a": [(0, 20), (30, 40)], "b": [(0, 40)], "c": [(20, 30)]}

    def check(seconds, values, name, level, around):
        inside = np.any([(seconds > low + around) & (seconds < high - around) for low, high in came[name]], axis=0)
        outside = np.all([(seconds < low - around) | (seconds > high + around) for low, high in came[name]], axis=0)
        assert np.abs(values[inside] - level).max() < 1.3
        assert np.isnan(values[outside]).all()
        assert inside.sum() > 1000

    seconds = np.arange(400 * 13) / 130
    flat = pyarrow.parquet.read_table(changed / "parquet" / "p1_eog_x_1.parquet").to_pandas()
    physio = next((changed / "bids").rglob("*_physio.tsv.gz"))
    about = json.loads(physio.with_name(physio.name.replace(".tsv.gz", ".json")).read_text())
    columns, begins_s = about["Columns"], about["StartTime"]
    rows = pd.read_csv(physio, sep="\t", header=None, names=columns, na_values="n/a")
    raw = mne.io.read_raw_edf(changed / "edf" / "p1_eog_x_1.edf", preload=True, verbose="error")
    assert columns == raw.ch_names == ["a", "b", "c"]
    for name, level in (("a", 100.0), ("b", 200.0), ("c", 300.0)):
        check(seconds, flat[name].to_numpy(), name, level, 0.0)
        check(begins_s + np.arange(len(rows)) / 130 + 0.1, rows[name].to_numpy(), name, level, 0.2)
    where = {
        (tuple(a["ch_names"]), round(a["onset"]), round(a["duration"]))
        for a in raw.annotations
        if a["description"] == "BAD_gap" and a["ch_names"]
    }
    assert where == {(("a",), 21, 10), (("c",), 1, 20), (("c",), 31, 10)}
    streams, _ = pyxdf.load_xdf(changed / "session.xdf", dejitter_timestamps=False)
    sets = {
        tuple(channel["label"][0] for channel in stream["info"]["desc"][0]["channels"][0]["channel"]): stream
        for stream in streams
    }
    for names, messages in ((("a", "b"), 200), (("b", "c"), 100), (("b", "a"), 100)):
        assert len(sets[names]["time_series"]) == messages * 13
        assert np.abs(sets[names]["time_series"] - [100.0 * (ord(name) - 96) for name in names]).max() < 1.3
    assert "3 sets of channels (a, b; b, c; b, a)" in json.loads((changed / "session.json").read_text())["notes"][0]


def test_no_ros_is_imported():
    """Reading and exporting need no ROS."""
    probe = "import sense4hri_session.__main__, sys; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", probe], check=False).returncode == 0


def test_the_session_begins_and_ends_in_every_format(recording, tmp_path):
    """EDF, XDF, BIDS, Parquet and CSV have the session begin and end at start_at and stop_at, markers at theirs."""
    copy = shutil.copytree(recording, tmp_path / "copy")
    session_id = sense4hri_session.open(copy).info["session_id"]
    edges = {"start_at_ns": START_NS + 20 * SECOND, "stop_at_ns": START_NS + 80 * SECOND}
    (copy / "recorder.json").write_text(json.dumps({"session": {"session_id": session_id, **edges}}))
    session = sense4hri_session.open(copy)
    export(session, tmp_path / "out")
    truth = {"baseline_start": 10.5, "session_start": 20, "stimulus": 30.25, "my_own": 60.0, "session_stop": 80.0}
    start_s = session.start_ns / SECOND

    for file in (tmp_path / "out" / "edf").iterdir():
        raw = mne.io.read_raw(file, verbose="error")
        begin = raw.info["meas_date"].timestamp() - START_NS / SECOND
        found = {
            a["description"].split(":")[0]: begin + a["onset"] for a in raw.annotations if "BAD" not in a["description"]
        }
        assert found == pytest.approx(truth, abs=1e-3)
    markers = next(s for s in pyxdf.load_xdf(tmp_path / "out" / "session.xdf")[0] if s["info"]["name"] == ["markers"])
    times = markers["time_stamps"] + start_s - START_NS / SECOND
    found = {row[0].split(":")[0]: at for row, at in zip(markers["time_series"], times, strict=True)}
    assert found == pytest.approx(truth, abs=1e-5)
    events = pd.read_csv(next((tmp_path / "out" / "bids").rglob("sub-p2*_events.tsv")), sep="\t")
    found = dict(zip(events["trial_type"], events["onset"] + start_s - START_NS / SECOND, strict=True))
    assert found == pytest.approx(truth, abs=1e-5)
    for table in (
        pyarrow.parquet.read_table(tmp_path / "out" / "parquet" / "timeline.parquet").to_pandas(),
        pd.read_csv(tmp_path / "out" / "csv" / "timeline.csv"),
    ):
        assert dict(zip(table["name"], (table["time_ns"] - START_NS) / SECOND, strict=True)) == truth
