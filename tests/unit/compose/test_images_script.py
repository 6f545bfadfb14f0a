"""`compose/images.sh` stops at what went wrong, with its words."""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
DOCKER = """#!/bin/sh
case "$1 $2" in
    "buildx version" | "version "*) ;;
    "import -") cat >/dev/null; echo "no space left on device" >&2; exit 1 ;;
    *) exit 1 ;;
esac
"""
"""An Engine without a base image, a registry and room on its disk."""
DEBOOTSTRAP = """#!/bin/sh
mkdir -p "$3/var/cache/apt/archives" "$3/var/lib/apt/lists"
"""


def test_a_base_image_that_cannot_be_made_is_told_where_it_failed(tmp_path: Path) -> None:
    """Not as the failure of the first image that is built on it."""
    for name, text in (("docker", DOCKER), ("debootstrap", DEBOOTSTRAP), ("id", "#!/bin/sh\necho 0\n")):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = [ROOT / "compose" / "images.sh", "recorder"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "no space left on device" in done.stderr
    assert "images: debian:bookworm-slim from Debian's packages failed, see above" in done.stderr
