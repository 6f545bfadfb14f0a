"""What `make study` writes of other kinds of sensors than the demo's runs: from a wish to a complete recording."""

import json
import sys

import new_study
import study_file

SECONDS = 12


def test_a_written_study_is_recorded(demo, tmp_path, monkeypatch):
    """A breathing belt at the radio and gaze over LSL, each with its interpreter, and every stream complete."""
    words = ["pilot", "--virtual", "--sensors", "vernier,lsl-gaze", "--no-page", "--no-prometheus"]
    monkeypatch.setattr(sys, "argv", ["new_study.py", *words, "--folder", str(tmp_path)])
    assert new_study.main() == 0
    study = study_file.read(tmp_path / "pilot.yaml")
    assert {"interpreter_respiration", "interpreter_eye_tracking"} <= study.packages
    run = demo("--study", str(tmp_path / "pilot.yaml"), "--duration", str(SECONDS))
    run.until("records, into", 120)
    assert run.wait(120 + SECONDS) == 0, "\n".join(run.lines)
    (file,) = tmp_path.glob("recordings/**/report.json")
    report = json.loads(file.read_text())
    assert report["verdict"] == "complete", report["problems"]
    raw = {entry["stream"] for entry in report["streams"] if entry["kind"] == "raw" and entry["features_messages"]}
    assert {"p1/respiration/vernier_1", "p1/eye_tracking/lsl_gaze_1"} <= raw
