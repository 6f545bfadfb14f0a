"""The two overlays that are written beside a study's base: one machine, and a lab of several. Pure."""

from typing import Any

import yaml
from workloads import Manifest, Names

FOLDER = "/var/lib/sense4hri"
"""Of the one machine; a folder per study and volume, which uid 10001 owns."""


def kustomization(resources: list[str], **more: Any) -> Manifest:
    head = {"apiVersion": "kustomize.config.k8s.io/v1beta1", "kind": "Kustomization"}
    return {**head, "resources": resources, **more}


def single_node(names: Names, claims: list[Manifest]) -> dict[str, list[Manifest]]:
    """Every volume is a folder of the machine."""
    of_no_class = _patch(
        {"kind": "PersistentVolumeClaim"}, {"op": "add", "path": "/spec/storageClassName", "value": ""}
    )
    overlay = kustomization(["../base", "volumes.yaml"], patches=[of_no_class])
    return {
        "single-node/kustomization.yaml": [overlay],
        "single-node/volumes.yaml": [_volume(names, each) for each in claims],
    }


def _volume(names: Names, claim: Manifest) -> Manifest:
    name, namespace = claim["metadata"]["name"], claim["metadata"]["namespace"]
    return {
        "apiVersion": "v1",
        "kind": "PersistentVolume",
        "metadata": {"name": f"{namespace}-{name}"},
        "spec": {
            "capacity": claim["spec"]["resources"]["requests"],
            "accessModes": claim["spec"]["accessModes"],
            "persistentVolumeReclaimPolicy": "Retain",
            "claimRef": {"namespace": namespace, "name": name},
            "hostPath": {"path": f"{FOLDER}/{names.study}/{name}", "type": "Directory"},
        },
    }


def lab(places: dict[str, list[str]]) -> dict[str, list[Manifest]]:
    """Each place is the machine with the label sense4hri.org/PLACE; volumes are of the cluster's default class."""
    patches = [
        _patch(
            {"kind": "Deployment", "name": "|".join(services)},
            {"op": "add", "path": "/spec/template/spec/nodeSelector", "value": {f"sense4hri.org/{place}": "true"}},
        )
        for place, services in places.items()
        if services
    ]
    return {"lab/kustomization.yaml": [kustomization(["../base"], patches=patches)]}


def _patch(target: dict[str, str], operation: dict[str, Any]) -> dict[str, Any]:
    return {"target": target, "patch": yaml.safe_dump([operation], sort_keys=False)}
