"""Study files as compose/study_file.py reads them."""

import functools
import json
import os
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import compose_yaml
import pytest
import study_file
import yaml
from study_file import Study, StudyError

ROOT = Path(__file__).resolve().parents[3]
STUDIES = [*(ROOT / "compose" / "studies").glob("*.yaml"), *(ROOT / "tests").glob("*/*/study.yaml")]
BASE = """
services:
  base:
    command: [python, -m, base]
    environment: {A: from base, B: "${B:-unset}"}
    volumes: [data:/data]
  other:
    extends: base
    x-process: -p port:=${PORT:-7}
"""
HEAD = "x-study: {name: trial}\n"
DRIVER = "python -m driver_x --ros-args -p sensor_id:=x_1"
COMPOSE = shutil.which("docker")


def study(folder: Path, text: str, **environment: str) -> Study:
    """The study of this text, beside a compose file with the services of BASE."""
    (folder / "base.yaml").write_text(BASE)
    (folder / "study.yaml").write_text(text)
    return study_file.read(folder / "study.yaml", environment)


def compose_plugin_answers() -> bool:
    if COMPOSE is None:
        return False
    return subprocess.run([COMPOSE, "compose", "version"], capture_output=True, check=False).returncode == 0


def test_the_demo_study_is_what_its_file_says():
    """Four drivers of two participants, each with its parameters; Prometheus alone runs in a container only."""
    demo = study_file.read(study_file.find("demo"), {})
    assert [sensor.sensor_id for sensor in demo.sensors] == ["h10_1", "verity_1", "h10_2", "verity_2"]
    assert demo.participants == ("p1", "p2")
    assert demo.sensors[1].parameters["streams"] == ["ppg", "accelerometer", "pp_interval"]
    assert demo.sensors[1].parameters["body_location"] == "upper arm"
    assert [service.name for service in demo.only_images] == ["prometheus"]
    assert {sensor.sensor_id for sensor in demo.sensors} == {topic.split("/")[5] for topic in demo.required_streams}


def test_the_virtual_sensors_bus_is_one_socket_for_bench_and_drivers(tmp_path):
    """What two containers share in a volume two processes share in its folder, in parameters and in variables alike."""
    demo = study_file.read(study_file.find("demo"), {})
    socket = f"{tmp_path}/radio/system_bus_socket"
    bench = demo.of("sensor_bench")
    assert bench is not None
    assert f"socket_path:={socket}" in bench.process(tmp_path).command
    buses = {sensor.process(tmp_path).env["DBUS_SYSTEM_BUS_ADDRESS"] for sensor in demo.sensors}
    assert buses == {f"unix:path={socket}"}


def test_a_real_study_uses_the_bus_of_the_machine(tmp_path):
    """A volume that `x-process` places is that folder of this machine; no folder is made for it."""
    polar = study_file.read(study_file.find("polar"), {})
    assert polar.of("sensor_bench") is None
    buses = {sensor.process(tmp_path).env["DBUS_SYSTEM_BUS_ADDRESS"] for sensor in polar.sensors}
    assert buses == {"unix:path=/run/dbus/system_bus_socket"}
    assert "bluez" not in polar.volumes()
    assert [service.name for service in polar.only_images] == ["bluetooth", "prometheus"]


def test_what_a_service_extends_is_kept_unless_it_says_otherwise(tmp_path):
    """Environment and volumes are added to, the command is replaced, variables and their defaults are filled in."""
    text = (
        HEAD + "services: {a: {extends: {file: base.yaml, service: other}, environment: [A=own], volumes: [./in:/in]}}"
    )
    (service,) = study(tmp_path, text, B="given").services
    process = service.process(tmp_path / "volumes")
    assert process.command == [sys.executable, "-m", "base", "-p", "port:=7"]
    assert process.env == {"A": "own", "B": "given"}
    assert service.mounts == {"/data": "data", "/in": str(tmp_path / "in")}
    (again,) = study(tmp_path, text + "\n", PORT="9").services
    assert (again.added, again.environment["B"]) == (("-p", "port:=9"), "unset")


def test_only_whole_paths_are_those_of_a_volume(tmp_path):
    """`/data` is no part of `/database`, of `/my/data` or of `/data.txt`, but of `/data/x` in any text."""
    command = "tool /database /my/data /data.txt file:=/data/x /data"
    text = HEAD + f"services: {{a: {{command: {command}, volumes: [data:/data], working_dir: /data/here}}}}"
    process = study(tmp_path, text).services[0].process(Path("/v"))
    assert process.command == ["tool", "/database", "/my/data", "/data.txt", "file:=/v/data/x", "/v/data"]
    assert process.folder == "/v/data/here"


def test_a_volume_inside_another_one_wins(tmp_path):
    """The innermost mount decides, whatever their order."""
    text = HEAD + "services: {a: {command: tool /data/in/x /data/x, volumes: [outer:/data, inner:/data/in]}}"
    assert study(tmp_path, text).services[0].process(Path("/v")).command == ["tool", "/v/inner/x", "/v/outer/x"]


def test_a_variable_without_a_value_is_passed_on_and_a_dollar_may_be_written(tmp_path):
    """`NAME:` and `- NAME` take the launcher's value, and are absent where it has none; `$$` is a dollar sign."""
    text = HEAD + "services: {a: {environment: {A: , B: , C: 5$$}}, b: {environment: [A, B]}}"
    first, second = study(tmp_path, text, A="given").services
    assert (first.environment, second.environment) == ({"A": "given", "C": "5$"}, {"A": "given"})


def test_participants_are_who_wears_a_sensor_unless_they_are_named(tmp_path):
    """A sensor that nobody wears yet makes no participant of `unassigned`."""
    other = DRIVER.replace("x_1", "x_2")
    services = f"services: {{a: {{command: {DRIVER} -p human_id:=p3}}, b: {{command: {other}}}}}"
    assert study(tmp_path, HEAD + services).participants == ("p3",)
    assert study(tmp_path, "x-study: {name: t, participants: [p9]}\n" + services).participants == ("p9",)


def test_a_parameter_file_in_a_mounted_folder_says_who_the_sensor_is(tmp_path):
    """A driver that is given its ROS parameter file is a sensor of the study too; -p after it wins."""
    (tmp_path / "sensor.yaml").write_text("/**: {ros__parameters: {sensor_id: x_1, human_id: p1, ecg: {unit: uV}}}")
    command = "driver --ros-args --params-file /study/sensor.yaml -p human_id:=p2"
    (sensor,) = study(tmp_path, HEAD + f"services: {{x: {{command: {command}, volumes: [./:/study:ro]}}}}").sensors
    assert dict(sensor.parameters) == {"sensor_id": "x_1", "human_id": "p2", "ecg.unit": "uV"}


@pytest.mark.parametrize(
    ("program", "blocks", "given"),
    [
        ("-m recorder", "{/**: {ros__parameters: {a: 1}}, other: {ros__parameters: {a: 2}}}", {"a": 1}),
        ("-m recorder", "{recorder: {ros__parameters: {a: 1}}, /lab/recorder: {ros__parameters: {a: 2}}}", {"a": 1}),
        ("-m driver_polar", "{/*: {ros__parameters: {a: 1}}, driver_polar: {ros__parameters: {a: 2}}}", {"a": 1}),
        ("theirs.py", "{their_node: {ros__parameters: {a: 2}}}", {"a": 2}),
    ],
)
def test_of_a_parameter_file_the_blocks_of_a_node_count(tmp_path, program, blocks, given):
    """ROS leaves out what names another node; a driver is called by its sensor, so that all name it with a star."""
    (tmp_path / "p.yaml").write_text(blocks)
    command = f"python {program} --ros-args --params-file /study/p.yaml"
    (service,) = study(tmp_path, HEAD + f"services: {{x: {{command: {command}, volumes: [./:/study:ro]}}}}").services
    assert dict(service.parameters) == given


@pytest.mark.parametrize(
    ("blocks", "said"),
    [
        (
            "{recoder: {ros__parameters: {a: 1}}}",
            r"p.yaml is for recoder: ROS gives recorder nothing of it; write /\*\*",
        ),
        ("{/**: {ros__parameters: {a: &one 1, b: *one}}}", r"p.yaml: ROS reads no anchors"),
        ("{/**: {ros__parameters: {a: [1, 2.5]}}}", r"p.yaml: must be values of one type"),
    ],
)
def test_a_parameter_file_that_ros_does_not_read_is_told(tmp_path, blocks, said):
    """The node would end, or run with what it has by itself."""
    (tmp_path / "p.yaml").write_text(blocks)
    command = "python -m recorder --ros-args --params-file /study/p.yaml"
    with pytest.raises(StudyError, match=rf"services.x.command: --params-file: .*{said}"):
        study(tmp_path, HEAD + f"services: {{x: {{command: {command}, volumes: [./:/study:ro]}}}}")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("services: {", r"study.yaml is no YAML: .*line 1"),
        ("services: []", r"study.yaml: services: must be a table"),
        (HEAD + "services: {7: {command: x}}", r"services.7: the name 7 must be a text: put it in quotes"),
        (HEAD + "services: {}\nvolumes: [data]", r"study.yaml: volumes: is \['data'\], must be a table"),
        (HEAD + "services: {}\nx-a: &a [1, *a]", r"study.yaml: an anchor holds itself"),
        (HEAD + "services: {}\n? [a]\n: b", r"study.yaml is no YAML: a key must be a text.*line 3"),
        (HEAD + "services: {a: {image: 5}}", r"services.a.image: is 5, must be a text"),
        (HEAD + "services: {a: {working_dir: [x]}}", r"services.a.working_dir: is \['x'\], must be a text"),
        (HEAD + "services: {a: {profiles: 5}}", r"services.a.profiles: is 5, must be a list"),
        (HEAD + "services: {a: {extends: {file: 5, service: b}}}", r"services.a.extends: is .*'file': 5"),
        (HEAD + "services: {a: {command: 'x ${A:-${B:-c}}'}}", r"services.a.command: .*write \$\{NAME\}"),
        ("services: {a: {command: x}}", r"study.yaml: x-study: must have a name"),
        (HEAD + "services: {a: {command: x}, a: {command: y}}", r"the key 'a' is there twice.*line 2"),
        (
            "x-study: {name: t, partcipants: [p1]}\nservices: {}",
            r"x-study.partcipants: unknown, allowed are name, task",
        ),
        (
            "x-study: {name: t, participants: p1}\nservices: {}",
            r"x-study.participants: is 'p1', must be a list of texts",
        ),
        ("x-study: {name: t, hosts: {../a: b}}\nservices: {}", r"x-study.hosts: '../a' must be letters, digits"),
        ("x-study: {name: 7}\nservices: {}", r"x-study.name: is 7, must be a text"),
        ("x-study: {name: t, participants: [1p]}\nservices: {}", r"x-study.participants: .*1p"),
        ("x-study: {name: t, participants: [p-1]}\nservices: {}", r"x-study.participants: 'p-1' is no human_id"),
        ("x-study: {name: t, required_streams: [a/raw]}\nservices: {}", r"x-study.required_streams: 'a/raw' must be"),
        (HEAD + "services: {a: {extends: {file: none.yaml, service: b}}}", r"none.yaml cannot be read: No such file"),
        (
            HEAD + "services: {a: {extends: {file: base.yaml, service: b}}}",
            r"services.a.extends: base.yaml has no service 'b'",
        ),
        (HEAD + "services: {a: {extends: b}, b: {extends: a}}", r"services.a.extends: it extends itself"),
        (HEAD + "services: {a: {extends: [b]}}", r"services.a.extends: is \['b'\], must be"),
        (HEAD + "services: {a: {comand: x}}", r"services.a.comand: there is no such key; did you mean command"),
        (HEAD + "services: {a: {volume: ['a:/a']}}", r"services.a.volume: there is no such key; did you mean volumes"),
        (HEAD + "include: [a.yaml]\nservices: {}", r"study.yaml: include: is not read outside of containers"),
        (HEAD + "services: {a: {entrypoint: x}}", r"services.a.entrypoint: is not read outside of containers"),
        (HEAD + "services: {a: {command: {b: c}}}", r"services.a.command: is {'b': 'c'}, must be a text or a list"),
        (HEAD + "services: {a: {command: 'x \"y'}}", r"services.a.command: No closing quotation"),
        (HEAD + "services: {a: {command: 'x ${'}}", r"services.a.command: .*write \$\{NAME\}"),
        (
            HEAD + "services: {}\nvolumes: {data: {x-process: data}}",
            r"volumes.data.x-process: is 'data', must begin with /",
        ),
        (HEAD + "services: {a: {volumes: [data]}}", r"services.a.volumes: 'data' must be source:/path"),
        (HEAD + "services: {a: {volumes: ['a b:/c']}}", r"services.a.volumes: 'a b' is neither"),
        (HEAD + "services: {a: {environment: 5}}", r"services.a.environment: is 5, must be a table"),
        (HEAD + "services: {a: {environment: {B: [1]}}}", r"services.a.environment: 'B' is \[1\]: a variable has"),
        (HEAD + "services: {a: {environment: ['=x']}}", r"services.a.environment: '' is 'x': a variable has a name"),
        (HEAD + "services: {a: {command: python -m}}", r"services.a.command: -m must be followed by the name"),
        (HEAD + "services: {a: {command: x --ros-args -p port=5}}", r"services.a.command: port=5 after -p must be"),
        (HEAD + "services: {a: {command: 'x --ros-args -p p:=[1'}}", r"services.a.command: p: '\[1' is no YAML"),
        (
            HEAD + "services: {a: {command: x --ros-args --params-file /no}}",
            r"services.a.command: .*/no cannot be read",
        ),
        (HEAD + f"services: {{a: {{command: {DRIVER}}}, b: {{command: {DRIVER}}}}}", r"services.b.*'x_1' is that of a"),
        (
            HEAD + f"services: {{a: {{command: {DRIVER} -p human_id:=7}}}}",
            r"services.a.command: human_id '7' must match",
        ),
        (
            HEAD + "services: {a: {command: x --ros-args -p sensor_id:=X}}",
            r"services.a.command: sensor_id 'X' must match",
        ),
    ],
)
def test_what_is_wrong_is_named_with_file_and_key(tmp_path, text, said):
    """Every mistake in a study file is one sentence with the file, the key and what is allowed."""
    with pytest.raises(StudyError, match=said) as raised:
        study(tmp_path, text)
    assert "\n" not in str(raised.value)
    assert str(tmp_path) in str(raised.value)


def test_a_study_that_does_not_exist_is_told_those_that_do():
    """An unknown name is answered with the names in compose/studies."""
    with pytest.raises(StudyError, match=r"nosuch: there is no study file .*nosuch.yaml; .* one of .*demo, .*eight"):
        study_file.find("nosuch")


def test_a_path_is_a_study_wherever_it_is(tmp_path, monkeypatch):
    """What ends in .yaml is a path, seen from where one stands."""
    (tmp_path / "mine.yaml").touch()
    monkeypatch.chdir(tmp_path)
    assert study_file.find("mine.yaml") == tmp_path / "mine.yaml"


@pytest.mark.skipif(not compose_plugin_answers(), reason="no docker compose on this machine")
@pytest.mark.parametrize("file", STUDIES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_compose_reads_the_same_in_it(file):
    """`docker compose config` finds the services, commands, variables and volumes that plain processes are made of."""
    command = [str(COMPOSE), "compose", "-f", str(file), "config", "--format", "json"]
    environment = os.environ | {"RECORDINGS": "/somewhere", "ROS_DOMAIN_ID": "5"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)["services"]
    read = study_file.read(file, environment)
    assert {service.name for service in read.services} == set(seen)
    for service in read.services:
        compose = seen[service.name]
        assert list(service.command) == (compose["command"] or []), service.name
        assert dict(service.environment) == compose.get("environment", {}), service.name
        assert dict(service.mounts) == {mount["target"]: mount["source"] for mount in compose.get("volumes", [])}
        assert service.folder == compose.get("working_dir", ""), service.name


TAGGED = """
name: trial
x-study: {name: trial}
services:
  own:
    extends: {file: base.yaml, service: full}
    command: !reset null
    environment: {A: !reset null, C: !override "5"}
    volumes: !override ["./here:/here"]
    ports: !reset []
    image: !override tool
    healthcheck: !reset null
  plain:
    extends: {file: base.yaml, service: full}
    environment: !override [B=own]
    working_dir: !reset null
  gone: !reset null
"""
FULL = """
  full:
    image: x
    command: [python, -m, base]
    environment: {A: from base, B: b, C: c}
    volumes: [/data:/data]
    ports: ["8080:8080"]
    working_dir: /here
    healthcheck: {test: [CMD, "true"]}
"""


def test_the_tags_of_compose_replace_what_is_extended(tmp_path):
    """`!override` takes the place of what would be merged, `!reset` leaves it out, also inside of a key."""
    (tmp_path / "base.yaml").write_text(f"services:{FULL}")
    (tmp_path / "study.yaml").write_text(TAGGED)
    own, plain = study_file.read(tmp_path / "study.yaml", {}).services
    assert (own.image, own.command, own.ports) == ("tool", (), ())
    assert dict(own.environment) == {"B": "b", "C": "5"}
    assert dict(own.mounts) == {"/here": str(tmp_path / "here")}
    assert (plain.command, plain.folder, plain.ports) == (("python", "-m", "base"), "", ("8080:8080",))
    assert dict(plain.environment) == {"B": "own"}


@pytest.mark.skipif(not compose_plugin_answers(), reason="no docker compose on this machine")
def test_compose_reads_its_tags_as_we_do(tmp_path):
    """`docker compose config` of a study with both tags."""
    (tmp_path / "base.yaml").write_text(f"services:{FULL}")
    (tmp_path / "study.yaml").write_text(TAGGED)
    test_compose_reads_the_same_in_it(tmp_path / "study.yaml")


def test_what_is_said_again_is_there_once_and_a_variable_may_be_taken_away(tmp_path):
    """A port of what is extended is the same port; a variable without a value is this machine's, or none."""
    (tmp_path / "full.yaml").write_text(f"services:{FULL}")
    more = "{ports: ['8080:8080', '81:81'], devices: [/dev/a], environment: {A: , B: }, extends: {file: full.yaml, "
    (own,) = study(tmp_path, HEAD + f"services: {{own: {more}service: full}}}}}}", B="mine").services
    assert own.ports == ("8080:8080", "81:81")
    assert dict(own.environment) == {"B": "mine", "C": "c"}


WORDS = """
name: trial
x-study: {name: trial}
services:
  own:
    image: x
    environment: {A: yes, B: On, C: off, D: no, E: true, F: FALSE, G: 12:30, H: 1:30.5, I: =, J: 10}
    ports: [8080:22]
    profiles: [on]
    restart: no
"""


def test_words_without_quotes_are_what_compose_takes_them_for(tmp_path):
    """Only true and false are truth values, in small letters to a program; 12:30 is no number of base 60."""
    (own,) = study(tmp_path, WORDS).on_request
    assert " ".join(own.environment.values()) == "yes On off no true false 12:30 1:30.5 = 10"
    assert (own.ports, own.profiles) == (("8080:22",), ("on",))


@pytest.mark.skipif(not compose_plugin_answers(), reason="no docker compose on this machine")
def test_compose_takes_words_as_we_do(tmp_path):
    """`docker compose config` of the same, in a service that always runs."""
    (tmp_path / "study.yaml").write_text(WORDS.replace("    profiles: [on]\n", ""))
    test_compose_reads_the_same_in_it(tmp_path / "study.yaml")


def test_every_service_of_the_house_says_its_command():
    """In compose.yaml everything runs its package, in words; a driver's are in the study, beside its parameters."""
    house = ROOT / "compose" / "compose.yaml"
    names = study_file.compose_yaml.load(house, {})["services"]
    entries = {name: study_file.compose_yaml.service(house, name, {}) for name in names}
    ours = {name: entry for name, entry in entries.items() if not (ROOT / "compose" / name).is_dir()}
    ours = {name: entry for name, entry in ours.items() if not entry["profiles"]}
    drivers = {name: entry["command"] for name, entry in ours.items() if name.partition("-")[0] == "driver"}
    assert not any(drivers.values())
    for name in ours.keys() - drivers.keys():
        assert ours[name]["command"][:3] == ["python", "-m", name.replace("-", "_")]


def test_what_runs_when_asked_is_no_part_of_a_study(tmp_path):
    """A service with `profiles`, its own or of what it extends, is not among those of a study; its neighbour is."""
    house, study = tmp_path / "house.yaml", tmp_path / "study.yaml"
    house.write_text("services: {tool: {profiles: [commands]}, other: {command: x}}")
    study.write_text(
        "x-study: {name: trial}\n"
        "services: {a: {extends: {file: house.yaml, service: tool}}, b: {extends: {file: house.yaml, service: other}}}"
    )
    assert [service.name for service in study_file.read(study, {}).services] == ["b"]


def test_the_launch_file_starts_the_processes_of_the_study(tmp_path, monkeypatch):
    """`ros2 launch compose/study.launch.py` runs, for each service, the very command and environment of `make demo`."""
    started = []

    class Recorded:
        def __init__(self, **given: object) -> None:
            started.append(given)

    launch = SimpleNamespace(LaunchContext=object, LaunchDescription=list)
    actions = SimpleNamespace(
        ExecuteProcess=Recorded,
        LogInfo=type("LogInfo", (), {"__init__": lambda self, msg: None}),
        OpaqueFunction=lambda function: function(None),
        DeclareLaunchArgument=lambda *given, **more: None,
        SetEnvironmentVariable=lambda *given: None,
    )
    given = {"study": "demo", "volumes": str(tmp_path), "host": ""}
    substitutions = SimpleNamespace(
        LaunchConfiguration=lambda name: SimpleNamespace(perform=lambda context: given[name])
    )
    for name, module in {"": launch, ".actions": actions, ".substitutions": substitutions}.items():
        monkeypatch.setitem(sys.modules, f"launch{name}", module)
    runpy.run_path(str(ROOT / "compose" / "study.launch.py"))["generate_launch_description"]()
    demo = study_file.read(study_file.find("demo"))
    expected = {service.name: service.process(tmp_path / "demo") for service in demo.processes}
    assert {each["name"]: (each["cmd"], each["additional_env"], each["cwd"]) for each in started} == {
        name: (process.command, process.env, process.folder) for name, process in expected.items()
    }
    assert (tmp_path / "demo" / "radio").is_dir()


@pytest.mark.parametrize("file", STUDIES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_study_is_back_after_a_reboot(file):
    """Docker starts every service of it again; one that answers no more is ended by its health check, and restarted."""
    for name, entry in started(file).items():
        assert entry["restart"] in ("unless-stopped", "always"), name
        assert "healthcheck" not in entry, name


@functools.cache
def services_of(file: Path) -> dict[str, dict]:
    return yaml.safe_load(file.read_text())["services"]


def started(file: Path) -> dict[str, dict]:
    """The entries of a study's services as they are begun with it, with what they extend."""
    entries = {}
    for name, entry in services_of(file).items():
        where = entry.get("extends")
        if where:
            entry = services_of((file.parent / where["file"]).resolve())[where["service"]] | entry
        if "profiles" not in entry:
            entries[name] = entry
    return entries


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
@pytest.mark.parametrize("target", ["up", "down", "logs", "ps"])
def test_a_study_may_lie_in_a_folder_with_a_space(target):
    """Whatever `make` runs has the path as one word."""
    path = "/home/ana/my study/pilot 1.yaml"
    told = planned(target, f"STUDY={path}", "TLS=lab")
    asked = [line for line in told.splitlines() if " -f " in line]
    assert asked
    assert all(f"-f '{path}'" in line for line in asked)


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
@pytest.mark.parametrize("target", ["demo", "check", "up", "k8s", "down", "study"])
@pytest.mark.parametrize("name", ["it's", "two words", "it's/a study.yaml"])
def test_a_name_reaches_the_command_as_it_was_typed(target, name):
    """A quote of the shell's, or a space, is told by the command and not by the shell."""
    lines = planned(target, f"STUDY={name}", f"NAME={name}", f"HOST={name}").splitlines()
    words = [word for line in lines for word in shlex.split(line)]
    assert {name, f"compose/studies/{name}.yaml"} & {*words}, lines


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
def test_make_up_without_a_host_says_so():
    """What it asks first tells whether the study has several machines."""
    assert "--as containers --study 'trial' --host ''" in planned("up", "STUDY=trial")


def planned(*words: str) -> str:
    """Return the commands that make would run, a line each."""
    command = ["make", "-n", *words, "PYTHON=python3"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return told.replace("\\\n", " ")


def test_a_name_too_long_for_a_file_is_that_of_no_study():
    """A paragraph pasted by mistake is told as any other name."""
    with pytest.raises(StudyError, match="there is no study file"):
        study_file.find("a" * 300)


def test_a_file_that_is_read_again_is_as_it_stands_now(tmp_path):
    """Neither another environment nor another content is answered with what was read before."""
    file = tmp_path / "study.yaml"
    file.write_text("services: {a: {image: '${NAME}'}}")
    images = [compose_yaml.service(file, "a", {"NAME": name})["image"] for name in ("one", "two")]
    file.write_text("services: {a: {image: 'no ${NAME}'}}")
    images.append(compose_yaml.service(file, "a", {"NAME": "two"})["image"])
    assert images == ["one", "two", "no two"]
