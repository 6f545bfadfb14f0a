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


SLOW = """#!/bin/sh
case "$3" in
    build) [ "$1" -gt 480 ] || exit 124 ;;
    *) shift; exec "$@" ;;
esac
"""
"""`timeout` where a build takes longer than 480 s."""


def images_with(commands: dict[str, str], folder: Path) -> subprocess.CompletedProcess[str]:
    """What `compose/images.sh recorder` does where these commands are others."""
    for name, text in commands.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"}
    command = [ROOT / "compose" / "images.sh", "recorder"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_base_image_that_cannot_be_made_is_told_where_it_failed(tmp_path: Path) -> None:
    """Not as the failure of the first image that is built on it."""
    done = images_with({"docker": DOCKER, "debootstrap": DEBOOTSTRAP, "id": "#!/bin/sh\necho 0\n"}, tmp_path)
    assert done.returncode == 1
    assert "no space left on device" in done.stderr
    assert "images: debian:bookworm-slim from Debian's packages failed, see above" in done.stderr


def test_an_engine_that_refuses_is_told_in_its_own_words(tmp_path: Path) -> None:
    """A user who is not in the group docker has an Engine, and needs none installed."""
    refusing = "#!/bin/sh\ncase $1 in version) echo 'permission denied while trying to connect' >&2; exit 1 ;; esac\n"
    done = images_with({"docker": refusing}, tmp_path)
    assert done.returncode == 1
    assert "No Docker Engine answers: permission denied while trying to connect\n" in done.stderr
    assert "group docker" in done.stderr


def test_what_takes_minutes_is_told_when_it_begins(tmp_path: Path) -> None:
    """Who waits for the first image sees for what."""
    done = images_with({"docker": "#!/bin/sh\n"}, tmp_path)
    assert done.stdout.startswith("images: sense4hri/tools ...\nimages: sense4hri/tools: ")


def test_a_build_on_a_slow_network_is_given_more_time(tmp_path: Path) -> None:
    """It is told each time, for what stalls and what is slow look alike."""
    done = images_with({"docker": "#!/bin/sh\n", "timeout": SLOW}, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "images: sense4hri/recorder did not end within 480 s\nimages: sense4hri/recorder: " in done.stdout
