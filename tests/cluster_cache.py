"""Where k8s/cluster/build.sh puts what a test cluster needs: outside the clone, so that it is built once."""

import os
from pathlib import Path

CACHE = Path(
    os.environ.get("SENSE4HRI_CLUSTER")
    or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "sense4hri", "kubernetes-1.20.2")
)
KUBECTL = CACHE / "bin" / "kubectl"
