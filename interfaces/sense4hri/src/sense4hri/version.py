"""Which software this is: the release, and between releases the commit (`0.2.0+37.g90e5ed1`). Imports no ROS.

`SENSE4HRI_VERSION` where it is set, as in images; else what git says of the checkout this file is in; else the version
with which the package was installed. As a script it prints the version of its checkout.
"""

import os
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def software_version(package: str) -> str:
    """Return the version of an installed package; empty where it is not installed as one."""
    try:
        installed = version(package)
    except PackageNotFoundError:
        return ""
    return os.environ.get("SENSE4HRI_VERSION") or checkout_version(Path(__file__)) or installed


@cache
def checkout_version(inside: Path) -> str:
    """Return the version of the checkout around a file: the release in its file VERSION and, after the commit that
    wrote it, how many commits have followed and the last one's name; empty where there is no checkout or no git."""
    root = next((folder for folder in inside.resolve().parents if (folder / "VERSION").is_file()), None)
    if root is None:
        return ""
    release = (root / "VERSION").read_text().strip()
    written = _git(root, "log", "-1", "--format=%H", "--", "VERSION")
    count = written and _git(root, "rev-list", "--count", f"{written}..HEAD")
    if not count:
        return release
    return release if count == "0" else f"{release}+{count}.g{_git(root, 'rev-parse', '--short=7', 'HEAD')}"


def _git(root: Path, *arguments: str) -> str:
    """Return what git prints; empty where it is missing, slow, or knows no repository here."""
    try:
        done = subprocess.run(["git", "-C", root, *arguments], capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


if __name__ == "__main__":
    print(checkout_version(Path(__file__)))
