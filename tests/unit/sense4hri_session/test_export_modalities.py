"""Every modality of the contract goes into an export: BIDS in the place it has for it, features with every column."""

import json
import subprocess
import sysconfig
from pathlib import Path

import mne
import mne_bids
import numpy as np
import pandas as pd
import pyedflib
import pytest
import sense4hri_session
from sense4hri.modalities import MODALITIES
from sense4hri_session.export import export
from sense4hri_session.placement import placement_scheme

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
SECONDS, EPOCH_S = 6, 1000
RATES_HZ = {"eeg": 128, "emg": 500, "eog": 100, "eye_tracking": 60, "pupillometry": 60, "respiration": 25, "eda": 4}
CHANNELS = {
    "eeg": ("Cz", "Oz", "HEOG"),
    "emg": ("biceps",),
    "eog": ("veog",),
    "eye_tracking": ("gaze_x", "gaze_y", "confidence"),
    "pupillometry": ("diameter_left", "diameter_right"),
    "respiration": ("respiration",),
    "eda": ("eda",),
}

EXTRAS = {
    "EDA": {"scr_threshold": "least amplitude", "of_a_lab": "without a field"},
    "EEG": {"relative_alpha": "share of the band", "alpha_asymmetry_F4_F3": "ln of the left"},
    "EyeTracking": {"dwell_cup": "area of interest"},
    "Respiration": {"source_ecg_h10_1": "computed from"},
}


def stamp(ns):
    return {"sec": ns // SECOND, "nanosec": ns % SECOND}


def header(ns):
    return {"stamp": stamp(ns), "frame_id": ""}


@pytest.fixture(scope="module")
def out(new_study):
    """The export of a study with a stream of seven types and a features message of every type, all of one person."""
    study = new_study
    for kind, rate_hz in RATES_HZ.items():
        for second in range(SECONDS):
            times_s = second + np.arange(rate_hz) / rate_hz
            samples = {name: np.sin(times_s) + number for number, name in enumerate(CHANNELS[kind])}
            received_ns, device_ns = (round((base + times_s[-1]) * SECOND) for base in (START_NS // SECOND, EPOCH_S))
            study.raw(f"p1/{kind}/{kind}_1", received_ns, device_ns, samples)
    for modality in (each for each in MODALITIES.values() if each.message):
        topic = f"/humans/physiological/p1/{modality.sensor_type}/{modality.sensor_type}_1/features"
        now = {"header": header(START_NS), "device_timestamp": stamp(SECOND)}
        extra = [{"name": name, "unit": "s", "values": [1.0]} for name in EXTRAS.get(modality.message, ())]
        study.add(topic, modality.message, START_NS + SECOND, **now, extra=extra)
    about = [
        study.sensor(f"p1/{kind}/{kind}_1", float(rate_hz), MODALITIES[kind].units[0], list(CHANNELS[kind]), 16)
        for kind, rate_hz in RATES_HZ.items()
    ]
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=about)
    at_ns = START_NS + 2_500_000_000
    study.add("/study/markers", "Marker", at_ns, header=header(at_ns), name="stimulus", value="7", source="gui")
    export(sense4hri_session.open(study.write()), study.parent / "out", ("csv", "bids"))
    return study.parent / "out"


def test_the_validator_finds_no_error(out):
    """`_eeg` and `_emg` in folders of their own, gaze as eyetrack, everything else as physio."""
    command = Path(sysconfig.get_path("scripts")) / "bids-validator-deno"
    done = subprocess.run([command, "--json", out / "bids"], capture_output=True, text=True, check=False, timeout=400)
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue.get("severity") == "error"] == []
    person = out / "bids" / "sub-p1"
    assert sorted(path.name for path in person.iterdir()) == ["beh", "eeg", "emg"]
    assert len(list((person / "beh").glob("*_physio.tsv.gz"))) == len(RATES_HZ) - 2


def test_the_eeg_is_the_signal_with_its_channels_and_markers(out):
    """MNE reads it: values in V, the marker where it happened; channels.tsv tells an EOG among electrodes."""
    folder = out / "bids" / "sub-p1" / "eeg"
    raw = mne.io.read_raw(next(folder.glob("*_eeg.edf")), preload=True, verbose="error")
    assert raw.info["sfreq"] == RATES_HZ["eeg"]
    begun_s = raw.info["meas_date"].timestamp()
    offset_s = START_NS / SECOND - begun_s
    found = np.interp(offset_s + np.arange(1, 5, 0.1), raw.times, raw.get_data(["Oz"])[0] * 1e6)
    np.testing.assert_allclose(found, np.sin(np.arange(1, 5, 0.1)) + 1, atol=0.05)
    channels = pd.read_csv(next(folder.glob("*_channels.tsv")), sep="\t")
    assert channels["name"].tolist() == list(CHANNELS["eeg"])
    assert channels["type"].tolist() == ["EEG", "EEG", "EOG"]
    events = pd.read_csv(next(folder.glob("*_events.tsv")), sep="\t")
    (onset_s,) = events.loc[events["trial_type"] == "stimulus", "onset"]
    assert onset_s + begun_s == pytest.approx(START_NS / SECOND + 2.5, abs=1e-3)


def test_an_independent_reader_finds_signals_types_and_markers(out):
    """MNE-BIDS by the folder alone: EEG and EMG with what channels.tsv and events.tsv say of them."""
    paths = mne_bids.find_matching_paths(out / "bids", extensions=".edf")
    raws = {path.datatype: mne_bids.read_raw_bids(path, verbose="error") for path in paths}
    types = {datatype: raw.get_channel_types() for datatype, raw in raws.items()}
    assert types == {"eeg": ["eeg", "eeg", "eog"], "emg": ["emg"]}
    for datatype, raw in raws.items():
        (marker,) = raw.annotations
        marked_s = raw.info["meas_date"].timestamp() + marker["onset"]
        assert (raw.info["sfreq"], marker["description"]) == (RATES_HZ[datatype], "stimulus")
        assert marked_s == pytest.approx(START_NS / SECOND + 2.5, abs=1e-3)


def test_a_sidecar_counts_the_channels_of_each_type_and_the_seconds_of_its_file(out):
    """An EOG among the electrodes is no EEG channel, and a file is as long as itself, not as the session."""
    folder = out / "bids" / "sub-p1" / "eeg"
    about = json.loads(next(folder.glob("*_eeg.json")).read_text())
    counts = {name: count for name, count in about.items() if name.endswith("ChannelCount")}
    kinds = {"EEG": 2, "EOG": 1, "ECG": 0, "EMG": 0, "MISC": 0}
    assert counts == {f"{kind}ChannelCount": count for kind, count in kinds.items()}
    with pyedflib.EdfReader(str(next(folder.glob("*_eeg.edf")))) as reader:
        assert about["RecordingDuration"] == reader.getFileDuration()


def test_a_confidence_is_no_angle(out):
    """The codebook and BIDS have gaze in degrees, and beside it the tracker's confidence without a unit."""
    book = pd.read_csv(out / "codebook.csv", keep_default_na=False).set_index(["table", "column"])["unit"]
    assert book["p1_eye_tracking_eye_tracking_1", "gaze_x"] == "deg"
    assert book["p1_eye_tracking_eye_tracking_1", "confidence"] == "1"
    about = json.loads(next((out / "bids").rglob("*eyetracking*_physio.json")).read_text())
    assert (about["x_coordinate"]["Units"], about["confidence"]["Units"]) == ("deg", "arbitrary")


def test_names_tell_the_system_of_the_electrodes_but_no_positions(out):
    """Cz and Oz beside an EOG: the 10-20 system in the sidecar, and no coordinates that nobody measured."""
    folder = out / "bids" / "sub-p1" / "eeg"
    assert json.loads(next(folder.glob("*_eeg.json")).read_text())["EEGPlacementScheme"] == "10-20"
    assert not [*folder.glob("*_electrodes.tsv"), *folder.glob("*_coordsystem.json")]


@pytest.mark.parametrize(
    ("names", "system"),
    [
        (("FP1", "Fz", "T3", "t7", "P8", "A1"), "10-20"),
        (("Fp1", "AF7", "TP9", "FCz", "PO10", "Iz"), "10-10"),
        (("Cz", "EEG1"), ""),
        (("E1", "E128"), ""),
        (("FPz1", "C0z"), ""),
        ((), ""),
    ],
)
def test_a_system_is_told_only_where_every_name_is_of_it(names, system):
    """Today's and the older names, in any case; one other name, or none at all: no system."""
    assert placement_scheme(names) == system


def test_gaze_has_the_columns_that_bids_wants(out):
    """A time, x and y first, then what else the tracker says."""
    start = out / "bids" / "sub-p1" / "beh" / "sub-p1_task-study_recording-eyetrackingeyetracking1_physio"
    about = json.loads(start.with_suffix(".json").read_text())
    assert about["PhysioType"] == "eyetrack"
    assert about["Columns"] == ["timestamp", "x_coordinate", "y_coordinate", "confidence"]
    assert about["x_coordinate"]["Units"] == "deg"
    values = pd.read_csv(f"{start}.tsv.gz", sep="\t", header=None, names=about["Columns"])
    np.testing.assert_allclose(np.diff(values["timestamp"]), 1 / RATES_HZ["eye_tracking"], atol=1e-6)
    apart = (values["y_coordinate"] - values["x_coordinate"]).dropna()
    assert len(apart) > (SECONDS - 1) * RATES_HZ["eye_tracking"]
    np.testing.assert_allclose(apart, 1, atol=1e-6)


@pytest.fixture(scope="module")
def odd(new_study, tmp_path_factory):
    """The export of EMG whose names are long or not ASCII and whose values are beyond what an EDF header holds."""
    study, kinds = (
        type(new_study)(tmp_path_factory.mktemp("odd")),
        {"emg": ("tibialis_anterior_left", "tibialis_anterior_right", "前額", "眼瞼")},
    )
    kinds["eye_tracking"] = ("gaze_x", "gaze_y")
    for second in range(SECONDS):
        for kind, names in kinds.items():
            times_s = second + np.arange(100) / 100
            large = 2e7 if kind == "emg" else 1.0
            samples = {name: large * np.sin(times_s) for name in names}
            received_ns, device_ns = (round((base + times_s[-1]) * SECOND) for base in (START_NS // SECOND, EPOCH_S))
            study.raw(f"p1/{kind}/{kind}_1", received_ns, device_ns, samples)
    about = [
        study.sensor(f"p1/{kind}/{kind}_1", 100.0, MODALITIES[kind].units[0], list(kinds[kind]), 16) for kind in kinds
    ]
    about[1]["body_location"] = "right eye"
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=about)
    export(sense4hri_session.open(study.write()), study.parent / "odd", ("bids",))
    return study.parent / "odd" / "bids" / "sub-p1"


def test_channels_say_what_their_file_says(odd):
    """channels.tsv and the BDF agree in names, of which none comes twice, and in the unit of thousands."""
    channels = pd.read_csv(next((odd / "emg").glob("*_channels.tsv")), sep="\t", keep_default_na=False)
    with pyedflib.EdfReader(str(next((odd / "emg").glob("*_emg.?df")))) as reader:
        assert reader.getSignalLabels() == channels["name"].tolist()
        assert {reader.getPhysicalDimension(0)} == {unit.replace("µ", "u") for unit in channels["units"]} == {"1000 uV"}
    assert channels["name"].is_unique
    assert channels["description"].tolist() == ["tibialis_anterior_left", "tibialis_anterior_right", "前額", "眼瞼"]


def test_the_eye_is_the_one_that_was_told(odd, out):
    """By the body location; where nobody said, that it is not known stands beside BIDS' word."""
    told, untold = (
        json.loads(next((each / "beh").glob("*eyetracking*_physio.json")).read_text())
        for each in (odd, out / "bids" / "sub-p1")
    )
    assert told["RecordedEye"] == "right"
    assert "not told" in untold["RecordedEyeDescription"]


def test_the_codebook_explains_every_feature(out):
    """Every column of every features message has its sentence."""
    book = pd.read_csv(out / "codebook.csv", keep_default_na=False)
    rows = {(row.table, row.column): row.description for row in book.itertuples()}
    for modality in (each for each in MODALITIES.values() if each.message):
        name = f"p1_{modality.sensor_type}_{modality.sensor_type}_1_features"
        columns = pd.read_csv(out / "csv" / f"{name}.csv", nrows=0).columns
        assert [column for column in columns if not rows[name, column]] == [], name


def test_the_codebook_explains_what_has_no_field_of_its_own(out):
    """Names in `extra` that interpreters here give have a sentence of their own, with the unit that was told."""
    book = pd.read_csv(out / "codebook.csv", keep_default_na=False).set_index("column")
    for name, words in (pair for extras in EXTRAS.values() for pair in extras.items()):
        assert words in book.loc[f"extra_{name}", "description"], name
        assert book.loc[f"extra_{name}", "unit"] == "s"
