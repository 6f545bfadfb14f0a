"""What each container image is made of, as the files say from which it is built: locks, pyproject.toml, Dockerfiles.

Licences come from the metadata of the installed packages (`.venv`), ROS packages' from their package.xml, Debian's and
those that say nothing from licences.toml beside this file, with the place where each was read.
"""

import importlib.machinery
import importlib.metadata
import importlib.util
import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "requirements.lock"
SAID = tomllib.loads((Path(__file__).parent / "licences.toml").read_text())
OURS = "Apache-2.0"
BASE = "base"
_APT = re.compile(r"apt-get install -y --no-install-recommends ([a-z0-9+. -]+?)(?:\s*&&|$)", re.M)
_ELSEWHERE = re.compile(r"sys_platform\s*==\s*'(win32|darwin)'|platform_system\s*==\s*'(Windows|Darwin)'")
_ROS_LICENCE = re.compile(r"<license[^>]*>([^<]+)</license>")
_SPELT = {
    "Apache 2.0": "Apache-2.0",
    "Apache License 2.0": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "BSD License": "BSD-3-Clause",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "zlib License": "Zlib",
}
_SPDX = re.compile(r"[A-Za-z0-9.+-]+(?: (?:AND|OR|WITH) [A-Za-z0-9.+-]+)*")


@dataclass(frozen=True)
class Part:
    """One package in an image. kind: pypi, deb or ours; version: empty where only the image's build finds it."""

    kind: str
    name: str
    version: str
    licence: str


def images() -> list[str]:
    """Every image that `make images` builds."""
    services = [path.parent.name for path in ROOT.glob("services/*/pyproject.toml")]
    others = [path.parent.name for path in ROOT.glob("compose/*/Dockerfile")]
    return [BASE, *sorted(services), *sorted(others)]


def parts(image: str) -> list[Part]:
    """What an image holds beside Debian's own base, in a steady order."""
    if (dockerfile := ROOT / "compose" / image / "Dockerfile").is_file():
        return _debian(_apt(dockerfile.read_text()))
    system = _debian(_apt((ROOT / "interfaces" / "Dockerfile").read_text().rpartition("\nFROM ")[2]))
    python = _locked(_base_wanted(), LOCK)
    ours = [_own("sense4hri"), _own("sense4hri_recording"), _own("sense4hri_msgs")]
    if image != BASE:
        declared = tomllib.loads((ROOT / "services" / image / "pyproject.toml").read_text())
        own_lock = ROOT / "services" / image / "requirements.lock"
        python |= _locked(_wanted(declared), *[lock for lock in (LOCK, own_lock) if lock.exists()])
        system += _debian(declared.get("tool", {}).get("sense4hri", {}).get("apt", []))
        ours.append(_own(declared["project"]["name"]))
    return [*ours, *(Part("pypi", name, version, licence(name)) for name, version in sorted(python.items())), *system]


@cache
def licence(name: str) -> str:
    """Return a Python package's licence as an SPDX expression. Raises LookupError where nobody says it."""
    if name in SAID["pypi"]:
        return str(SAID["pypi"][name]["licence"])
    try:
        found = importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        raise LookupError(f"{name} is not installed: make env, or say its licence in licences.toml") from None
    told = [found.metadata.get("License-Expression"), *_ros(found), *_classified(found), found.metadata.get("License")]
    for text in filter(None, told):
        spelt = _SPELT.get(text.strip(), text.strip())
        if _SPDX.fullmatch(spelt):
            return spelt
    raise LookupError(f"{name} does not say its licence: read it, and say it in interfaces/bill/licences.toml")


def _ros(found: importlib.metadata.Distribution) -> list[str]:
    files = [found.locate_file(file) for file in found.files or [] if file.name == "package.xml"]
    texts = sorted({text for file in files for text in _ROS_LICENCE.findall(Path(str(file)).read_text())})
    return [" AND ".join(_SPELT.get(text, text) for text in texts)] if texts else []


def _classified(found: importlib.metadata.Distribution) -> list[str]:
    classified = found.metadata.get_all("Classifier") or []
    return [text.rpartition("::")[2].strip() for text in classified if text.startswith("License")]


def _locked(wanted: list[str], *locks: Path) -> dict[str, str]:
    """Return name and version of packages and all that they require on Linux, as the locks pin them."""
    entries, requires = _read(*locks)
    names = _installer().closure(wanted, requires)
    return {name: entries[name].split()[0].partition("==")[2] for name in names if not _ELSEWHERE.search(entries[name])}


@cache
def _read(*locks: Path) -> Any:
    return _installer().read_locks(*locks)


def _wanted(declared: dict[str, dict[str, list[str]]]) -> list[str]:
    installer = _installer()
    return list(installer.published([installer.normal(text) for text in declared["project"].get("dependencies", [])]))


def _base_wanted() -> list[str]:
    lines = (ROOT / "interfaces" / "image" / "requirements.txt").read_text().splitlines()
    return [_installer().normal(line) for line in lines if line and not line.startswith("#")]


def _installer() -> ModuleType:
    """What installs a service into its image: it decides what goes in, here as there."""
    if "install_service" not in sys.modules:
        path = str(ROOT / "interfaces" / "image" / "install-service")
        loader = importlib.machinery.SourceFileLoader("install_service", path)
        spec = importlib.util.spec_from_loader("install_service", loader)
        assert spec is not None
        module = importlib.util.module_from_spec(spec)
        loader.exec_module(module)
        sys.modules["install_service"] = module
    return sys.modules["install_service"]


def _apt(dockerfile: str) -> list[str]:
    """Return the Debian packages that a Dockerfile installs. Raises LookupError where they cannot be told."""
    text = re.sub(r"\\\n\s*", " ", dockerfile)
    found = _APT.findall(text)
    if len(found) != text.count("apt-get install"):
        raise LookupError("write `apt-get install -y --no-install-recommends PACKAGES`, then && or the line's end")
    return [name for names in found for name in names.split()]


def _debian(names: list[str]) -> list[Part]:
    for name in names:
        if name not in SAID["deb"]:
            raise LookupError(f"Debian's {name}: read /usr/share/doc/{name}/copyright, and say it in licences.toml")
    return [Part("deb", name, "", str(SAID["deb"][name]["licence"])) for name in names]


def _own(name: str) -> Part:
    return Part("ours", name, _version(), OURS)


@cache
def _version() -> str:
    command = [sys.executable, str(ROOT / "interfaces" / "sense4hri" / "src" / "sense4hri" / "version.py")]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
