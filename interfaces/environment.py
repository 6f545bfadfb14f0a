"""Makes .venv at the repository root: locked packages, message wheels, the kit and every service.

What is up to date is left alone.

    python3 interfaces/environment.py

Standard library only, because it runs before anything is installed.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import message_wheels

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
UV = VENV / "bin" / "uv"
LOCK = ROOT / "requirements.lock"
STAMPS = VENV / "stamps"
MINIMUM = (3, 11)
VERSION = "import sys; print(sys.version, end='')"

# What must come from the system, how to see that it is there, and the Debian package that brings it.
SYSTEM: list[tuple[str, Callable[[], object], str]] = [
    ("a C++ compiler", lambda: shutil.which("c++") or shutil.which("g++") or shutil.which("clang++"), "g++"),
    ("Python's headers", lambda: Path(sysconfig.get_path("include"), "Python.h").exists(), "python3-dev"),
    ("Python's venv", lambda: importlib.util.find_spec("ensurepip"), "python3-venv"),
    ("dbus-daemon", lambda: shutil.which("dbus-daemon"), "dbus"),
]


def check_system() -> None:
    """Ends with one line that names everything missing and the packages that bring it."""
    if sys.version_info < MINIMUM:
        sys.exit(
            f"Python {MINIMUM[0]}.{MINIMUM[1]} or newer is needed, this is {sys.version.split()[0]}: make PYTHON=..."
        )
    missing = [(what, package) for what, present, package in SYSTEM if not present()]
    if missing:
        names = ", ".join(what for what, _ in missing)
        sys.exit(
            f"Missing on this system: {names}. On Debian: apt-get install {' '.join(package for _, package in missing)}"
        )


def digest(paths: Iterable[Path]) -> str:
    """A hash of the names and contents of the files, and of the interpreter."""
    value = hashlib.sha256(sys.version.encode())
    for path in paths:
        value.update(str(path).encode() + b"\0" + path.read_bytes())
    return value.hexdigest()


def step(name: str, key: str, what: str, action: Callable[[], object]) -> None:
    """Runs the action unless it ended well for the same key before."""
    stamp = STAMPS / name
    if stamp.exists() and stamp.read_text() == key:
        return
    started = time.monotonic()
    print(f"env: {what} ...", flush=True)
    action()
    STAMPS.mkdir(parents=True, exist_ok=True)
    stamp.write_text(key)
    print(f"env: {what}: {time.monotonic() - started:.0f} s", flush=True)


def run(*command: str | Path) -> None:
    """Runs a command with the network settings of pip, also for uv; ends if it fails."""
    done = subprocess.run([str(part) for part in command], env=network_environment(), check=False)
    if done.returncode != 0:
        sys.exit(f"failed: {' '.join(str(part) for part in command)}")


def network_environment() -> dict[str, str]:
    """The environment with pip's index and certificates given to uv too, which does not read pip's configuration."""
    environment = dict(os.environ)
    if PYTHON.exists():
        text = subprocess.run(
            [PYTHON, "-m", "pip", "config", "list"], text=True, capture_output=True, check=False
        ).stdout
        pairs = (line.split("=", 1) for line in text.splitlines() if "=" in line)
        settings = {key.replace("-", "_"): value for key, value in pairs}
        for option, variable in (("index_url", "UV_DEFAULT_INDEX"), ("cert", "SSL_CERT_FILE")):
            for scope in ("global", ":env:"):
                if value := settings.get(f"{scope}.{option}"):
                    environment.setdefault(variable, value.strip("'"))
    return environment


def locked(package: str) -> str:
    """The lines of requirements.lock that pin one package, with its hashes."""
    lines = LOCK.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(f"{package}=="))
    end = next((i for i in range(start, len(lines)) if not lines[i].endswith("\\")), len(lines))
    return "\n".join(lines[start : end + 1]) + "\n"


def create() -> None:
    """A virtual environment of this Python with pip and the locked uv."""
    version = subprocess.check_output([PYTHON, "-c", VERSION], text=True) if PYTHON.exists() else sys.version
    run(sys.executable, "-m", "venv", *(["--clear"] if version != sys.version else []), VENV)
    STAMPS.mkdir(parents=True, exist_ok=True)
    bootstrap = STAMPS / "uv.lock"
    bootstrap.write_text(locked("uv"))
    run(
        PYTHON,
        "-m",
        "pip",
        "install",
        "-q",
        "--disable-pip-version-check",
        "--require-hashes",
        "--no-deps",
        "-r",
        bootstrap,
    )


def install_wheels(wheels: list[Path]) -> None:
    """Installs the message wheels, whatever version of them was there."""
    run(UV, "pip", "install", "-q", "--python", PYTHON, "--no-deps", "--reinstall", *wheels)


def packages() -> list[Path]:
    """Folders of the kit, of the recording format and of every service."""
    ours = [ROOT / "interfaces" / name for name in ("sense4hri", "sense4hri_recording")]
    return [*ours, *sorted(path.parent for path in ROOT.glob("services/*/pyproject.toml"))]


def install_packages() -> None:
    """The kit and the services, editable, without touching the locked packages."""
    editable = [argument for folder in packages() for argument in ("-e", folder)]
    run(UV, "pip", "install", "-q", "--python", PYTHON, "--no-deps", "--no-build-isolation", *editable)


def main() -> None:
    check_system()
    message_wheels.BUILD.mkdir(exist_ok=True)
    with (message_wheels.BUILD / "environment.lock").open("w") as alone:
        fcntl.flock(alone, fcntl.LOCK_EX)  # two at once would take each other's half-made build environment
        make()


def make() -> None:
    """Brings the environment up to date, step by step."""
    step("venv", sys.version, f"virtual environment with Python {sys.version.split()[0]}", create)
    install = (UV, "pip", "install", "-q", "--python", PYTHON, "--require-hashes", "-r", LOCK)
    step("lock", digest([LOCK]), "packages of requirements.lock", lambda: run(*install))
    os.environ.update(network_environment())
    wheels = message_wheels.wheels(str(PYTHON))
    step("messages", json.dumps([str(path) for path in wheels]), "message packages", lambda: install_wheels(wheels))
    files = [folder / name for folder in packages() for name in ("pyproject.toml", "package.xml", "setup.cfg")]
    step("packages", digest(files), "the kit and the services, editable", install_packages)


if __name__ == "__main__":
    main()
