"""Makes .venv at the repository root: locked packages, message wheels, the kit and every service.

What is up to date is left alone.

    python3 interfaces/environment.py [lock]

Standard library only, because it runs before anything is installed.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import os
import re
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
LOCK = ROOT / "requirements.lock"  # of what services import; images know no other, but a service's own
OWN_LOCKS = sorted(
    ROOT.glob("services/*/requirements.lock")
)  # of what one service alone needs: no other image is built anew
TEST_LOCK = ROOT / "requirements-test.lock"
LOCKS = [LOCK, *OWN_LOCKS, TEST_LOCK]
STAMPS = VENV / "stamps"
VERSION_SCRIPT = ROOT / "interfaces" / "sense4hri" / "src" / "sense4hri" / "version.py"
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


def up_to_date(stamp: Path, key: str) -> bool:
    """True where the stamp says that this was done for the same key."""
    return stamp.exists() and stamp.read_text() == key


def step(name: str, key: str, what: str, action: Callable[[], object]) -> None:
    """Runs the action unless it ended well for the same key before."""
    stamp = STAMPS / name
    if up_to_date(stamp, key):
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
    """The kit and the services whose packaging files changed, editable, without touching the locked packages."""
    folders = [folder for folder in packages() if not up_to_date(stamp_of(folder), key_of(folder))]
    editable = [argument for folder in folders for argument in ("-e", folder)]
    run(UV, "pip", "install", "-q", "--python", PYTHON, "--no-deps", "--no-build-isolation", *editable)
    for folder in folders:
        stamp_of(folder).write_text(key_of(folder))


def stamp_of(folder: Path) -> Path:
    """Where it is written down with which packaging files a package was installed."""
    return STAMPS / f"package-{folder.name}"


def key_of(folder: Path) -> str:
    """A hash of a package's packaging files."""
    return digest(folder / name for name in ("pyproject.toml", "package.xml", "setup.cfg", "setup.py"))


def check_locked() -> None:
    """Ends with a line that names every dependency of a package that is not in requirements.lock nor in its own."""
    import tomllib  # not there before Python 3.11, which check_system tells first

    for folder in packages():
        locks = [LOCK, *(lock for lock in OWN_LOCKS if lock.parent == folder)]
        pinned = {name for lock in locks for name in re.findall(r"^([a-z0-9-]+)==", lock.read_text(), re.M)}
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        names = [re.split(r"[\s<>=!~\[;]", text)[0].lower().replace("_", "-") for text in project["dependencies"]]
        if missing := [name for name in names if not name.startswith("sense4hri") and name not in pinned]:
            sys.exit(
                f"{folder.name} needs {', '.join(missing)}, not in requirements.lock: add to requirements.in, make lock"
            )


def main() -> None:
    check_system()
    message_wheels.BUILD.mkdir(exist_ok=True)
    with (message_wheels.BUILD / "environment.lock").open("w") as alone:
        fcntl.flock(alone, fcntl.LOCK_EX)  # two at once would take each other's half-made build environment
        make()


def make() -> None:
    """Brings the environment up to date, step by step."""
    step("venv", sys.version, f"virtual environment with Python {sys.version.split()[0]}", create)
    lists = [argument for lock in LOCKS for argument in ("-r", lock)]
    install = (UV, "pip", "install", "-q", "--python", PYTHON, "--require-hashes", *lists)
    step("lock", digest(LOCKS), "packages of all locks", lambda: run(*install))
    os.environ.update(network_environment())
    os.environ["SENSE4HRI_VERSION"] = subprocess.check_output([PYTHON, VERSION_SCRIPT], text=True).strip()
    wheels = message_wheels.wheels(str(PYTHON))
    step("messages", json.dumps([str(path) for path in wheels]), "message packages", lambda: install_wheels(wheels))
    check_locked()
    keys = json.dumps([key_of(folder) for folder in packages()])
    step("packages", keys, "the kit and the services that changed, editable", install_packages)


def lock() -> None:
    """Resolves all lists anew; what two of them share has one version. Needs an environment that was made."""
    build = ROOT / "interfaces" / "build-requirements"
    compile_ = (
        UV,
        "pip",
        "compile",
        "-q",
        "--universal",
        "--python-version",
        "3.11",
        "--generate-hashes",
        "--no-header",
    )
    run(*compile_, "-o", LOCK, ROOT / "requirements.in")
    for own in OWN_LOCKS:
        run(*compile_, "-c", LOCK, "-o", own, own.with_suffix(".in"))
    known = [argument for lock in (LOCK, *OWN_LOCKS) for argument in ("-c", lock)]
    run(*compile_, *known, "-o", TEST_LOCK, ROOT / "requirements-test.in")
    run(*compile_, "-c", LOCK, "-o", build.with_suffix(".lock"), build.with_suffix(".txt"))


if __name__ == "__main__":
    lock() if sys.argv[1:] == ["lock"] else main()
