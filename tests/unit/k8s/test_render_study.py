"""What `make k8s` writes, against the committed files and against what was measured."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest
import render_study
import workloads
import yaml
from study_file import StudyError

ROOT = Path(__file__).resolve().parents[3]
TAKEN = ("graph", "kustomization", "metrics", "namespaces", "policies", "volumes")
HEAD = "x-study: {name: trial}\nservices:\n"


@pytest.mark.parametrize("study", ["demo", "polar"])
def test_the_committed_files_are_those_of_the_study_file(study):
    """`make k8s` would change no committed file, add none and remove none."""
    folder = ROOT / "k8s" / study
    committed = {
        str(path.relative_to(folder)): path.read_text()
        for part in render_study.FOLDERS
        for path in (folder / part).iterdir()
    }
    assert committed == render_study.texts(study)


def mebibytes(text: str) -> float:
    return float(text.removesuffix("Mi"))


def test_requests_are_above_what_was_measured_and_limits_far_above():
    """A service asks for the memory and CPU that docs/benchmarks.md says of its container; limits are twice that."""
    rows = (ROOT / "docs" / "benchmarks.md").read_text().splitlines()
    (row,) = (row for row in rows if row.startswith("| containers | each of them |"))
    measured = re.findall(r"([\w-]+) (\d+) MB ([\d.]+) %", row)
    assert len(measured) > 10
    for name, megabytes, percent in measured:
        memory, cpu = workloads.MEASURED.get(name, workloads.MEASURED["default"])
        assert mebibytes(memory) * 1.048576 >= float(megabytes), name
        assert float(cpu.removesuffix("m")) >= 10 * float(percent), name
        assert mebibytes(workloads.LIMITS["memory"]) >= 2 * float(megabytes), name


@pytest.mark.parametrize(
    ("service", "sentence"),
    [
        ("{image: x, devices: [/dev/ttyUSB0]}", "services.belt.devices: a device of this machine reaches no pod"),
        ("{image: x, volumes: [./driver:/driver:ro]}", "driver is of this machine; a pod has none of it"),
        ("{image: x, command: python -m driver_pupil_labs}", "services.belt.command: no pod reaches a device on the"),
        ("{image: x, command: python -m driver_lsl}", "services.belt.command: no pod reaches a device on the network"),
        ("{image: x, command: python -m bridge_lsl}", "services.belt.command: no pod reaches a device on the network"),
        ("{image: x, command: y --ros-args -p 'port:=socket://b:1'}", "services.belt.command: no pod reaches a device"),
        ("{image: x, command: y --ros-args -p ip_address:=10.0.0.9}", "services.belt.command: no pod reaches a device"),
        ("{image: x}\n  h10_1: {image: x}", "services.h10_1: must be small letters, digits and - in a cluster"),
        ("{image: x}\n  1-h10: {image: x}", "services.1-h10: must be small letters, digits and - in a cluster"),
        ("{image: x, volumes: ['my_data:/data']}", "volumes.my_data: must be small letters, digits and - in a cluster"),
        *((f"{{image: x}}\n  {name}: {{image: x}}", f"services.{name}: the manifests have {name}") for name in TAKEN),
        ("{image: x, volumes: ['tokens:/data']}", "volumes.tokens: the manifests have tokens of their own"),
        ("{image: x, volumes: ['tmp-belt:/data']}", "volumes.tmp-belt: the manifests have tmp-belt of their own"),
    ],
)
def test_what_no_cluster_can_run_is_refused(tmp_path, service, sentence):
    """What is of this machine or its network, and names that no cluster has, are refused in a sentence with the key."""
    file = tmp_path / "study.yaml"
    file.write_text(f"{HEAD}  belt: {service}\n")
    with pytest.raises(StudyError, match=re.escape(sentence)):
        render_study.texts(str(file))


def container(folder: Path, service: str) -> dict[str, Any]:
    """The container of a service `own` with these keys."""
    (folder / "study.yaml").write_text(f"{HEAD}  own: {service}\n")
    (deployment, *_) = yaml.safe_load_all(render_study.texts(str(folder / "study.yaml"))["base/own.yaml"])
    return deployment["spec"]["template"]["spec"]["containers"][0]


@pytest.mark.parametrize("name", ["Größe", "名前", "a" * 60, "2026"])
def test_a_study_that_a_cluster_cannot_name_is_refused(tmp_path, name):
    """Nothing is cut or left out: two studies would meet in one namespace."""
    (tmp_path / "study.yaml").write_text(f"x-study: {{name: '{name}'}}\nservices: {{}}\n")
    if name == "2026":
        assert "name: sense4hri-2026" in render_study.texts(str(tmp_path / "study.yaml"))["base/namespaces.yaml"]
        return
    with pytest.raises(StudyError, match=r"x-study\.name: .* must be letters, digits"):
        render_study.texts(str(tmp_path / "study.yaml"))


@pytest.mark.parametrize(
    ("image", "named"),
    [("sense4hri/recorder", "sense4hri/recorder:{tag}"), ("busybox", "busybox"), ("lab:5000/belt", "lab:5000/belt")],
)
def test_the_release_is_the_tag_of_the_houses_images_alone(tmp_path, image, named):
    """Somebody else's image has no tag of ours: no machine could fetch it."""
    tag = (ROOT / "VERSION").read_text().strip()
    assert container(tmp_path, f"{{image: '{image}'}}")["image"] == named.format(tag=tag)


def test_of_somebody_elses_program_no_http_is_asked(tmp_path):
    """It may have none, and would be ended every two minutes."""
    own = container(tmp_path, "{image: theirs/belt, environment: {ROS_DOMAIN_ID: 0}}")
    assert not [key for key in own if key.endswith("Probe")]
    assert "livenessProbe" in container(tmp_path, "{image: sense4hri/recorder, command: python -m recorder}")


@pytest.mark.parametrize(
    ("ports", "numbers"),
    [
        ("['127.0.0.1:8090:80', '8091:81/udp']", [(80, "TCP"), (81, "UDP")]),
        ("['8090-8091:80-81']", [(80, "TCP"), (81, "TCP")]),
        ("[{target: 80, published: '8090'}, {target: 81, protocol: udp}]", [(80, "TCP"), (81, "UDP")]),
    ],
)
def test_every_form_of_a_port_is_one_of_the_service(tmp_path, ports, numbers):
    """Each has a name of its own, as a Service wants it."""
    listens = container(tmp_path, f"{{image: x, ports: {ports}}}")["ports"]
    assert [(port["containerPort"], port["protocol"]) for port in listens] == numbers
    assert len({port["name"] for port in listens}) == len(numbers)


@pytest.mark.parametrize(("given", "limit"), [("2g", "2048Mi"), ("512m", "512Mi"), ("1.5GB", "1536Mi"), ("0", "512Mi")])
def test_memory_is_what_the_study_gives(tmp_path, given, limit):
    """A service that a study gives more does not run out of it in the cluster alone."""
    assert container(tmp_path, f"{{image: x, mem_limit: {given}}}")["resources"]["limits"]["memory"] == limit


def test_no_more_memory_is_asked_for_than_the_study_gives(tmp_path):
    """The API server would refuse a pod whose request is above its limit."""
    memory = container(tmp_path, "{image: x, mem_limit: 64m}")["resources"]
    assert (memory["requests"]["memory"], memory["limits"]["memory"]) == ("64Mi", "64Mi")


def test_a_metrics_port_of_the_study_is_that_of_all_pods(tmp_path):
    """Each pod has an address of its own: probes, Services, policies and Prometheus find all of them at one port."""
    given = "{ROS_DOMAIN_ID: 0, METRICS_HOST: 127.0.0.1, METRICS_PORT: 9500}"
    own = container(tmp_path, f"{{image: sense4hri/recorder, command: python -m recorder, environment: {given}}}")
    (graph, *_) = yaml.safe_load_all(render_study.texts(str(tmp_path / "study.yaml"))["base/graph.yaml"])
    listens = graph["data"] | {each["name"]: each.get("value") for each in own["env"]}
    assert listens["METRICS_HOST"] == "0.0.0.0"
    assert int(listens["METRICS_PORT"]) == own["readinessProbe"]["httpGet"]["port"]
    assert int(listens["METRICS_PORT"]) in [port["containerPort"] for port in own["ports"]]


def mounts(folder: Path, volumes: str, more: str = "") -> dict[str, bool]:
    """Whether each volume of a service with these is read-only in its container, by path."""
    own = container(folder, f"{{image: x, volumes: {volumes}{more}}}")
    return {each["mountPath"]: each.get("readOnly", False) for each in own["volumeMounts"] if each["name"] == "data"}


@pytest.mark.parametrize(
    ("entry", "read_only"),
    [
        ("data:/data", False),
        ("data:/data:rw", False),
        ("data:/data:ro", True),
        ("data:/data/:z,ro", True),
        ("{source: data, target: /data, read_only: true}", True),
        ("{source: data, target: /data}", False),
    ],
)
def test_a_volume_that_is_only_read_is_only_read_in_a_pod(tmp_path, entry, read_only):
    """Whoever serves reports cannot spoil recordings in the cluster alone."""
    assert mounts(tmp_path, f"[{entry if entry[0] == '{' else repr(entry)}]") == {"/data": read_only}


def test_a_volume_given_anew_is_written_to_where_what_is_extended_only_reads(tmp_path):
    """The last word on a path is the service's own, as in Compose."""
    (tmp_path / "base.yaml").write_text("services: {b: {image: x, volumes: ['data:/data:ro', 'data:/more:ro']}}\n")
    more = ", extends: {file: base.yaml, service: b}"
    assert mounts(tmp_path, "['data:/data']", more) == {"/data": False, "/more": True}


@pytest.mark.parametrize("key", ["mem_limit: 2g", "deploy: {resources: {limits: {memory: 2g}}}"])
def test_memory_is_what_the_study_gives_in_either_place(tmp_path, key):
    """Compose takes both."""
    assert container(tmp_path, f"{{image: x, {key}}}")["resources"]["limits"]["memory"] == "2048Mi"


@pytest.mark.parametrize(
    ("key", "limit", "request_"),
    [
        ("cpus: 2", "2000m", "50m"),
        ("cpus: '0.02'", "20m", "20m"),
        ("deploy: {resources: {limits: {cpus: '1.5'}}}", "1500m", "50m"),
        ("cpus: 0", "1000m", "50m"),
        ("restart: always", "1000m", "50m"),
    ],
)
def test_cores_are_what_the_study_gives(tmp_path, key, limit, request_):
    """In either place, as memory is; 0 is as much as there is, which a cluster is not asked for."""
    given = container(tmp_path, f"{{image: x, {key}}}")["resources"]
    assert (given["limits"]["cpu"], given["requests"]["cpu"]) == (limit, request_)


@pytest.mark.parametrize(("name", "told"), [("pilot_1", True), ("Pilot 1", True), ("pilot-1", False)])
def test_a_study_whose_namespace_another_name_has_too_is_told(tmp_path, monkeypatch, capsys, name, told):
    """Two studies of a cluster would end each other's pods."""
    (tmp_path / "study.yaml").write_text(f"x-study: {{name: {name}}}\nservices: {{}}\n")
    monkeypatch.setattr(sys, "argv", ["render", str(tmp_path / "study.yaml"), "--into", str(tmp_path / "into")])
    render_study.main()
    said = "its namespace is sense4hri-pilot-1, as that of a study 'pilot-1': no cluster can have both"
    assert (said in capsys.readouterr().out) == told


def test_a_value_that_looks_like_a_variable_of_a_cluster_stays_as_it_is(tmp_path):
    """A cluster puts a variable in place of $(NAME) and one $ in that of two, in words and in values."""
    given = "{image: x, command: [echo, $$(HOME)], environment: {NOTE: 'a $$$$ of $$(HOME)'}}"  # as Compose reads it
    belt = container(tmp_path, given)
    assert belt["args"] == ["echo", "$$(HOME)"]
    assert belt["env"] == [{"name": "NOTE", "value": "a $$$$ of $$(HOME)"}]


def test_prometheus_gets_the_view_token_alone_and_probes_know_it(tmp_path):
    """Of the Secret it sees one key; no manifest has a password, so a command of its image asks whether it is ready."""
    (tmp_path / "study.yaml").write_text(
        f"{HEAD}  prometheus: {{extends: {{file: {ROOT}/compose/compose.yaml, service: prometheus}}}}\n"
    )
    (deployment, _) = yaml.safe_load_all(render_study.texts(str(tmp_path / "study.yaml"))["base/prometheus.yaml"])
    pod = deployment["spec"]["template"]["spec"]
    (secret,) = (each["secret"] for each in pod["volumes"] if "secret" in each)
    assert (secret["secretName"], secret["items"]) == ("tokens", [{"key": "view", "path": "view"}])
    (own,) = pod["containers"]
    assert {"name": "SENSE4HRI_VIEW_TOKEN_FILE", "value": "/run/secrets/view"} in own["env"]
    assert "/run/secrets" in [each["mountPath"] for each in own["volumeMounts"]]
    for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
        assert own[probe]["exec"] == {"command": ["ready", "9090"]}


TWO = "x-study: {name: trial, hosts: {lab-a: 192.0.2.1, lab-b: 192.0.2.2}}\nservices:\n"


def places(folder: Path, services: str) -> dict[str, set[str]]:
    """Where the overlay for a lab puts the Deployments of a study on two machines, by the labels it asks for."""
    (folder / "study.yaml").write_text(TWO + services)
    (lab,) = yaml.safe_load_all(render_study.texts(str(folder / "study.yaml"))["lab/kustomization.yaml"])
    found: dict[str, set[str]] = {}
    for each in lab["patches"]:
        (operation,) = yaml.safe_load(each["patch"])
        (label,) = operation["value"]
        found[label] = set(each["target"]["name"].split("|"))
    return found


def test_in_a_lab_each_service_runs_on_the_machine_that_its_study_names(tmp_path):
    """Who names none is on the first, as in Compose; clock-sync, which Compose runs on all of them, may be anywhere."""
    belt = "  belt: {image: x, x-host: lab-b, command: y --ros-args -p sensor_id:=belt_1}\n"
    clock = "  clock-sync: {image: x, command: python -m clock_sync}\n"
    found = places(tmp_path, f"{belt}{clock}  recorder: {{image: x, volumes: ['recordings:/recordings']}}\n")
    assert found == {"sense4hri.org/lab-b": {"belt"}, "sense4hri.org/lab-a": {"recorder"}}


def test_a_volume_of_two_machines_is_refused(tmp_path):
    """In Compose each has its own of that name; in a cluster it would be one, which one machine mounts at a time."""
    keys = "image: x, volumes: ['radio:/run/x']"
    sentence = "services.belt.volumes: radio is on lab-a, that of bench on lab-b"
    with pytest.raises(StudyError, match=re.escape(sentence)):
        places(tmp_path, f"  bench: {{{keys}, x-host: lab-b}}\n  belt: {{{keys}}}\n")


@pytest.mark.parametrize("name", ["lab-", "a" * 64])
def test_a_machine_that_no_label_can_name_is_refused(tmp_path, name):
    """The overlay for a lab asks for a label of its name."""
    (tmp_path / "study.yaml").write_text(f"x-study: {{name: trial, hosts: {{{name}: 192.0.2.1}}}}\nservices: {{}}\n")
    with pytest.raises(StudyError, match=f"x-study.hosts: '{name}' must end with a letter or digit"):
        render_study.texts(str(tmp_path / "study.yaml"))
