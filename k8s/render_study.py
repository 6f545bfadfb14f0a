"""Writes k8s/NAME for a study: a Kustomize base and the overlays single-node and lab.

    make k8s STUDY=demo        python k8s/render_study.py [STUDY] [--into FOLDER]; without STUDY all that are there

Everything comes from the study file that `make up` reads. Overlays of your own go beside these two; what stands in
`base`, `single-node` and `lab` is written anew each time.
"""

import argparse
import re
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "compose"))

import overlays  # noqa: E402
import study_file  # noqa: E402
import surroundings  # noqa: E402
from several_hosts import host_of  # noqa: E402
from study_file import Service, Study, StudyError  # noqa: E402
from workloads import Manifest, Names, is_ros, namespace_of, pods, volumes, workload  # noqa: E402

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_. -]{0,39}")
"""Of a study whose namespace is called by it."""
MACHINE = re.compile(r"[A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?")
"""Of what a cluster takes as a label of a machine."""
FOLDERS = ("base", "single-node", "lab")
PROMETHEUS_CONFIG = ROOT / "compose" / "prometheus" / "prometheus.yml"

Files = dict[str, list[Manifest]]


def files(study: Study, tag: str) -> Files:
    """Return the manifests of every file by its path below the study's folder. Raises StudyError."""
    if not NAME.fullmatch(study.name):
        text = "must be letters, digits, '.', _ and - in a cluster, 40 at most"
        raise StudyError(f"{study.file}: x-study.name: {study.name!r} {text}")
    _check_machines(study)
    names = Names(in_a_cluster(study.name), tag)
    running = list(pods(study))
    base = _base(names, running)
    found = {f"base/{name}.yaml": manifests for name, manifests in base.items()}
    found["base/kustomization.yaml"] = [overlays.kustomization([f"{name}.yaml" for name in base])]
    claims = list(base["volumes"])
    return found | overlays.single_node(names, claims) | overlays.lab(_places(study, running))


def _check_machines(study: Study) -> None:
    """Raise StudyError where no label can have a machine's name, or two machines have each a volume of one name."""
    for name in study.hosts:
        if not MACHINE.fullmatch(name):
            text = "must end with a letter or digit in a cluster, 63 signs at most"
            raise StudyError(f"{study.file}: x-study.hosts: {name!r} {text}")
    if study.hosts:
        _check_volumes(study)


def _check_volumes(study: Study) -> None:
    """In a cluster volumes of one name are one, which one machine mounts at a time."""
    first: dict[str, Service] = {}
    for service in study.services:
        for volume in sorted(volumes(service)):
            other = first.setdefault(volume, service)
            here, there = host_of(study, service), host_of(study, other)
            if here != there:
                text = f"{volume} is on {here}, that of {other.name} on {there}; in a cluster they are one: rename one"
                raise StudyError(f"{study.file}: services.{service.name}.volumes: {text}")


def in_a_cluster(name: str) -> str:
    """Return what a cluster calls the study of this name; several names can come to the same."""
    return re.sub(r"[^a-z0-9-]+", "-", name.lower()).strip("-")


def _base(names: Names, running: list[tuple[Service, list[Service]]]) -> Files:
    used = list(dict.fromkeys([names.namespace, *(namespace_of(names, beside) for _, beside in running)]))
    peers = [(namespace_of(names, beside), service.name) for service, beside in running if is_ros(service)]
    own = {service.name: workload(names, service, beside) for service, beside in running}
    scraping = surroundings.scraping(names, PROMETHEUS_CONFIG.read_text(), used)
    graph = [surroundings.graph(names, namespace, peers) for namespace in used]
    return {
        "namespaces": surroundings.namespaces(names, radio=len(used) > 1),
        "graph": [*graph, *map(surroundings.metrics_service, used), *([scraping] if "prometheus" in own else [])],
        "policies": [policy for namespace in used for policy in surroundings.policies(names, namespace)],
        "volumes": [surroundings.claim(name, namespace) for namespace, name in _claimed(own)],
        **own,
    }


def _claimed(own: Mapping[str, list[Manifest]]) -> list[tuple[str, str]]:
    """Namespace and name of every claim that a pod names."""
    found = set()
    for deployment in (manifests[0] for manifests in own.values()):
        for volume in deployment["spec"]["template"]["spec"]["volumes"]:
            if "persistentVolumeClaim" in volume:
                found.add((deployment["metadata"]["namespace"], volume["name"]))
    return sorted(found)


def _places(study: Study, running: list[tuple[Service, list[Service]]]) -> dict[str, list[str]]:
    """Which services run on which machine of a lab, by the label of that machine.

    Of a study on several, on those that it names; clock-sync, which Compose runs on all of them, anywhere. Else at the
    machine with the radio, which is every driver and whoever shares a volume with one, and at the one that keeps the
    recordings.
    """
    if study.hosts:
        return {
            host: [service.name for service, _ in running if host_of(study, service) == host] for host in study.hosts
        }
    drivers = [service for service, _ in running if service.sensor_id]
    shared = {name for driver in drivers for name in volumes(driver)}
    return {
        "radio": [service.name for service, _ in running if service in drivers or volumes(service) & shared],
        "recordings": [service.name for service, _ in running if "recordings" in volumes(service)],
    }


def text(manifests: list[Manifest], study: str) -> str:
    head = (
        f"# Written by `make k8s STUDY={study}`: change the study file, or an overlay of your own beside this folder.\n"
    )
    return head + yaml.dump_all(manifests, Dumper=_Plain, sort_keys=False, width=120, allow_unicode=True)


class _Plain(yaml.SafeDumper):
    """Without anchors, and texts of several lines as blocks."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _block(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style="|" if "\n" in value else None)


_Plain.add_representer(str, _block)


def texts(name: str) -> dict[str, str]:
    """Return the text of every file of a study, by its path below the study's folder. Raises StudyError."""
    study = study_file.read(study_file.find(name), {})
    tag = (ROOT / "VERSION").read_text().strip()
    return {path: text(manifests, name) for path, manifests in files(study, tag).items()}


def write(name: str, folder: Path) -> None:
    """Write the study's base and overlays into a folder, in place of what was there."""
    found = texts(name)
    for each in FOLDERS:
        shutil.rmtree(folder / each, ignore_errors=True)
        (folder / each).mkdir(parents=True)
    for path, content in found.items():
        (folder / path).write_text(content)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="?", help="name of a study in compose/studies, or the path of its file")
    parser.add_argument("--into", type=Path, help="folder to write; k8s/STUDY unless given")
    options = parser.parse_args()
    there = sorted(folder.parent.name for folder in (ROOT / "k8s").glob("*/base"))
    for study in [options.study] if options.study else there:
        folder = options.into or ROOT / "k8s" / Path(study).stem
        try:
            write(study, folder)
        except StudyError as error:
            sys.exit(str(error))
        print(f"{folder}: written; k8s/up.sh {folder}/single-node")
        name = study_file.read(study_file.find(study), {}).name
        if (own := in_a_cluster(name)) != name:
            print(f"its namespace is sense4hri-{own}, as that of a study {own!r}: no cluster can have both")


if __name__ == "__main__":
    main()
