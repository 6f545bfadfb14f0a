"""`make study`: what it writes is a study, says what was asked for, and takes nobody's work away."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import check_study
import new_study
import pytest
import study_file
from devices import drivers, rows_of
from sensor_bench.config import parse
from sensor_kinds import KINDS
from study_file import Study

ROOT = Path(__file__).resolve().parents[3]
READY = ROOT / "compose" / "studies"
WRITTEN = {
    "eight-participants": ["--participants", "8", "--virtual", "--task", "rest"],
    "record-only": ["--record-only", "--virtual", "--no-prometheus", "--participants", "2"],
    "replay": ["--replay"],
}
"""Ready studies that `make study` has written, with the flags."""
BARE = ("--no-page", "--no-prometheus")


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


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_makes_a_study(tmp_path, monkeypatch, kind):
    """Real, and virtual where something plays it: nothing is wrong but what is not plugged in; interpreters fit."""
    study = written(tmp_path, monkeypatch, "--sensors", kind, "--participants", "2", *BARE)
    assert [each.package for each in study.sensors] == [f"driver_{KINDS[kind].driver.replace('-', '_')}"] * 2
    assert {name.replace("-", "_") for name in KINDS[kind].interpreters} <= study.packages
    assert study.of("sensor_bench") is None
    if not KINDS[kind].model:
        return
    (tmp_path / "pilot.yaml").unlink()
    study = written(tmp_path, monkeypatch, "--sensors", kind, "--participants", "2", "--virtual", *BARE)
    assert [str(each) for each in check_study.findings(tmp_path / "pilot.yaml", "processes", 0.1, tmp_path, {})] == []
    bench = study.of("sensor_bench")
    assert bench is not None
    played = [device.sensor for device in parse(bench.parameters["devices"]).devices]
    assert played == [each.sensor_id for each in study.sensors]


def test_every_driver_can_be_chosen():
    """Whatever has rows in docs/devices.md is offered; a kind's row is there, and its streams are the row's."""
    assert {f"driver-{kind.driver}" for kind in KINDS.values()} == {driver.name for driver in drivers()}
    rows = [row for driver in drivers() for row in rows_of(driver)]
    assert all(kind.row in rows for kind in KINDS.values())


def test_a_kind_with_a_row_that_is_not_there_is_told():
    """Who renames a device in its driver is told what the driver has."""
    with pytest.raises(LookupError, match="driver-vernier has no device 'Belt'; it has Vernier Go Direct"):
        _ = KINDS["vernier"]._replace(device="Belt").row


def test_ids_of_other_kinds_are_ports_names_and_addresses(tmp_path, monkeypatch):
    """Each where its driver looks for it; a port is given to the container."""
    ids = {"bitalino_1": "/dev/rfcomm3", "lsl_eeg_1": "EEG of p1", "neon_1": "192.168.1.7", "vernier_1": "0K1002A1"}
    flags = [word for sensor, value in ids.items() for word in ("--id", f"{sensor}={value}")]
    study = written(tmp_path, monkeypatch, "--sensors", "bitalino,lsl-eeg,neon,vernier", *flags, *BARE)
    bitalino, eeg, neon, belt = study.sensors
    assert (bitalino.parameters["port"], bitalino.devices) == ("/dev/rfcomm3", ("/dev/rfcomm3",))
    assert eeg.parameters["outlets"] == ["name='EEG of p1'"]
    assert (neon.parameters["address"], neon.parameters["port"]) == ("192.168.1.7", 8080)
    assert belt.parameters["name"] == "GDX-RB 0K1002A1"


def test_a_virtual_device_on_the_network_is_this_machines_alone(tmp_path, monkeypatch):
    """In containers it listens for the driver beside it, as a plain process on the loopback."""
    study = written(tmp_path, monkeypatch, "--sensors", "core", "--virtual", *BARE)
    bench = study.of("sensor_bench")
    assert bench is not None
    listens = [text.partition(", address: ")[2].partition("}")[0] for text in (bench.command[-1], bench.added[-1])]
    assert listens == ["0.0.0.0", "127.0.0.1"]


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
        ([""], "NAME is missing: make study NAME=pilot"),
        (["Pilot!"], "NAME 'Pilot!' must be small letters"),
        (["a" * 300], "must be small letters, digits, _ and -, a letter or digit first, 64 at most"),
        (["pilot", "--participants", "p1,p1"], "--participants 'p1'"),
        (["pilot", "--participants", "100"], "--participants 100: 1 to 99"),
        (["pilot", "--participants", "1p"], "--participants '1p'"),
        (["pilot", "--participants", "²"], "--participants '²'"),
        (
            ["pilot", "--participants", "x,y"],
            "--participants 'y': pseudonyms of letters, digits and single '_', no",
        ),
        (["pilot", "--participants", "null"], "--participants 'null'"),
        (
            ["pilot", "--participants", "p1,unassigned"],
            "--participants 'unassigned': it means a sensor that nobody wears",
        ),
        (["pilot", "--participants", "p1,nobody"], "--participants 'nobody': it means the folder of sessions"),
        (["pilot", "--sensors", "bitalino", "--id", "bitalino_1=/dev/by-path/usb-0:2"], "a path without ':', as in"),
        (["pilot", "--sensors", "h11"], "--sensors 'h11': give each once, of h10, verity, oh1"),
        (["pilot", "--sensors", "cyton", "--virtual"], "--virtual: nothing plays 'cyton'; of these"),
        (
            ["pilot", "--sensors", "muse", "--id", "muse_1=$(x)"],
            "--id muse_1=$(x): its name, port or address, as in 00:",
        ),
        (["pilot", "--sensors", "strap", "--id", "strap_1=1234"], "--id strap_1=1234: its name, port or address"),
        (["pilot", "--sensors", "file", "--id", "file_1=x"], "--id file_1=x: it has none: name the file in the study"),
        (["pilot", "--sensors", ",".join([*KINDS][:13])], "--sensors: 13 kinds are too many"),
        (["pilot", "--sensors", ""], "--sensors: give at least one"),
        (["pilot", "--id", "h10_2=1A2B3C4D"], "--id h10_2: the study's sensors are h10_1, verity_1"),
        (["pilot", "--id", "h10_1=12"], "--id h10_1=12: 8 digits and letters"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(tmp_path, monkeypatch, capsys, words, said):
    """Status 78, the flag and what is allowed; no file."""
    assert make(tmp_path, monkeypatch, *words) == 78
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "task", ["stroop: part 1", "rest # eyes closed", "yes", "1e3", "5 $", '"fast"', "Größe", "- a"]
)
def test_a_task_is_what_was_typed(tmp_path, monkeypatch, task):
    """A sign that means something in YAML is no part of the file's form."""
    assert written(tmp_path, monkeypatch, "--virtual", "--task", task, *BARE).task == task


@pytest.mark.parametrize("name", ["2026", "on", "null", "1e3"])
def test_a_study_may_be_called_by_a_number(tmp_path, monkeypatch, name):
    """A year is a name as good as any."""
    assert make(tmp_path, monkeypatch, name, "--virtual", *BARE) == 0
    assert study_file.read(tmp_path / f"{name}.yaml", {}).name == name


@pytest.mark.parametrize("device", ["HRM Dual: 1234", "1E234", "y", "11:22:33"])
@pytest.mark.parametrize("virtual", [(), ("--virtual",)])
def test_a_device_is_called_what_it_is_called(tmp_path, monkeypatch, device, virtual):
    """A name that ROS or YAML would read as something else is in quotes, for the driver and for what plays it."""
    study = written(tmp_path, monkeypatch, "--sensors", "strap", "--id", f"strap_1={device}", *virtual, *BARE)
    assert study.sensors[0].parameters["name"] == device
    if bench := study.of("sensor_bench"):
        assert parse(bench.parameters["devices"]).devices[0].name == device


def test_no_answer_ends_the_questions(tmp_path, monkeypatch, capsys):
    """Ctrl-D is told in a sentence."""
    monkeypatch.setattr("builtins.input", lambda text: exec("raise EOFError"))
    monkeypatch.setattr(new_study, "asked", lambda words: True)
    assert make(tmp_path, monkeypatch, "pilot") == 78
    assert "\nnothing is written: no answer to: How many participants" in capsys.readouterr().err


def test_each_kind_of_sensor_is_told_with_what_it_is():
    """Nobody knows what `core` or `watch` is."""
    (text,) = (question.text for question in new_study.QUESTIONS if question.flag == "sensors")
    assert "  h10          chest strap (Polar H10)\n" in text


def test_a_folder_that_is_not_there_is_told_in_a_sentence(tmp_path, monkeypatch, capsys):
    """Nothing is written."""
    assert make(tmp_path / "nowhere", monkeypatch, "pilot", "--participants", "p1") == 78
    assert "nowhere is no folder" in capsys.readouterr().err


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


def test_an_answer_that_cannot_be_is_asked_for_again(tmp_path, monkeypatch, capsys):
    """At once, with what is allowed; no answer is taken for another one."""
    given = ["unassigned", "p1", "h11", "cyton", "ja", "yes", "No", "n", ""]
    answers = iter(given)
    monkeypatch.setattr("builtins.input", lambda text: next(answers))
    monkeypatch.setattr(new_study, "asked", lambda words: True)
    assert make(tmp_path, monkeypatch, "pilot") == 0
    assert [*answers] == []
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in said] == [
        "--participants 'unassigned'", "--sensors 'h11'", "'ja' must be yes or no", "--virtual",
    ]  # fmt: skip
    assert study_file.read(tmp_path / "pilot.yaml", {}).of("sensor_bench") is None


@pytest.mark.parametrize(
    ("name", "said"), [("Pilot 1", "NAME 'Pilot 1' must be"), ("", "NAME is missing"), ("there", "there.yaml is there")]
)
def test_a_name_that_cannot_be_is_told_before_anything_is_asked(tmp_path, monkeypatch, capsys, name, said):
    """Whoever has answered five questions has not answered them in vain."""
    (tmp_path / "there.yaml").write_text("mine")
    monkeypatch.setattr("builtins.input", lambda text: pytest.fail(text))
    monkeypatch.setattr(new_study, "asked", lambda words: True)
    assert make(tmp_path, monkeypatch, name) == 78
    assert said in capsys.readouterr().err


def test_what_it_tells_to_do_next_finds_the_file(tmp_path, monkeypatch, capsys):
    """In a folder of one's own a study is called by its path, in the file too; in compose/studies by its name."""
    folder = tmp_path / "my studies"
    folder.mkdir()
    assert make(folder, monkeypatch, "pilot", "--virtual", *BARE) == 0
    (told,) = re.findall(r"make check STUDY=(.*)", capsys.readouterr().out)
    (written,) = re.findall(r"make check STUDY=(.*?) +what", (folder / "pilot.yaml").read_text())
    for given in (told, written):
        assert study_file.find(*shlex.split(given)) == folder / "pilot.yaml"


def test_a_file_that_cannot_be_written_is_told_in_a_sentence(tmp_path, monkeypatch, capsys):
    """With the reason, and no traceback."""
    (tmp_path / "pilot.yaml").mkdir()
    assert make(tmp_path, monkeypatch, "pilot", "--virtual", "--force") == 78
    assert f"{tmp_path}/pilot.yaml cannot be written: Is a directory" in capsys.readouterr().err


def test_the_command_itself(tmp_path):
    """As `make study` runs it."""
    command = [sys.executable, str(ROOT / "compose" / "new_study.py"), "pilot", "--virtual", "--folder", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "nothing is wrong" in done.stdout


@pytest.mark.parametrize(("task", "status"), [("Prüfung", 0), ("\udcff", 78)])
def test_a_study_is_written_whole_or_not_at_all(tmp_path, task, status):
    """Whatever the language of the terminal; what is no text is refused, and what was there stays."""
    (tmp_path / "pilot.yaml").write_text("mine")
    words = ["pilot", "--folder", str(tmp_path), "--task", task, "--force", "--virtual", *BARE]
    language = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, ROOT / "compose" / "new_study.py", *(os.fsencode(word) for word in words)]
    done = subprocess.run(command, env=os.environ | language, capture_output=True, check=False)
    assert done.returncode == status, done.stderr
    text = (tmp_path / "pilot.yaml").read_text("utf-8")
    assert text == "mine" if status else task in text
    assert b"Traceback" not in done.stderr
