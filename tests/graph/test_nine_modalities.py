"""Nine modalities of one participant, files of known truth: driver, interpreter, recorder, report, by `make demo`."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import metrics_table
import numpy as np
import pandas as pd
import pytest
import sense4hri_session
import study_file

sys.path.insert(0, str(Path(__file__).parent))
from replay_law import between, chosen, computed, differences, recompute, stamp_ns

FILE = study_file.find("nine-modalities")
STUDY = study_file.read(FILE)
TRUTH = json.loads((FILE.parent / "nine-modalities" / "truth.json").read_text())
SECONDS = 25
REPLAYED_AT = 4.0
BUSY = 0.5
"""Share of the seconds in which features must have come on a machine that is overloaded."""
NINE = ("ecg", "ppg", "eda", "respiration", "emg", "eeg", "eog", "eye_tracking", "pupillometry")

DERIVED = ("_ecg", "_accelerometer")
"""Ends of the names of respiration that comes from another stream."""


def last(features: pd.DataFrame, name: str) -> float:
    """Return the newest value of a feature that could be computed."""
    return float(features[name].dropna().iloc[-1])


def alpha_ratio(features: pd.DataFrame) -> float:
    """Return the alpha power at the back of the head over that at the forehead."""
    newest = features.iloc[-1]
    alpha = dict(zip(newest["channel_names"], newest["alpha_uv2"], strict=True))
    return float(alpha["O1"] / alpha["Fp1"])


IS_TRUE: dict[str, Callable[[pd.DataFrame], bool]] = {
    "ecg": lambda found: abs(last(found, "heart_rate_bpm") - TRUTH["heart_rate_bpm"]) < 2,
    "ppg": lambda found: abs(last(found, "heart_rate_bpm") - TRUTH["heart_rate_bpm"]) < 2,
    "respiration": lambda found: abs(last(found, "breaths_per_min") - TRUTH["breaths_per_min"]) < 1,
    "eda": lambda found: 4.6 < last(found, "tonic_us") < 5.4,
    "emg": lambda found: 2 < np.median([row[0] for row in found["rms_uv"]]) < 150,
    "eeg": lambda found: alpha_ratio(found) > 5,
    "eog": lambda found: 4 <= last(found, "blink_rate_per_min") <= 12 and last(found, "saccade_count") > 5,
    "eye_tracking": lambda found: 600 < last(found, "fixation_duration_ms") < 800 and last(found, "valid_ratio") > 0.9,
    "pupillometry": lambda found: abs(last(found, "diameter") - TRUTH["pupil_mm"]) < 0.6,
    "accelerometer": lambda found: 0 <= last(found, "intensity_m_per_s2") < 3,
}
"""What the features of any 25 s of the minute must say."""


def interpreted() -> list[str]:
    """Return the sensor types that the study's interpreters serve."""
    own = {"interpreter_motion": "accelerometer"}
    packages = [name for name in STUDY.packages if name.startswith("interpreter_")]
    return [own.get(name, name.removeprefix("interpreter_")) for name in packages]


def unlike_in_replay(session: sense4hri_session.Session, work: Path, domain: int) -> list[str]:
    """Replay the raw part of the recording through all interpreters; return which features are not those from live.

    From the session's start on, for there everything begins anew; before it live services had heard more.
    """
    begins = session.timeline.set_index("name")["time_ns"]["session_start"]
    interpreters = [name for name in STUDY.packages if name.startswith("interpreter_")]
    again = chosen(recompute(session.path, REPLAYED_AT, work, domain, names=interpreters), "/features")
    live = between(chosen(computed(session.path), "/features"), begins, 2**63)
    until_ns = min(stamp_ns(said[-1]) for said in live.values()) + 1
    return differences(*(between(them, begins, until_ns) for them in (live, again)))


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_every_modality_goes_the_whole_way(demo, ros_domain, tmp_path):
    """Nothing is lost on the way, features are true and in a replay the same, report and metrics are complete."""
    run = demo("--study", "nine-modalities", "--duration", str(SECONDS))
    run.until("records, into", 240)
    assert metrics_table.lacking(metrics_table.scraped(run.logs), metrics_table.written()) == []
    status = run.wait(300)
    output = "\n".join(run.lines)
    assert status == 0, output
    folder = Path(next(line.split("into ")[1] for line in run.lines if "records, into" in line))
    report = json.loads((folder / "report.json").read_text())
    assert report["verdict"] == "complete", report["why"]
    own = [entry for entry in report["streams"] if not entry["stream"].endswith(DERIVED)]
    streams = {entry["stream"].split("/")[1]: entry for entry in own}
    assert set(streams) == {*NINE, "accelerometer"}
    session = sense4hri_session.open(folder)
    for sensor_type in interpreted():
        entry = streams[sensor_type]
        assert entry["features_messages"] > BUSY * SECONDS, sensor_type
        features = session.features(entry["stream"])
        assert IS_TRUE[sensor_type](features), f"{sensor_type}:\n{features.tail(3).T.to_string()}"
        assert features["signal_quality"].max() > 0.5, f"{sensor_type}: {features['reasons'].iloc[-1]}"
    assert unlike_in_replay(session, tmp_path / "again", ros_domain) == []


def test_the_study_interprets_whatever_the_project_can():
    """Every interpreter that exists has its place in the study, and what it must say is known here."""
    services = {path.name.replace("-", "_") for path in (FILE.parents[2] / "services").glob("interpreter-*")}
    assert services == {name for name in STUDY.packages if name.startswith("interpreter_")}
    assert set(interpreted()) == set(IS_TRUE)
