"""A study of two participants on a real cluster of one machine: refused where wrong, up, hurt.

It is the one that tests/containers/test_two_networks.py brings up on two machines. The tests build on each other.
"""

import json
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import render_study
import study_tokens
import yaml
from cluster_cache import CACHE
from kubectl import rendered
from node import ROOT, Node
from processes import wait_for
from prometheus_client.parser import text_string_to_metric_families
from rosbags.highlevel import AnyReader

pytestmark = [
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not (CACHE / "bin" / "kubelet").exists(), reason="no cluster is built: k8s/cluster/build.sh"),
    pytest.mark.skipif(Path("/sys/fs/cgroup/cgroup.controllers").exists(), reason="Kubernetes 1.20 needs cgroup v1"),
]
DEMO = ROOT / "k8s" / "demo"
STUDY = ROOT / "tests" / "containers" / "two_networks.yaml"
NAMESPACE = "sense4hri-two-networks"
STRAP, UNWORN = "h10-1", "h10-2"
STREAMS = {"p1": "h10_1", "p2": "h10_2"}
FOLDERS = "/var/lib/sense4hri/two-networks"
RECORDINGS = f"{FOLDERS}/recordings"
READY_S = 400.0

Manifest = dict[str, Any]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `make k8s` writes of the study, in a folder of the name that it would have there."""
    folder = tmp_path_factory.mktemp("k8s") / STUDY.stem
    render_study.write(str(STUDY), folder)
    return folder


@pytest.fixture(scope="module")
def overlay(study: Path) -> list[Manifest]:
    return rendered(study / "single-node")


@pytest.fixture(scope="module")
def node(overlay: list[Manifest]) -> Iterator[Node]:
    """A cluster with the images of the study and the folders of its volumes."""
    (ROOT / "build").mkdir(exist_ok=True)
    node = Node(Path(tempfile.mkdtemp(prefix="sense4hri-kubernetes-", dir=ROOT / "build")))
    try:
        node.start()
        images = {c["image"] for each in deployments(overlay) for c in each["spec"]["template"]["spec"]["containers"]}
        node.load(images, next(image for image in sorted(images) if "clock-sync" in image))
        for volume in (each["metadata"]["name"] for each in overlay if each["kind"] == "PersistentVolumeClaim"):
            node.inside("install", "-d", "-o", "10001", "-g", "10001", f"{FOLDERS}/{volume}")
        wait_for(lambda: " Ready" in node.kubectl("get", "nodes").stdout, 90, "the node is ready")
        yield node
    finally:
        node.close()


def deployments(manifests: list[Manifest]) -> list[Manifest]:
    return [each for each in manifests if each["kind"] == "Deployment"]


def pods(node: Node, service: str = "") -> list[Manifest]:
    """The pods that are not on their way out, of one service or of all."""
    chosen = ("--selector", f"app.kubernetes.io/name={service}") if service else ()
    return [each for each in node.get("pods", NAMESPACE, *chosen) if "deletionTimestamp" not in each["metadata"]]


def is_ready(pod: Manifest) -> bool:
    conditions = pod["status"].get("conditions", [])
    return any(each["type"] == "Ready" and each["status"] == "True" for each in conditions)


def values(node: Node, service: str, name: str) -> dict[str, float]:
    """The values of one metric of a service by sensor; empty where it does not answer."""
    families = text_string_to_metric_families(node.ask(NAMESPACE, service, "/metrics"))
    found: dict[str, float] = {}
    for sample in (sample for family in families for sample in family.samples if sample.name == name):
        sensor = sample.labels.get("sensor_id", "")
        found[sensor] = found.get(sensor, 0.0) + sample.value
    return found


def session(node: Node, *words: str) -> bool:
    """Run the command in the coordinator's pod; True where it succeeded."""
    command = ("exec", "deploy/session-coordinator", "--", "sense4hri-session", *words)
    return node.kubectl("--namespace", NAMESPACE, *command, check=False, seconds=150).returncode == 0


BAD = {
    "misspelt key": lambda d: d["spec"]["template"]["spec"]["containers"][0]["readinessProbe"].update(periodSecond=5),
    "selector": lambda d: d["spec"]["selector"]["matchLabels"].update(x="y"),
    "port": lambda d: d["spec"]["template"]["spec"]["containers"][0]["ports"][0].update(containerPort=99999),
    "volume": lambda d: d["spec"]["template"]["spec"]["volumes"].pop(0),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_manifest_is_refused(node, overlay, fault, tmp_path):
    """A real API server refuses a misspelt key, a selector of other pods, a port that is none and a missing volume."""
    wanted = yaml.safe_load(
        json.dumps(next(each for each in deployments(overlay) if each["metadata"]["name"] == STRAP))
    )
    wanted["metadata"]["namespace"] = "default"
    file = tmp_path / "deployment.json"
    file.write_text(json.dumps(wanted))
    assert "created" in node.kubectl("apply", "--dry-run=server", "-f", file).stdout
    BAD[fault](wanted)
    file.write_text(json.dumps(wanted))
    refused = node.kubectl("apply", "--dry-run=server", "-f", file, check=False)
    assert refused.returncode != 0
    assert "created" not in refused.stdout


@pytest.fixture(scope="module")
def demo(node: Node) -> None:
    """The namespace of the demo study, for what is only tried without being stored."""
    node.kubectl("create", "namespace", "sense4hri-demo")


@pytest.mark.parametrize("name", ["single-node", "lab"])
@pytest.mark.usefixtures("demo")
def test_the_overlays_of_the_demo_are_accepted(node, name, tmp_path):
    """A real API server takes every object of both overlays that are committed."""
    items = rendered(DEMO / name)
    file = tmp_path / "demo.json"
    file.write_text(json.dumps({"apiVersion": "v1", "kind": "List", "items": items}))
    accepted = node.kubectl("apply", "--dry-run=server", "-f", file).stdout.splitlines()
    assert len(accepted) == len(items)


def test_the_study_comes_up_without_multicast(node, study, overlay):
    """k8s/up.sh brings the overlay up as it is: every pod is Ready, though no multicast passes between them."""
    up = [ROOT / "k8s" / "up.sh", study / "single-node"]
    done = subprocess.run(up, env=node.with_kubectl(), capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    names = {each["metadata"]["name"] for each in deployments(overlay)}
    assert len(names) == 10

    def all_ready() -> bool:
        found = pods(node)
        return len(found) == len(names) and all(map(is_ready, found))

    wait_for(all_ready, READY_S, "all pods are Ready")
    dropped = node.inside("iptables", "-t", "raw", "-L", "PREROUTING", "-v", "-n", "-x").stdout.splitlines()[2].split()
    assert int(dropped[0]) > 0, "nobody tried multicast: its rule is not where packets pass"


def test_the_overlay_for_a_lab_is_accepted(node, study, tmp_path):
    """The API server accepts the Deployments for a lab as well, which differ in where they run."""
    file = tmp_path / "lab.json"
    file.write_text(json.dumps({"apiVersion": "v1", "kind": "List", "items": deployments(rendered(study / "lab"))}))
    accepted = node.kubectl("apply", "--dry-run=server", "-f", file).stdout.splitlines()
    assert accepted
    assert all("configured" in line or "unchanged" in line for line in accepted)


def test_somebody_puts_the_second_strap_on(node):
    """The registry takes the order of whoever has the token to operate, which up.sh has put into the cluster."""
    own = study_tokens.folder(str(STUDY))
    wish = {"sensor_id": STREAMS["p2"], "human_id": "p2"}

    def assign(role: str) -> int:
        return node.post(NAMESPACE, "metadata-registry", "/assign", wish, (own / role).read_text().strip())

    assert assign("view") == 403
    wait_for(lambda: assign("operate") == 200, 60, "h10_2 is assigned to p2")


def test_a_recording_with_features_is_on_its_volume(node):
    """A session started in the cluster leaves a recording on the claim's volume, with raw data and features of both."""
    humans = [word for human in STREAMS for word in ("--human", human)]
    features = [word for human in STREAMS for word in ("--require", f"/humans/physiological/{human}/ecg/*/features")]
    session(node, "start", "--study", "two-networks", "--session", "cluster", "--allow-warmup", *humans, *features)
    fed = values(node, "interpreter-ecg", "sense4hri_messages_total")

    def went_on() -> bool:
        now = values(node, "interpreter-ecg", "sense4hri_messages_total")
        return all(now.get(strap, 0.0) > fed.get(strap, 0.0) + 10 for strap in STREAMS.values())

    wait_for(went_on, 90, "both straps are heard by the interpreter")
    wait_for(lambda: session(node, "stop"), 60, "the coordinator of a busy machine answers the one who stops")
    parts = sorted({file.parent for file in node.path(f"{RECORDINGS}/two-networks").rglob("*.mcap")})
    with AnyReader(parts) as reader:
        counts = {topic: entry.msgcount for topic, entry in reader.topics.items()}
    for human, sensor in STREAMS.items():
        for field in ("raw", "features"):
            assert counts.get(f"/humans/physiological/{human}/ecg/{sensor}/{field}", 0) > 0, (sensor, field, counts)


def test_a_deleted_pod_comes_back_with_its_data(node):
    """A driver's pod is deleted: another takes its place, with another address, and the interpreter hears it again."""
    (before,) = pods(node, STRAP)
    node.kubectl("--namespace", NAMESPACE, "delete", "pod", before["metadata"]["name"], "--wait=false")
    metric = "sense4hri_samples_total"
    again = wait_for(lambda: [each for each in pods(node, STRAP) if is_ready(each)], 120, "the new pod is Ready")
    assert again[0]["metadata"]["uid"] != before["metadata"]["uid"]
    wait_for(lambda: sum(values(node, STRAP, metric).values()) > 0, 60, "it has samples")
    heard = values(node, "interpreter-ecg", "sense4hri_messages_total").get("h10_1", 0.0)
    more = heard + 5
    wait_for(
        lambda: values(node, "interpreter-ecg", "sense4hri_messages_total").get("h10_1", 0.0) >= more,
        60,
        "the interpreter hears the strap again",
    )


def test_a_wrong_configuration_is_a_crash_loop_with_its_sentence(node):
    """A driver with a parameter that cannot be is not restarted for ever at once, and says which parameter it is."""
    words = [
        {"op": "add", "path": "/spec/template/spec/containers/0/args/-", "value": each} for each in ("-p", "model:=X")
    ]
    deployment = (
        "--namespace",
        NAMESPACE,
        "patch",
        "deployment",
        UNWORN,
        "--type=json",
        f"--patch={json.dumps(words)}",
    )
    node.kubectl(*deployment)

    def waits() -> list[Manifest]:
        states = [each for pod in pods(node, UNWORN) for each in pod["status"].get("containerStatuses", [])]
        return [each for each in states if each["state"].get("waiting", {}).get("reason") == "CrashLoopBackOff"]

    (status,) = wait_for(waits, 300, "the pod is in CrashLoopBackOff")
    ended = status["lastState"]["terminated"]
    assert ended["exitCode"] == 78
    assert "model" in ended["message"]
