"""What `kubectl apply -k` would send for the studies in k8s/: of the schemas' form, and whole."""

import copy
import functools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import render_study
from kubectl import ROOT, rendered
from policy import faults
from study_file import StudyError

STUDIES = [folder.parent.name for folder in sorted((ROOT / "k8s").glob("*/base"))]
ROW = re.compile(r"^\| \[`([\w-]+)`\]", re.MULTILINE)
READY = sorted(ROW.findall((ROOT / "compose" / "studies" / "README.md").read_text()))
"""The table's, for beside them lie those that somebody wrote for themselves, with devices that reach no pod."""
OF_THIS_MACHINE = {"file": "recording-1", "nine-modalities": "amplifier-1", "serial": "board-1"}
"""Ready studies that no cluster can run, and whose files are in a folder of the machine."""
ON_THE_NETWORK = {"lsl": "eeg-1", "pupil-labs": "core-1"}
"""Ready studies that no cluster can run, and whose devices are on the network, where no policy lets a pod go."""
TWO_NETWORKS = ROOT / "tests" / "containers" / "two_networks.yaml"
OVERLAYS = ("single-node", "lab")
OLDEST, NEWEST = "1.30", "1.37"

Manifest = dict[str, Any]


@pytest.fixture(scope="module")
def demo() -> list[Manifest]:
    return rendered(ROOT / "k8s" / "demo" / "single-node")


@pytest.fixture(scope="module")
def polar() -> list[Manifest]:
    return rendered(ROOT / "k8s" / "polar" / "lab")


@functools.cache
def fault_of_form(text: str, version: str) -> str:
    """What the schemas of a version say of one manifest, its first fault; "" where they say nothing."""
    manifest = json.loads(text)
    try:
        kubernetes_validate.validate(manifest, version, strict=True)
    except kubernetes_validate.ValidationError as error:
        return f"{manifest['kind']} {manifest['metadata']['name']}: {error.message}"
    return ""


def faults_of(folder: Path, study: str) -> list[str]:
    """What the oldest and the newest schemas, and our own rules, say of an overlay.

    A service's manifests are the same in every study but for its name; what the schemas say of them is asked once.
    """
    manifests = rendered(folder)
    alike = [json.loads(json.dumps(each).replace(f"sense4hri-{study}", "sense4hri-study")) for each in manifests]
    return [*misshapen(alike, OLDEST), *misshapen(alike, NEWEST), *faults(manifests)]


def misshapen(manifests: list[Manifest], version: str) -> list[str]:
    return [fault for each in manifests if (fault := fault_of_form(json.dumps(each), version))]


@pytest.mark.parametrize("overlay", OVERLAYS)
@pytest.mark.parametrize("study", STUDIES)
def test_overlays_are_valid_and_whole(study, overlay):
    """Both overlays of every study hold to the schemas of the oldest and the newest version, and to our own rules."""
    assert faults_of(ROOT / "k8s" / study / overlay, study) == []


@pytest.mark.parametrize("study", sorted({*READY} - {*STUDIES} - {*OF_THIS_MACHINE} - {*ON_THE_NETWORK}))
def test_every_ready_study_can_be_rendered_for_a_cluster(tmp_path, study):
    """What `make k8s STUDY=...` writes of those that are not committed is valid and whole as well."""
    render_study.write(study, tmp_path)
    assert [fault for overlay in OVERLAYS for fault in faults_of(tmp_path / overlay, study)] == []


def test_a_study_on_several_machines_can_be_rendered_for_a_cluster(tmp_path):
    """Its overlays are valid and whole; in a lab each pod is on a machine that the study names, but clock-sync."""
    render_study.write(str(TWO_NETWORKS), tmp_path)
    assert [fault for overlay in OVERLAYS for fault in faults_of(tmp_path / overlay, "two-networks")] == []
    selected = selectors(rendered(tmp_path / "lab"))
    assert selected.pop("clock-sync") == {}
    at_radio = {name for name, labels in selected.items() if labels == {"sense4hri.org/lab-b": "true"}}
    assert at_radio == {"h10-1", "h10-2", "sensor-bench"}
    assert all(selected[name] == {"sense4hri.org/lab-a": "true"} for name in selected.keys() - at_radio)


@pytest.mark.parametrize("study", OF_THIS_MACHINE)
def test_files_of_this_machine_reach_no_pod(tmp_path, study):
    """A study whose files are in a folder here is refused at that service, also where it shares a volume."""
    named = rf"services\.{OF_THIS_MACHINE[study]}\.volumes: .* is of this machine; a pod has none of it"
    with pytest.raises(StudyError, match=named):
        render_study.write(study, tmp_path)


@pytest.mark.parametrize("study", ON_THE_NETWORK)
def test_devices_on_the_network_reach_no_pod(tmp_path, study):
    """A study whose devices are behind ports that no Service and no policy has is refused at the first of them."""
    with pytest.raises(StudyError, match=rf"services\.{ON_THE_NETWORK[study]}\.command: no pod reaches a device"):
        render_study.write(study, tmp_path)


def selectors(manifests: list[Manifest]) -> dict[str, dict[str, str]]:
    """The labels of its machine that each Deployment asks for."""
    deployed = [each for each in manifests if each["kind"] == "Deployment"]
    return {each["metadata"]["name"]: each["spec"]["template"]["spec"].get("nodeSelector", {}) for each in deployed}


def test_drivers_of_real_sensors_are_pinned_to_the_radio(polar):
    """In a lab the drivers run where the label says that the radio is, and what reads recordings where those are."""
    places = selectors(polar)
    assert {name for name, labels in places.items() if "sense4hri.org/radio" in labels} == {"h10-1", "verity-1"}
    at_recordings = {name for name, labels in places.items() if "sense4hri.org/recordings" in labels}
    assert at_recordings == {"recorder", "web-gui"}


def test_only_the_proxy_sees_the_machines_bus(polar):
    """The namespace of the study is restricted; in the one beside it the driver sees the proxy's bus alone."""
    apart = [each for each in polar if each["metadata"].get("namespace") == "sense4hri-polar-radio"]
    drivers = [each["spec"]["template"]["spec"] for each in apart if each["kind"] == "Deployment"]
    for pod in drivers:
        seen = [{mount["name"] for mount in container["volumeMounts"]} for container in pod["containers"]]
        assert ["machine-run-dbus" in names for names in seen] == [False, True]
    assert len(drivers) == 2


def first(manifests: list[Manifest], kind: str, name: str) -> Manifest:
    return next(each for each in manifests if (each["kind"], each["metadata"]["name"]) == (kind, name))


def pod(manifests: list[Manifest], name: str) -> Manifest:
    return first(manifests, "Deployment", name)["spec"]["template"]["spec"]


def container(manifests: list[Manifest], name: str) -> Manifest:
    return pod(manifests, name)["containers"][0]


def volume(manifests: list[Manifest], service: str, name: str) -> Manifest:
    return next(each for each in pod(manifests, service)["volumes"] if each["name"] == name)


def without(manifests: list[Manifest], kind: str, name: str) -> None:
    manifests.remove(first(manifests, kind, name))


PLANTED: dict[str, tuple[Callable[[list[Manifest]], Any], str]] = {
    "selector": (
        lambda m: first(m, "Deployment", "recorder")["spec"]["selector"]["matchLabels"].update(x="y"),
        "Deployment recorder does not select its own pods",
    ),
    "rolling": (
        lambda m: first(m, "Deployment", "recorder")["spec"].pop("strategy"),
        "Deployment recorder may run twice at once",
    ),
    "service": (
        lambda m: first(m, "Service", "recorder")["spec"]["selector"].update(x="y"),
        "Service recorder selects 0 pods",
    ),
    "port": (
        lambda m: first(m, "Service", "recorder")["spec"]["ports"][1].update(targetPort=9465),
        "Service recorder: no container has port 9465",
    ),
    "config": (lambda m: without(m, "ConfigMap", "graph"), "Deployment recorder: there is no ConfigMap graph"),
    "secret": (
        lambda m: volume(m, "recorder", "tokens")["secret"].update(secretName="token"),
        "Deployment recorder: there is no Secret token",
    ),
    "claim": (
        lambda m: without(m, "PersistentVolumeClaim", "recordings"),
        "Deployment recorder: there is no PersistentVolumeClaim recordings",
    ),
    "volume": (
        lambda m: pod(m, "recorder")["volumes"].pop(0),
        "Deployment recorder: of volumes and mounts one is missing: recordings",
    ),
    "peers": (
        lambda m: without(m, "Service", "recorder"),
        "ROS_STATIC_PEERS and the Services differ: recorder.sense4hri-demo.svc",
    ),
    "latest": (
        lambda m: container(m, "recorder").update(image="sense4hri/recorder:latest"),
        "recorder, container recorder: the image sense4hri/recorder:latest has no tag of its own",
    ),
    "limits": (
        lambda m: container(m, "recorder")["resources"].pop("limits"),
        "recorder, container recorder: no limits of memory and CPU",
    ),
    "probe": (
        lambda m: container(m, "recorder").pop("startupProbe"),
        "recorder, container recorder: no startupProbe",
    ),
    "host network": (lambda m: pod(m, "recorder").update(hostNetwork=True), "recorder: hostNetwork"),
    "privileged": (
        lambda m: container(m, "recorder")["securityContext"].update(privileged=True),
        "recorder: recorder may become privileged",
    ),
    "root": (lambda m: pod(m, "recorder")["securityContext"].update(runAsUser=0), "recorder: it may run as root"),
    "machine": (
        lambda m: pod(m, "recorder")["volumes"].append({"name": "all", "hostPath": {"path": "/"}}),
        "recorder: it sees / of its machine",
    ),
    "open": (
        lambda m: without(m, "NetworkPolicy", "nobody"),
        "namespace sense4hri-demo: what no policy allows is not forbidden",
    ),
    "closed": (
        lambda m: without(m, "NetworkPolicy", "graph"),
        "namespace sense4hri-demo: nobody may reach port 7410",
    ),
}


@pytest.mark.parametrize("fault", PLANTED)
def test_a_planted_fault_is_found(demo, fault):
    """Each of these faults, none of which a schema knows, is told in its sentence."""
    plant, sentence = PLANTED[fault]
    manifests = copy.deepcopy(demo)
    plant(manifests)
    assert sentence in faults(manifests)


def test_a_misspelt_key_is_found(demo):
    """The schemas find a key that is none."""
    manifests = [copy.deepcopy(first(demo, "Deployment", "recorder"))]
    probe = container(manifests, "recorder")["readinessProbe"]
    probe["failureTreshold"] = probe.pop("failureThreshold")
    assert len(misshapen(manifests, OLDEST)) == len(misshapen(manifests, NEWEST)) == 1
