"""`k8s/up.sh` says what is missing before it makes or sends anything."""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
KUBECTL = """#!/bin/sh
case "$1" in
    version) echo "connection refused" >&2; exit 1 ;;
    kustomize) echo "  namespace: sense4hri-nobody" ;;
    *) echo "sent" ;;
esac
"""
"""One that knows no cluster."""


def brought_up(overlay: Path, tmp_path: Path) -> subprocess.CompletedProcess[str]:
    """What `k8s/up.sh` does with an overlay, no cluster there."""
    (tmp_path / "kubectl").write_text(KUBECTL)
    (tmp_path / "kubectl").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = [ROOT / "k8s" / "up.sh", overlay]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_cluster_that_is_not_there_is_told(tmp_path: Path) -> None:
    """In a sentence, not as the page's port that refuses; no tokens are made."""
    overlay = tmp_path / "nobody" / "single-node"
    overlay.mkdir(parents=True)
    (overlay / "kustomization.yaml").touch()
    done = brought_up(overlay, tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("kubectl reaches no cluster: connection refused\nkubectl config get-contexts ")
    assert not (ROOT / "compose" / ".tokens" / "nobody").exists()


def test_an_overlay_that_is_not_there_is_told(tmp_path: Path) -> None:
    """With the command that writes it."""
    done = brought_up(tmp_path / "nobody" / "single-node", tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith("nobody/single-node is no overlay: make k8s STUDY=nobody writes it\n")
    assert not (ROOT / "compose" / ".tokens" / "nobody").exists()
