"""`make check`: every kind of mistake in a study is found, with its file and line, before anything starts."""

import contextlib
import os
import shutil
import socket
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import check_study
import pytest
import study_file
from checks import bluetooth, docker, machine
from checks.finding import Finding

ROOT = Path(__file__).resolve().parents[3]
STUDIES = [*(ROOT / "compose" / "studies").glob("*.yaml"), *(ROOT / "tests").glob("*/*/study.yaml")]
HOUSE = ROOT / "compose" / "compose.yaml"
WRITABLE = '{driver_opts: {type: tmpfs, device: tmpfs, o: "uid=10001,mode=755,size=1m"}}'
RIGHT = f"""name: trial
x-study:
  name: trial
  participants: [p1]
  required_streams:
    - /humans/physiological/p1/ecg/h10_1/raw
services:
  h10-1:
    extends: {{file: {HOUSE}, service: driver-polar}}
    volumes: [radio:/run/dbus]
    command: >
      python -m driver_polar --ros-args
      -p sensor_id:=h10_1
      -p human_id:=p1
      -p model:=H10
      -p "name:=Polar H10 1A2B3C01"
  sensor-bench:
    extends: {{file: {HOUSE}, service: sensor-bench}}
  interpreter-ecg:
    extends: {{file: {HOUSE}, service: interpreter-ecg}}
  clock-sync:
    extends: {{file: {HOUSE}, service: clock-sync}}
  recorder:
    extends: {{file: {HOUSE}, service: recorder}}
  session-coordinator:
    extends: {{file: {HOUSE}, service: session-coordinator}}
volumes: {{recordings: , session: , radio: {WRITABLE}}}
"""


def found(tmp_path: Path, text: str, kind: str = "processes", hours: float = 1e-3, **environment: str) -> list[Finding]:
    file = tmp_path / "trial.yaml"
    file.write_text(text)
    return check_study.findings(file, kind, hours, tmp_path / "recordings", environment)


@pytest.mark.parametrize("file", STUDIES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_ready_study_passes(file, tmp_path):
    """Nothing that is wrong in any of them; what is missing on this machine, a radio, is a warning."""
    errors = [each for each in check_study.findings(file, "processes", 0.1, tmp_path) if each.severity == "error"]
    assert errors == []


def test_a_right_study_has_no_findings(tmp_path):
    """The study that the other tests spoil is right before."""
    assert found(tmp_path, RIGHT) == []


MISTAKES = {
    "service: driver-plar}": (
        "service: driver-polar}",
        "compose.yaml has no service 'driver-plar'; did you mean driver-polar?",
    ),
    "    volume: [radio": ("    volumes: [radio", "services.h10-1.volume: there is no such key; did you mean volumes?"),
    "volume: {rec": ("volumes: {rec", "volume: there is no such key in a study file; did you mean volumes?"),
    "  partcipants: [p1]": ("  participants: [p1]", "x-study.partcipants: unknown, allowed are"),
    "participants: [p1, p1]": ("participants: [p1]", "'p1' is there twice"),
    "participants: [p1, p2]": ("participants: [p1]", "'p2' wears none of the study's sensors"),
    "human_id:=p2": ("human_id:=p1", "'p2' is not among the participants of x-study"),
    "human_id:=p__1": ("human_id:=p1", "human_id 'p__1' must match"),
    "human_id:=y": ("human_id:=p1", "parameter 'human_id' is True, must be a string"),
    "-p streams:=[ecg,1.5] -p model:=H10": ("-p model:=H10", "'[ecg,1.5]': must be values of one type"),
    "humanid:=p1": ("human_id:=p1", "driver_polar has no parameter 'humanid'; did you mean human_id?"),
    "ppg/h10_1/raw": ("ecg/h10_1/raw", "comes from no sensor of the study; did you mean /humans/phys"),
    "model:=H11": ("model:=H10", "parameter 'model' is 'H11', must be one of H10, VeritySense, OH1"),
    "-p scan_timeout_s:=900 -p model:=H10": ("-p model:=H10", "'scan_timeout_s' is 900, must be 0.1 to 300 s"),
    "-p ecg.unit:=mV -p model:=H10": ("-p model:=H10", "parameter 'ecg.unit' is 'mV', the driver sends uV"),
    "-p ppg.unit:=counts -p model:=H10": ("-p model:=H10", "driver_polar has no parameter 'ppg.unit'"),
    "-p streams:=[ppg] -p model:=H10": ("-p model:=H10", "streams 'ppg': model H10 has ecg"),
    "      model:=H10": ("      -p model:=H10", "'model:=H10' has no -p before it"),
    "-p sensor_id:=h10_1 --ros-args": ("--ros-args", "'sensor_id:=h10_1' stands before --ros-args"),
    "-m driver_polr": ("-m driver_polar", "there is no service 'driver_polr'; did you mean driver_polar?"),
    "Polar H10 00000000": ("Polar H10 1A2B3C01", "is only an example: put in what is printed on yours"),
    "-p sdk_mode:=true -p model:=H10": ("-p model:=H10", "sdk_mode: model H10 has none"),
    "[radio:/run/dbus, ./no:/no]": ("[radio:/run/dbus]", "/no is not there; it would be /no in"),
    "devices: [/dev/ttyNO7]\n    command: >": ("command: >", "/dev/ttyNO7: no such port"),
    "working_dir: /no\n    command: >": (
        "command: >",
        "services.h10-1.working_dir: '/no' is no folder of this machine",
    ),
    "-p port:=/dev/ttyNO8 -p model:=H10": ("-p model:=H10", "/dev/ttyNO8: no such port"),
    "radio: }": (f"radio: {WRITABLE}}}", "volumes.radio: is root's in a container, where sensor-bench runs as 10001"),
    "sensor-bench: }": ("sensor-bench:", "is no YAML"),
    "[radios:/run/dbus]": ("[radio:/run/dbus]", "volume 'radios' is not declared under `volumes`; did you mean radio?"),
    "file: compos.yaml, service: recorder": (
        f"file: {HOUSE}, service: recorder",
        "services.recorder.extends: compos.yaml cannot be read: No such file",
    ),
    "service: clock-sync}\n    environment: {ROS_DOMAIN_ID: 5}": (
        "service: clock-sync}",
        "services.clock-sync.environment: ROS_DOMAIN_ID is 5, that of the others 0: it hears none of them",
    ),
    "service: clock-sync}\n    environment: {ROS_DOMAIN_ID: 300}": (
        "service: clock-sync}",
        "services.clock-sync.environment: ROS_DOMAIN_ID is 300, that of the others 0",
    ),
    "service: clock-sync}\n    deploy: {replicas: 2}": (
        "service: clock-sync}",
        "services.clock-sync.deploy: replicas is 2, must be 1: write one entry per process",
    ),
    "service: recorder}\n    x-process: -p nothing:=1": (
        "service: recorder}",
        "services.recorder.x-process: recorder has no parameter 'nothing'",
    ),
    "service: recorder}\n    x-process: -p free_floor_mb:=lots": (
        "service: recorder}",
        "services.recorder.x-process: parameter 'free_floor_mb' is 'lots'",
    ),
    "service: recorder}\n    x-process: -p 'free_floor_mb=1'": (
        "service: recorder}",
        "services.recorder.x-process: free_floor_mb=1 after -p must be name:=value",
    ),
    "service: clock-sync}\n    deploy: [1]": ("service: clock-sync}", "clock-sync.deploy: is [1], must be a table"),
    "service: clock-sync}\n    ports: ['99999:80']": ("service: clock-sync}", "port 99999: must be 1 to 65535"),
    "service: clock-sync}\n    ports: ['80:0']": ("service: clock-sync}", "port 0: must be 1 to 65535"),
    "service: clock-sync}\n    ports: ['80-70000:80']": ("service: clock-sync}", "port 70000: must be 1 to 65535"),
    "service: clock-sync}\n    ports: [{target: 80, published: 70001}]": (
        "service: clock-sync}",
        "port 70001: must be",
    ),
    "service: clock-sync}\n    ports: [{published: 80}]": ("service: clock-sync}", "'80:' must be like 8080:80"),
    "service: clock-sync}\n    depends_on: recorder": (
        "service: clock-sync}",
        "services.clock-sync.depends_on: is 'recorder', must be a list or a table",
    ),
    "service: clock-sync}\n    secrets: 5": (
        "service: clock-sync}",
        "services.clock-sync.secrets: is 5, must be a list or a table",
    ),
    "service: clock-sync}\n    depends_on: {1: {}}": ("service: clock-sync}", "there is no service '1' in the study"),
    "recorder: none": (f"recorder:\n    extends: {{file: {HOUSE}, service: recorder}}", "services.recorder: is 'none'"),
    "service: recorder}\n    command: python -m recorder --ros-args -p free_floor_mb:=lots": (
        "service: recorder}",
        "parameter 'free_floor_mb' is 'lots'",
    ),
}
"""What is written, in place of what, and what is said of it."""


@pytest.mark.parametrize("wrong", MISTAKES)
def test_every_mistake_is_named_with_file_and_line(tmp_path, wrong):
    """A study with one mistake has it at its line, and what was meant where that can be guessed."""
    right, said = MISTAKES[wrong]
    assert right in RIGHT
    spoilt = RIGHT.replace(right, wrong, 1)
    matching = [each for each in found(tmp_path, spoilt) if said in each.text]
    assert [each.file.name for each in matching[:1]] == ["trial.yaml"], found(tmp_path, spoilt)
    assert spoilt.splitlines()[matching[0].line - 1] in lines_of(spoilt, wrong), matching


@pytest.mark.parametrize(
    ("driver", "own", "stream", "said"),
    [
        ("driver_bioharness", "port:=/dev/null", "ecg.sampling_frequency_hz:=500", "is 500, the device has 250"),
        ("driver_bioharness", "port:=/dev/null", "ecg.sampling_frequency_hz:=0", "is 0, the device has 250"),
        ("driver_shimmer", "port:=/dev/null", "eda.sampling_frequency_hz:=256", "is 256, the device has 128"),
        ("driver_bioharness", "port:=/dev/null", "ecg.sampling_frequency_hz:=240", None),
        ("driver_polar", "name:=1A2B3C01", "accelerometer.sampling_frequency_hz:=200", None),
        ("driver_vernier", "name:=0K1002A1", "respiration.sampling_frequency_hz:=20", None),
    ],
)
def test_a_rate_that_the_device_does_not_follow_is_an_error(tmp_path, driver, own, stream, said):
    """It would be counted as losses; a driver that asks its device for the rate leaves it to the device."""
    command = f"python -m {driver} --ros-args -p sensor_id:=one_1 -p human_id:=p1 -p {own} -p {stream}"
    text = f"name: trial\nx-study: {{participants: [p1]}}\nservices:\n  one:\n    command: {command}\n"
    rates = [each.text for each in found(tmp_path, text) if "sampling_frequency_hz" in each.text]
    assert [said in each for each in rates] == ([True] if said else []), rates


def lines_of(text: str, part: str) -> list[str]:
    """Return the lines in which a part of a text stands."""
    begin = text.index(part)
    first, last = text.count("\n", 0, begin), text.count("\n", 0, begin + len(part))
    return text.splitlines()[first : last + 1]


def test_a_finding_is_one_line(tmp_path):
    """What a parser says in several lines is one, so that lines can be counted and searched."""
    bench = "    command: >\n      python -m sensor_bench --ros-args -p 'devices:=\"{participants: {p1 {a: 1}}}\"'\n"
    spoilt = RIGHT.replace("  interpreter-ecg:", f"{bench}  interpreter-ecg:", 1)
    texts = [each.text for each in found(tmp_path, spoilt)]
    assert any("devices: not YAML" in text for text in texts), texts
    assert not any("\n" in text for text in texts)


def test_a_port_that_is_none_is_named(tmp_path, monkeypatch):
    """Docker would refuse it, once everything is built."""
    text = RIGHT.replace("    volumes: [radio", "    ports: ['80800:80']\n    volumes: [radio")
    engine = {"images": "", "version": "28", "info": str(tmp_path), "ps": ""}
    monkeypatch.setattr(docker, "_docker", lambda command, *words: engine[command])
    texts = [each.text for each in found(tmp_path, text, "containers", SESSION_PORT="0")]
    assert "services.h10-1.ports: port 80800: must be 1 to 65535" in texts


@pytest.mark.parametrize(
    ("ports", "told"),
    [
        ("['8090:80', '8090:80/udp']", []),
        ("['127.0.0.1:8090:80', '192.168.0.7:8090:80', '[::1]:8090:80']", []),
        ("['8090', {target: 80}]", []),
        ("[{target: 80, published: '8090-8091'}, '8091:81']", ["port 8091 is that of h10-1 already"]),
        ("['8090-8092:80-82', '127.0.0.1:8091:83']", ["port 8091 is that of h10-1 already"]),
    ],
)
def test_a_port_is_taken_on_its_address_and_with_its_protocol(tmp_path, monkeypatch, ports, told):
    """Every form that Compose has for a port is read as Compose reads it."""
    engine = {"images": "", "version": "28", "info": str(tmp_path), "ps": ""}
    monkeypatch.setattr(docker, "_docker", lambda command, *words: engine[command])
    monkeypatch.setattr(docker, "taken", lambda port: False)
    text = RIGHT.replace("    volumes: [radio", f"    ports: {ports}\n    volumes: [radio")
    texts = [each.text for each in found(tmp_path, text, "containers")]
    assert [each for each in texts if "ports" in each] == [f"services.h10-1.ports: {each}" for each in told]


def test_what_compose_does_not_read_is_told_in_its_words(tmp_path, monkeypatch):
    """Where nothing else is wrong Docker Compose has the last word, at the line of what it names."""
    words = "validating trial.yaml: services.clock-sync.user must be a string"
    monkeypatch.setattr(docker, "_docker", lambda command, *more: "" if command == "images" else str(tmp_path))
    monkeypatch.setattr(docker, "_images", lambda study, places: iter(()))
    monkeypatch.setattr(docker, "refusal", lambda file: words)
    text = RIGHT.replace("service: clock-sync}", "service: clock-sync}\n    user: 1000")
    assert [str(each) for each in found(tmp_path, text, "containers")] == [
        f"{tmp_path}/trial.yaml:23: error: services.clock-sync.user: docker compose does not read it: {words}"
    ]


def test_a_compose_that_hangs_is_told(monkeypatch):
    """It is waited for no longer than for an Engine."""
    monkeypatch.setattr(docker, "ANSWER_S", 0.0)
    assert docker.refusal(study_file.find("demo")) == "it did not answer within 0 s"


@pytest.mark.skipif(shutil.which("docker") is None, reason="no docker command on this machine")
@pytest.mark.parametrize(
    ("more", "said"),
    [("restart: 'no'", ""), ("user: 1000", "clock-sync.user must be a string"), ("depends_on: [clock-sync]", "cycle")],
)
def test_compose_is_asked(tmp_path, more, said):
    """Its answer is one sentence, empty where it takes the file."""
    file = tmp_path / "trial.yaml"
    file.write_text(RIGHT.replace("service: clock-sync}", f"service: clock-sync}}\n    {more}"))
    refusal = docker.refusal(file)
    assert said in refusal if said else refusal == ""


def test_of_a_study_on_several_machines_each_is_asked_for_its_own_part(tmp_path):
    """The other machine's serial port is not looked for here; what is wrong with the study itself is told on both."""
    text = RIGHT.replace("  name: trial\n", "  name: trial\n  hosts: {a: 10.0.0.1, b: 10.0.0.2}\n", 1)
    text = text.replace("    command: >", "    x-host: b\n    devices: [/dev/ttyNO7]\n    command: >")
    file = tmp_path / "trial.yaml"
    file.write_text(text.replace("model:=H10", "model:=H11"))
    told = {
        host: [each.text for each in check_study.findings(file, "processes", 1e-3, tmp_path, {}, host)]
        for host in ("a", "b", "c")
    }
    assert {host: any("ttyNO7" in each for each in texts) for host, texts in told.items()} == {
        "a": False,
        "b": True,
        "c": False,
    }
    assert all(any("H11" in each for each in told[host]) for host in "ab")
    assert any("HOST=c is none of its machines" in each for each in told["c"])


@pytest.mark.parametrize("kind", check_study.KINDS)
def test_a_study_on_several_machines_is_not_started_whole_on_one(tmp_path, kind):
    """Who forgets HOST would have each service on every machine; a look at the whole study needs none."""
    text = RIGHT.replace("  name: trial\n", "  name: trial\n  hosts: {a: 10.0.0.1, b: 10.0.0.2}\n", 1)
    (tmp_path / "trial.yaml").write_text(text)
    said = "x-study.hosts: HOST must say which of its machines this is; it names a, b"
    for host, told in (("", [said]), (None, [])):
        found = check_study.findings(tmp_path / "trial.yaml", kind, 1e-3, tmp_path, {}, host)
        assert [each.text for each in found if "HOST" in each.text] == told


def test_the_session_is_conducted_on_one_machine_of_several(tmp_path):
    """A part without the coordinator is whole; a study without one is not."""
    text = RIGHT.replace("  name: trial\n", "  name: trial\n  hosts: {a: 10.0.0.1, b: 10.0.0.2}\n", 1)
    file = tmp_path / "trial.yaml"
    text = text.replace(
        "service: sensor-bench}", "service: sensor-bench}\n    x-host: b"
    )  # its D-Bus, beside the driver
    file.write_text(text.replace("    command: >", "    x-host: b\n    command: >"))
    assert check_study.findings(file, "processes", 1e-3, tmp_path, {}, "b") == []
    file.write_text(text.partition("  session-coordinator:")[0] + f"volumes: {{recordings: , radio: {WRITABLE}}}\n")
    errors = [each.text for each in check_study.findings(file, "processes", 1e-3, tmp_path, {}, "b")]
    assert any("session-coordinator is missing" in each for each in errors), errors


@pytest.mark.parametrize(
    ("hosts", "host", "said"),
    [
        ("{a-b: 10.0.0.1, A_b: 10.0.0.2}", None, "error: x-study.hosts.A_b: 'A_b' and 'a-b' are both a_b on the graph"),
        ("{a: 10.0.0.1, b: 192.168.1.300}", "a", "error: x-study.hosts.b: '192.168.1.300' is no address that is known"),
        ("{a: 10.0.0.1, b: 'http://b'}", "a", "error: x-study.hosts.b: 'http://b' is no address that is known here"),
        ("{a: 10.0.0.1, b: box.invalid}", None, "warning: x-study.hosts.b: 'box.invalid' is no address that is known"),
        ("{a: 10.0.0.1, b: 10.0.0.1}", "a", "warning: x-study.hosts.b: '10.0.0.1' is the address of a already"),
        ("{a: 203.0.113.7, b: 10.0.0.2}", "a", "error: x-study.hosts.a: '203.0.113.7' is no address of this machine"),
        ("{a: 127.0.1.1, b: 10.0.0.2}", "a", "warning: x-study.hosts.a: '127.0.1.1' is reached by this machine alone"),
    ],
)
def test_of_a_study_on_several_machines_the_addresses_are_looked_at(tmp_path, monkeypatch, hosts, host, said):
    """A name that is not found ends every ROS node with a traceback; an address of another machine every service."""
    monkeypatch.setattr(docker, "answers", lambda: False)
    file = tmp_path / "trial.yaml"
    file.write_text(RIGHT.replace("  name: trial\n", f"  name: trial\n  hosts: {hosts}\n", 1))
    told = [str(each) for each in check_study.findings(file, "containers", 1e-3, tmp_path, {}, host)]
    assert [each for each in told if f"trial.yaml:4: {said}" in each], told


def test_what_only_its_driver_knows_is_not_judged(tmp_path):
    """Somebody else's driver may have any parameters and give any stream of its own sensor."""
    text = RIGHT.replace("python -m driver_polar", "python theirs.py -p").replace("ecg/h10_1", "emg/h10_1")
    text = text.replace("theirs.py -p --ros-args", "theirs.py --ros-args -p anything.at_all:=5")
    assert found(tmp_path, text) == []


def test_two_drivers_of_one_device_are_named(tmp_path):
    """They would take each other's link away."""
    second = RIGHT.partition("  h10-1:")[2].partition("  sensor-bench:")[0].replace("h10_1", "h10_2")
    spoilt = RIGHT.replace("  sensor-bench:", f"  h10-2:{second}  sensor-bench:")
    (error,) = found(tmp_path, spoilt)
    assert error.text == "services.h10-2.command: name 'Polar H10 1A2B3C01' is that of h10-1 already"
    assert "name:=" in spoilt.splitlines()[error.line - 1]


def test_several_mistakes_are_told_at_once(tmp_path):
    """All of them, in the order of their lines; one does not hide another."""
    spoilt = RIGHT.replace("model:=H10", "mdel:=H10").replace("participants: [p1]", "participants: [p1, 1p]")
    spoilt = spoilt.replace("service: recorder", "service: recoder")
    lines = [each.line for each in found(tmp_path, spoilt) if each.severity == "error"]
    assert lines == sorted(lines)
    assert len(lines) == 3


def test_a_port_of_the_page_that_is_taken(tmp_path, monkeypatch):
    """Told where a port was asked for; without a wish `make demo` takes the next free one."""
    gui = f"  web-gui:\n    extends: {{file: {HOUSE}, service: web-gui}}\nvolumes:"
    with closing(socket.socket()) as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        (error,) = found(tmp_path, RIGHT.replace("volumes: {", f"{gui} {{"), GUI_PORT=str(port))
        assert f"port {port} is taken on this machine" in error.text
        monkeypatch.setattr(machine, "GUI_PORT", port)
        assert found(tmp_path, RIGHT.replace("volumes: {", f"{gui} {{")) == []


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"GUI_PORT": "abc"}, "parameter 'port' is 'abc'"),
        ({"GUI_PORT": "99999"}, "parameter 'port' is 99999, must be 0 to 65535"),
        ({"ROS_DOMAIN_ID": "²"}, "ROS_DOMAIN_ID is '²', must be 0 to 101"),
    ],
)
def test_a_variable_that_is_no_number_of_its_kind_is_told_in_a_sentence(tmp_path, monkeypatch, variables, said):
    """Whatever is exported in a shell ends no check with a traceback."""
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    gui = f"  web-gui:\n    extends: {{file: {HOUSE}, service: web-gui}}\nvolumes:"
    texts = [each.text for each in found(tmp_path, RIGHT.replace("volumes: {", f"{gui} {{"), **variables)]
    assert [said in text for text in texts] == [True], texts


@pytest.mark.parametrize(("kept", "below"), [("a file", ""), ("a file", "/today"), ("no permission", "")])
def test_a_folder_in_which_nothing_can_be_recorded_is_told(tmp_path, monkeypatch, kept, below):
    """The recorder would say it when all else runs."""
    place = tmp_path / "place"
    place.touch() if kept == "a file" else place.mkdir()
    may = os.access
    monkeypatch.setattr(os, "access", lambda path, *mode: Path(path) != place and may(path, *mode))
    (tmp_path / "trial.yaml").write_text(RIGHT)
    recordings = Path(f"{place}{below}")
    texts = [each.text for each in check_study.findings(tmp_path / "trial.yaml", "processes", 1e-3, recordings, {})]
    assert texts == [f"services.recorder: {place} is no folder that can be written to: nothing can be recorded there"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("/**: {ros__parameters: {name: Größe}}".encode("latin-1"), "is not in UTF-8, line 1: save it as UTF-8"),
        (b"/**: {ros__parameters: [a]}", "ros__parameters is ['a'], must be a table"),
    ],
)
def test_a_parameter_file_that_cannot_be_read_is_told_with_its_key(tmp_path, content, said):
    """Of the service whose command names it."""
    (tmp_path / "own.yaml").write_bytes(content)
    named = f"--params-file {tmp_path}/own.yaml -p sensor_id:=h10_1"
    texts = [each.text for each in found(tmp_path, RIGHT.replace("-p sensor_id:=h10_1", named))]
    (told,) = (text for text in texts if "own.yaml" in text)
    assert told.startswith("services.h10-1.command: --params-file: ")
    assert told.endswith(said)


@pytest.mark.parametrize(
    ("content", "line", "said"),
    [
        (RIGHT.encode("utf-16"), 1, "trial.yaml is in UTF-16, line 1: save it as UTF-8"),
        (RIGHT.encode("utf-16-le"), 1, "trial.yaml has a character that no text has, 0x00, in line 1"),
        (f"{RIGHT}# Größe\n".encode("latin-1"), 28, "trial.yaml is not in UTF-8, line 28: save it as UTF-8"),
        (f"{RIGHT}# \0\n".encode(), 28, "trial.yaml has a character that no text has, 0x00, in line 28"),
    ],
)
def test_a_file_in_another_encoding_is_told_with_the_cause_and_the_line(tmp_path, content, line, said):
    """An editor on another system writes such files."""
    (tmp_path / "trial.yaml").write_bytes(content)
    (told,) = check_study.findings(tmp_path / "trial.yaml", "processes", 1e-3, tmp_path, {})
    assert (told.line, told.text) == (line, f"{tmp_path}/{said}")


@pytest.mark.parametrize(
    ("content", "line", "said"),
    [
        ("services: # Größe\n".encode("latin-1"), 1, "is not in UTF-8, line 1: save it as UTF-8"),
        (
            b"services:\n  own: [\n",
            3,
            "is no YAML: while parsing a flow node expected the node content, but found '<stream end>' in line 3,",
        ),
    ],
)
def test_a_file_that_is_extended_and_cannot_be_read_is_told_with_its_own_line(tmp_path, content, line, said):
    """Whoever looks into the study at that line finds nothing wrong there."""
    (tmp_path / "base.yaml").write_bytes(content)
    text = "name: trial\nx-study: {name: trial}\nservices:\n  own: {extends: {file: base.yaml, service: own}}\n"
    told = next(each for each in found(tmp_path, text) if "base.yaml" in each.text)
    assert (told.file.name, told.line) == ("base.yaml", line)
    assert told.text.startswith(f"{tmp_path}/base.yaml {said}")


@pytest.mark.parametrize(
    ("right", "wrong", "line", "said"),
    [
        ("  name: trial", "  name: ''", 3, "x-study.name: study is empty: name the study"),
        (
            "  name: trial",
            f"  name: trial\n  task: {'t' * 101}",
            4,
            "x-study.task: task has 101 characters, at most 100",
        ),
        ("[p1]", "[p1, unassigned]", 4, "x-study.participants: human_ids: 'unassigned' is no participant"),
        (
            "    - /hum",
            "    - /a b\n    - /hum",
            6,
            "x-study.required_streams: required_streams: '/a b' is no full topic",
        ),
    ],
)
def test_a_session_that_its_coordinator_would_refuse_is_told_before_anything_starts(tmp_path, right, wrong, line, said):
    """`make demo` asks for it once everything runs."""
    told = found(tmp_path, RIGHT.replace(right, wrong, 1))
    assert any(f"trial.yaml:{line}: error: {said}" in str(each) for each in told), told


@pytest.mark.parametrize(
    ("right", "wrong", "keys"),
    [
        ("python -m driver_polar", f"python -m {'d' * 300}", set()),
        (f"{HOUSE}, service: recorder", f"{'f' * 300}.yaml, service: recorder", {"services.recorder.extends"}),
        ("radio:/run/dbus]", f"/{'m' * 300}:/run/dbus]", {"services.h10-1.volumes"}),
        ("    volumes: [", f"    build: {'b' * 300}\n    volumes: [", {"services.h10-1.build"}),
    ],
)
def test_a_name_too_long_for_a_file_ends_no_check(tmp_path, right, wrong, keys):
    """It is told as any other that is not there; of somebody else's program nothing is known."""
    told = found(tmp_path, RIGHT.replace(right, wrong))
    assert keys <= {each.text.partition(":")[0] for each in told}


def test_a_disk_too_small_for_the_planned_time(tmp_path):
    """The longer the study, the more room it needs; for a moment there is enough."""
    (error,) = found(tmp_path, RIGHT, hours=1e9)
    assert "MB are free; 1e+09 h take" in error.text
    assert RIGHT.splitlines()[error.line - 1] == "  recorder:"


def test_sensors_that_are_known_only_once_connected_take_room_too():
    """The files of the nine modalities were measured to take 67 kB a second on the disk."""
    study = study_file.read(ROOT / "compose" / "studies" / "nine-modalities.yaml")
    assert 67_000 < machine.bytes_per_s(study) < 3 * 67_000


def replaying(bag: str = "") -> str:
    """The entry of a study that plays a recording."""
    command = f"    command: python -m replay --ros-args -p bag:={bag}\n" if bag else ""
    return f"  replay:\n    extends: {{file: {HOUSE}, service: replay}}\n{command}"


def test_a_recording_to_be_replayed_must_be_there(tmp_path):
    """A study that replays is told which file is missing."""
    text = (
        f"name: again\nx-study: {{name: again}}\nservices:\n{replaying('/recordings/no/it')}volumes: {{recordings: }}\n"
    )
    (error,) = found(tmp_path, text)
    assert error.text == f"services.replay.command: bag '{tmp_path}/recordings/no/it' is not there: nothing to replay"


def test_beside_a_recording_nobody_says_what_it_says(tmp_path):
    """Who would say a session of their own is told of; alone a replay lacks nothing."""
    (warning,) = found(tmp_path, RIGHT.replace("volumes: {", f"{replaying()}volumes: {{"))
    assert warning.severity == "warning"
    assert warning.text.startswith("services.session-coordinator: says /study/session itself")
    alone = f"name: again\nx-study: {{name: again}}\nservices:\n{replaying()}volumes: {{recordings: }}\n"
    assert found(tmp_path, alone) == []


def test_containers_need_an_engine(tmp_path, monkeypatch):
    """Without one `make up` is told so; everything else is checked all the same."""
    monkeypatch.setattr(docker, "_docker", lambda *words: "")
    (error,) = found(tmp_path, RIGHT, "containers")
    assert "no Docker Engine answers" in error.text


def test_images_and_ports_of_containers(tmp_path, monkeypatch):
    """An image that is not built and a port that somebody else has are errors; a port of this study's own is not."""
    with closing(socket.socket()) as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        text = RIGHT.replace("    volumes: [radio", f"    ports: ['127.0.0.1:{port}:80']\n    volumes: [radio")
        engine = {"images": "sense4hri/recorder:latest", "version": "28", "info": str(tmp_path), "ps": ""}
        monkeypatch.setattr(docker, "_docker", lambda command, *words: engine[command])
        monkeypatch.setenv("SESSION_PORT", "0")
        texts = [each.text for each in found(tmp_path, text, "containers", SESSION_PORT="0")]
        assert f"services.h10-1.ports: port {port} is taken on this machine" in texts
        (told,) = [text for text in texts if "not built" in text]
        assert told.startswith("services: not built yet: sense4hri/driver-polar, ")
        assert not any("recorder" in text for text in texts)
        engine["ps"] = f"127.0.0.1:{port}->80/tcp"
        assert not any("taken" in each.text for each in found(tmp_path, text, "containers", SESSION_PORT="0"))


def test_a_folder_for_recordings_in_which_the_recorder_may_not_write_is_told(tmp_path, monkeypatch):
    """Else the study comes up, and its recorder alone is restarted without end."""
    engine = {"images": "", "version": "28", "info": str(tmp_path), "ps": ""}
    monkeypatch.setattr(docker, "_docker", lambda command, *words: engine[command])
    folder = tmp_path / "kept"

    def told() -> list[str]:
        here = found(tmp_path, RIGHT, "containers", RECORDINGS=str(folder))
        return [each.text for each in here if "install -d -o 10001" in each.text]

    assert told() == [
        f"services.recorder: user 10001 must be able to write in {folder}: install -d -o 10001 -g 10001 {folder}"
    ]
    folder.mkdir(mode=0o755)
    assert len(told()) == 1
    folder.chmod(0o777)
    assert told() == []


def test_what_the_user_in_a_container_may_not_read_is_told(tmp_path, monkeypatch):
    """As after a checkout under umask 077: of a service that always runs, and of one that runs when it is asked for."""
    engine = {"images": "", "version": "28", "info": str(tmp_path), "ps": ""}
    monkeypatch.setattr(docker, "_docker", lambda command, *words: engine[command])
    shown = "  shown:\n    image: shown:1\n    profiles: [shown]\n    volumes: [./panels:/panels:ro]\n"
    text = RIGHT.replace("[radio:/run/dbus]", "[radio:/run/dbus, ./signals:/signals:ro]").replace(
        "volumes: {", shown + "volumes: {"
    )
    for name in ("signals", "panels"):
        (tmp_path / name / "of_p1").mkdir(parents=True)
        (tmp_path / name / "of_p1" / "ecg.csv").touch()
        for path in (tmp_path / name, *(tmp_path / name).rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)

    def told() -> list[str]:
        return [f"{each.severity} {each.text}" for each in found(tmp_path, text, "containers") if "chmod" in each.text]

    assert told() == []
    for service, name in (("h10-1", "signals"), ("shown", "panels")):
        for path, open_to_all in ((tmp_path / name / "of_p1", 0o755), (tmp_path / name / "of_p1" / "ecg.csv", 0o644)):
            path.chmod(open_to_all & 0o700)
            (said,) = told()
            assert said.startswith(f"warning services.{service}.volumes: {path} may be read by its owner alone")
            assert said.endswith(f"chmod -R a+rX {tmp_path / name}")
            path.chmod(open_to_all)


def test_a_bus_that_no_plain_process_makes_is_named(tmp_path):
    """The proxy of containers makes the socket in its volume; a plain process has this machine's where it says so."""
    proxy = f"  bluetooth:\n    extends: {{file: {HOUSE}, service: bluetooth}}\n    volumes: [radio:/run/dbus]\n"
    bench = f"  sensor-bench:\n    extends: {{file: {HOUSE}, service: sensor-bench}}\n"
    text = RIGHT.replace(bench, proxy)
    said = "services.h10-1.volumes: nobody makes a D-Bus in volume radio; give it x-process: /run/dbus"
    (told,) = (each for each in found(tmp_path, text) if each.severity == "error")
    assert (told.text, text.splitlines()[told.line - 1].strip()) == (said, "volumes: [radio:/run/dbus]")
    text = text.replace('mode=755,size=1m"}}', 'mode=755,size=1m"}, x-process: /run/dbus}')
    assert not [each for each in found(tmp_path, text) if each.severity == "error"]


def test_no_bus_means_no_bluetooth(tmp_path):
    """A machine without D-Bus is told so in a sentence, at once."""
    names, wrong = bluetooth.adapters(f"unix:path={tmp_path}/none")
    assert names == []
    assert "no Bluetooth is reached" in wrong


def _about_bluetooth(tmp_path: Path, *commands: str) -> list[str]:
    """What is said of Bluetooth where these sensors, 1 on, are beside the study's own, which is virtual."""
    driver = "    extends: {{file: {house}, service: driver-{kind}}}\n    command: {command}\n"
    entries = ""
    for number, command in enumerate(commands, 1):
        kind = command.partition(" --ros-args")[0].removeprefix("python -m driver_")
        entries += f"  s-{number}:\n" + driver.format(house=HOUSE, kind=kind, command=command)
    told = found(tmp_path, RIGHT.replace("services:\n", f"services:\n{entries}", 1))
    return [each.text for each in told if "adapter " in each.text or "Bluetooth" in each.text]


def test_an_adapter_that_is_missing_is_told_of_the_sensor_that_asks_for_it(tmp_path, monkeypatch):
    """Not of those after it, which take any."""
    monkeypatch.setattr(machine, "adapters", lambda address: (["hci0"], ""))
    polar = "python -m driver_polar --ros-args -p sensor_id:=s_{0} -p human_id:=p1 -p model:=H10 -p name:=H10_{0}"
    told = _about_bluetooth(tmp_path, f"{polar.format(1)} -p adapter:=hci5", polar.format(2))
    assert told == ["services.s-1.command: adapter hci5 is not among hci0"]


@pytest.mark.parametrize("link", ["serial_port:=/dev/ttyUSB0", "ip_address:=192.168.4.1", "board:=SYNTHETIC"])
def test_of_a_board_that_has_no_radio_no_bluetooth_is_asked(tmp_path, monkeypatch, link):
    """BrainFlow's driver has boards of every kind; one with its link elsewhere does not wait for an adapter."""
    monkeypatch.setattr(machine, "adapters", lambda address: ([], "no D-Bus answers, so no Bluetooth is reached"))
    board = "python -m driver_brainflow --ros-args -p sensor_id:=s_{} -p human_id:=p1 -p board:={} -p {}"
    told = _about_bluetooth(tmp_path, board.format(1, "CYTON", link), board.format(2, "MUSE_2", "mac_address:=A"))
    assert told == ["services.s-2.command: no D-Bus answers, so no Bluetooth is reached"]


BLUEZ = """
import asyncio, sys
from dbus_fast.aio import MessageBus
async def main():
    bus = await MessageBus(bus_address=sys.argv[1]).connect()
    await bus.request_name("org.bluez")
    print("here", flush=True)
    await bus.wait_for_disconnect()
asyncio.run(main())
"""
"""A bluetoothd that has the name alone."""


@pytest.mark.skipif(shutil.which("dbus-daemon") is None, reason="no dbus-daemon on this machine")
@pytest.mark.parametrize(
    ("rule", "said"),
    [("", "bluetoothd does not run"), ('<deny send_destination="org.bluez"/>', "D-Bus denies this user BlueZ")],
)
def test_a_bus_without_an_answer_of_bluez_says_why(tmp_path, rule, said):
    """No adapter is told where BlueZ says so alone: not of one that does not run, or that this user may not ask."""
    address = f"unix:path={tmp_path}/bus"
    rules = f'<allow user="*"/><allow own="*"/><allow send_destination="*"/><allow receive_sender="*"/>{rule}'
    (tmp_path / "bus.conf").write_text(
        '<!DOCTYPE busconfig PUBLIC "-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN"'
        ' "http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd">'
        f"<busconfig><type>system</type><listen>{address}</listen><auth>EXTERNAL</auth>"
        f'<policy context="default">{rules}</policy></busconfig>'
    )
    command = ["dbus-daemon", f"--config-file={tmp_path}/bus.conf", "--nofork", "--print-address"]
    with contextlib.ExitStack() as running:
        for words in (command, [sys.executable, "-c", BLUEZ, address] if rule else ["echo"]):
            process = running.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE))
            running.callback(process.terminate)
            assert process.stdout is not None
            process.stdout.readline()  # it is there
        assert said in bluetooth.adapters(address)[1]


@pytest.mark.parametrize(("study", "status", "said"), [("demo", 0, ""), ("trial", 78, "trial"), ("polr", 78, "polr")])
def test_the_command_says_it_with_its_exit_status(tmp_path, study, status, said):
    """0 where nothing is wrong, 78 where something is, with a line that an editor can jump to."""
    if study == "trial":
        (tmp_path / "trial.yaml").write_text(RIGHT.replace("model:=H10", "mdel:=H10"))
        study, said = (
            str(tmp_path / "trial.yaml"),
            f"{tmp_path}/trial.yaml:15: error: services.h10-1.command: driver_polar",
        )
    command = [sys.executable, str(ROOT / "compose" / "check_study.py"), "--as", "processes", "--hours", "0.01"]
    done = subprocess.run(
        [*command, "--study", study, "--recordings", str(tmp_path)],
        capture_output=True, text=True, check=False, env=os.environ | {"ROS_DOMAIN_ID": "3", "GUI_PORT": "0"},
    )  # fmt: skip
    assert done.returncode == status, done.stdout + done.stderr
    assert said in done.stdout + done.stderr


def test_who_plays_no_virtual_sensor_waits_for_no_bluetooth_stack():
    """`make demo` and `make check` load the sensor-bench only for a study that has one: it takes most of a second."""
    probe = "import sys, demo, check_study; sys.exit(sys.modules.keys() & {'sensor_bench', 'bumble'} != set())"
    assert subprocess.run([sys.executable, "-c", probe], check=False, cwd=ROOT / "compose").returncode == 0
