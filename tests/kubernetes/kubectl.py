"""The kubectl of the test cluster's cache (k8s/cluster/build.sh)."""

import subprocess
from pathlib import Path
from typing import Any

import yaml
from cluster_cache import KUBECTL

ROOT = Path(__file__).resolve().parents[2]


def rendered(folder: Path) -> list[dict[str, Any]]:
    """The manifests of an overlay, as `kubectl apply -k` would send them."""
    done = subprocess.run([KUBECTL, "kustomize", folder], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return list(yaml.safe_load_all(done.stdout))
