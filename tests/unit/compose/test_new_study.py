"""`make study`: what it writes is a study, says what was asked for, and takes nobody's work away."""

import subprocess
import sys
from pathlib import Path

import check_study
import new_study
import pytest
import study_file
from sensor_bench.config import parse
from study_file import Study

ROOT = Path(__file__).resolve().parents[3]
READY = ROOT / "compose" / "studies"
WRITTEN = {
    "eight-participants": ["--participants", "8", "--virtual", "--task", "rest"],
    "record-only": ["--record-only", "--virtual", "--no-prometheus", "--participants", "2"],
    "replay": ["--replay"],
}
"""Ready studies that `make study` has written, with the flags."""


def make(folder: Path, monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["new_study.py", *words, "--folder", str(folder)])
    return new_study.main()


def written(folder: Path, monkeypatch: pytest.MonkeyPatch, *flags: str) -> Study:
    """The study that these flags make; it must pass `make check`."""
    assert make(folder, monkeypatch, "pilot", *flags) == 0
    found = check_study.findings(folder / "pilot.yaml", "processes", 0.1, folder, {})
    assert [str(each) for each in found if each.severity == "error"] == []
    return study_file.read(folder / "pilot.yaml", {})


def test_real_sensors_with_the_ids_printed_on_them(tmp_path, monkeypatch):
    """Each participant wears one of each kind; an id that is not given yet is told by `make check` as a warning."""
    flags = ("--participants", "anna,ben", "--id", "h10_1=1A2B3C4D", "--id", "verity_2=A0:9E:1A:00:00:01")
    study = written(tmp_path, monkeypatch, *flags)
    assert [(each.sensor_id, each.human_id) for each in study.sensors] == [
        ("h10_1", "anna"), ("verity_1", "anna"), ("h10_2", "ben"), ("verity_2", "ben"),
    ]  # fmt: skip
    assert study.sensors[0].parameters["name"] == "Polar H10 1A2B3C4D"
    assert study.sensors[3].parameters["address"] == "A0:9E:1A:00:00:01"
    texts = [each.text for each in check_study.findings(tmp_path / "pilot.yaml", "processes", 0.1, tmp_path, {})]
    assert sum("only an example" in text for text in texts) == 2
    assert "bluetooth" in {service.name for service in study.services}


def test_interpreters_follow_from_the_sensors(tmp_path, monkeypatch):
    """Who wears straps alone needs nobody who looks at pulses."""
    study = written(tmp_path, monkeypatch, "--sensors", "h10", "--no-page", "--no-prometheus")
    assert "interpreter_ecg" in study.packages
    assert not {"interpreter_ppg", "web_gui"} & study.packages
    assert study.only_images == tuple(each for each in study.services if each.name == "bluetooth")


def test_a_virtual_study_plays_every_sensor_it_has(tmp_path, monkeypatch):
    """The bench plays exactly the devices that the drivers look for."""
    study = written(tmp_path, monkeypatch, "--participants", "24", "--virtual")
    bench = study.of("sensor_bench")
    assert bench is not None
    played = {device.sensor: device.device_id for device in parse(bench.parameters["devices"]).devices}
    assert played == {each.sensor_id: each.parameters["name"].split()[-1] for each in study.sensors}
    assert len(played) == 48


@pytest.mark.parametrize("name", WRITTEN)
def test_ready_studies_are_what_it_writes(name):
    """Those that say so are the same to the letter: make study NAME=... FLAGS="... --force"."""
    before = (READY / f"{name}.yaml").read_text()
    wish = new_study.wish_of([name, *WRITTEN[name]])
    assert new_study.study_text.text(wish, READY) == before


def test_a_file_that_is_there_stays(tmp_path, monkeypatch, capsys):
    """Without --force nothing is written over."""
    (tmp_path / "pilot.yaml").write_text("mine")
    assert make(tmp_path, monkeypatch, "pilot", "--virtual") == 78
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "pilot.yaml").read_text() == "mine"
    assert make(tmp_path, monkeypatch, "pilot", "--virtual", "--force") == 0
    assert (tmp_path / "pilot.yaml").read_text() != "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["Pilot!"], "NAME 'Pilot!' must be small letters"),
        (["pilot", "--participants", "p1,p1"], "--participants 'p1'"),
        (["pilot", "--participants", "100"], "--participants 100: 1 to 99"),
        (["pilot", "--participants", "1p"], "--participants '1p'"),
        (["pilot", "--sensors", "h11"], "--sensors 'h11': give each once, of h10, verity, oh1"),
        (["pilot", "--sensors", ""], "--sensors: give at least one"),
        (["pilot", "--id", "h10_2=1A2B3C4D"], "--id h10_2: the study's sensors are h10_1, verity_1"),
        (["pilot", "--id", "h10_1=12"], "--id h10_1=12: 8 hexadecimal digits"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(tmp_path, monkeypatch, capsys, words, said):
    """Status 78, the flag and what is allowed; no file."""
    assert make(tmp_path, monkeypatch, *words) == 78
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_questions_take_the_place_of_flags(tmp_path, monkeypatch):
    """Who gives only a name is asked; an empty answer is what the question offers."""
    answers = iter(["p1,p2", "h10", "yes", "", "rest"])
    monkeypatch.setattr("builtins.input", lambda text: next(answers))
    monkeypatch.setattr(new_study, "asked", lambda words: True)
    assert make(tmp_path, monkeypatch, "pilot") == 0
    study = study_file.read(tmp_path / "pilot.yaml", {})
    assert (study.participants, study.task) == (("p1", "p2"), "rest")
    assert [each.sensor_id for each in study.sensors] == ["h10_1", "h10_2"]
    assert study.of("sensor_bench") is not None


def test_the_command_itself(tmp_path):
    """As `make study` runs it."""
    command = [sys.executable, str(ROOT / "compose" / "new_study.py"), "pilot", "--virtual", "--folder", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "nothing is wrong" in done.stdout
