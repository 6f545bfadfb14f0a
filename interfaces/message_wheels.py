"""Builds every message package under interfaces/ into a wheel, each only where its content changed since the last time.

    python interfaces/message_wheels.py PYTHON

PYTHON is the interpreter of the environment the wheels are for; the environment must hold uv. Prints the path of each
wheel, one per line, dependencies first. A package whose released version is already present in that environment is
skipped. Standard library only.

A wheel lies in build/wheels/<package>-<key>/, where the key is a hash of the package's files, of the locked build
requirements, of the interpreter and of the keys of the packages it depends on.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

INTERFACES = Path(__file__).resolve().parent
BUILD = Path(os.environ.get("SENSE4HRI_BUILD", INTERFACES.parent / "build"))
LOCK = INTERFACES / "build-requirements.lock"
PLAIN = INTERFACES / "plain_package.cmake"
METHOD = 1  # raise it when this script comes to build a package differently
ALWAYS_OURS = "sense4hri_msgs"
GROUP = "rosidl_interface_packages"
DEPENDENCY_TAGS = ("depend", "build_depend", "build_export_depend", "exec_depend")

# Tells where packages come from in the environment the wheels are for: ours are installed from a file of build/wheels.
FOREIGN = """
import importlib.metadata, importlib.util, json, sys
def ours(name):
    try:
        return "/wheels/" in (importlib.metadata.distribution(name).read_text("direct_url.json") or "")
    except importlib.metadata.PackageNotFoundError:
        return False
print(json.dumps([n for n in sys.argv[1:] if importlib.util.find_spec(n) and not ours(n)]))
"""


class MessagePackage(NamedTuple):
    """A ROS interface package: its folder, and which of the other packages here it depends on."""

    name: str
    version: str
    description: str
    folder: Path
    depends: frozenset[str]


def read_package(folder: Path) -> MessagePackage | None:
    """The interface package in this folder; None where it is no interface package."""
    root = ElementTree.parse(folder / "package.xml").getroot()
    if GROUP not in [group.text for group in root.iter("member_of_group")]:
        return None
    depends = frozenset(str(element.text).strip() for tag in DEPENDENCY_TAGS for element in root.iter(tag))
    return MessagePackage(
        root.findtext("name", "").strip(),
        root.findtext("version", "").strip(),
        " ".join(root.findtext("description", "").split()),
        folder,
        depends,
    )


def find_packages() -> list[MessagePackage]:
    """Every interface package in interfaces/ and interfaces/extra/, dependencies first."""
    folders = sorted([*INTERFACES.glob("*/package.xml"), *INTERFACES.glob("extra/*/package.xml")])
    found = {package.name: package for path in folders if (package := read_package(path.parent)) is not None}
    order = TopologicalSorter({name: package.depends & found.keys() for name, package in found.items()})
    return [found[name] for name in order.static_order()]


def present_elsewhere(python: str, packages: list[MessagePackage]) -> set[str]:
    """Names of those packages that the environment already has from another source than this script."""
    names = [package.name for package in packages if package.name != ALWAYS_OURS]
    return set(json.loads(subprocess.check_output([python, "-c", FOREIGN, *names], text=True)))


def files_of(package: MessagePackage) -> list[Path]:
    """The files that make up the package, in a fixed order."""
    return sorted(path for path in package.folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)


def is_plain(package: MessagePackage) -> bool:
    """True for a ROS package that knows nothing of wheels."""
    return not (package.folder / "pyproject.toml").exists()


def key_of(package: MessagePackage, interpreter: str, keys: dict[str, str]) -> str:
    """Twelve hexadecimal digits that change whenever the wheel would."""
    digest = hashlib.sha256(f"{METHOD} {interpreter}".encode())
    for source in (LOCK, PLAIN) if is_plain(package) else (LOCK,):
        digest.update(source.read_bytes())
    for path in files_of(package):
        digest.update(str(path.relative_to(package.folder)).encode() + b"\0" + path.read_bytes())
    for name in sorted(package.depends & keys.keys()):
        digest.update(keys[name].encode())
    return digest.hexdigest()[:12]


def build_environment(python: str, dependencies: list[Path]) -> tuple[Path, Path]:
    """(uv, python) of a new environment with the locked build requirements and these wheels.

    Made anew each time (1 s): ROS wheels carry a second, unlisted distribution each, and what removes that one, such
    as `uv pip sync`, removes the code.
    """
    uv = Path(python).parent / "uv"
    folder = BUILD / "message-env"
    builder = folder / "bin" / "python"
    subprocess.run([uv, "venv", "-q", "--clear", "--python", python, folder], check=True)
    install: list[str | Path] = [uv, "pip", "install", "-q", "--python", builder]
    subprocess.run([*install, "--require-hashes", "-r", LOCK], check=True)
    if dependencies:
        subprocess.run([*install, "--no-deps", *dependencies], check=True)
    return uv, builder


def stage(package: MessagePackage, folder: Path) -> Path:
    """A copy of the package with all a wheel needs: an ordinary ROS package, a robot's say, has no pyproject.toml."""
    copy = folder / package.name
    shutil.copytree(package.folder, copy, ignore=shutil.ignore_patterns("__pycache__"))
    if is_plain(package):
        (copy / "pyproject.toml").write_text(
            "[build-system]\n"
            'requires = ["scikit-build-core"]\n'
            'build-backend = "scikit_build_core.build"\n'
            "[project]\n"
            f"name = {json.dumps(package.name)}\nversion = {json.dumps(package.version)}\n"
            f"description = {json.dumps(package.description)}\n"
            "[tool.scikit-build]\nexperimental = true\n"
            'wheel.install-dir = "/data"\nwheel.packages = []\nwheel.exclude = ["**/*.egg-info/**"]\n'
            'install.strip = true\ncmake.build-type = "Release"\n'
            f"cmake.define.CMAKE_PROJECT_INCLUDE = {json.dumps(str(PLAIN))}\n"
        )
    return copy


def build(package: MessagePackage, uv: Path, builder: Path, target: Path) -> None:
    """Builds the package's wheel into the folder target, which appears only when the wheel is complete."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        out = Path(scratch) / "out"
        options: list[str | Path] = ["--wheel", "--no-build-isolation", "--python", builder, "--out-dir", out]
        environment = os.environ | {"PATH": f"{builder.parent}{os.pathsep}{os.environ['PATH']}"}
        done = subprocess.run(
            [uv, "build", *options, stage(package, Path(scratch))],
            env=environment,
            text=True,
            capture_output=True,
            check=False,
        )
        if done.returncode != 0:
            sys.exit(f"{done.stdout}{done.stderr}\n{package.name}: the wheel could not be built, see above")
        shutil.rmtree(target, ignore_errors=True)
        out.rename(target)


def wheels(python: str) -> list[Path]:
    """The wheels of all packages here for this interpreter, built where they are not there yet."""
    packages = find_packages()
    skipped = present_elsewhere(python, packages)
    interpreter = subprocess.check_output([python, "-VV"], text=True)
    keys: dict[str, str] = {}
    paths: list[Path] = []
    for package in packages:
        if package.name in skipped:
            print(f"{package.name}: the released package is present, used instead", file=sys.stderr)
            continue
        keys[package.name] = key_of(package, interpreter, keys)
        target = BUILD / "wheels" / f"{package.name}-{keys[package.name]}"
        if not target.exists():
            print(f"building the messages of {package.name}", file=sys.stderr, flush=True)
            build(package, *build_environment(python, paths), target)
        paths.extend(target.glob("*.whl"))
    return paths


if __name__ == "__main__":
    print(*wheels(sys.argv[1]), sep="\n")
