"""Reading, export and report are cut so that nobody carries what he does not need."""

import ast
import importlib.machinery
import importlib.util
import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
POSIX_ONLY = {"fcntl", "grp", "posix", "pwd", "resource", "termios"}
PROBE = """
import importlib.util, json, os, sys
from importlib.resources import files
os.environ.pop("OPENBLAS_NUM_THREADS", None)  # of the tests' own process
import sense4hri_session
assert not [name for name in ("rclpy", "sense4hri_msgs", "recorder") if importlib.util.find_spec(name)]
assert "OPENBLAS_NUM_THREADS" not in os.environ, "a notebook computes on all its cores"
session = sense4hri_session.open(sys.argv[1])
typed = [(files(name) / "py.typed").is_file() for name in ("sense4hri", "sense4hri_recording", "sense4hri_session")]
print(json.dumps({"samples": {key: len(stream.frame()) for key, stream in session.streams.items()}, "typed": typed}))
"""
HEAVY = {"pandas", "pyarrow", "scipy", "pyedflib"}


def image_tool() -> ModuleType:
    """interfaces/image/install-service, which decides what is installed into a service's image."""
    path = ROOT / "interfaces" / "image" / "install-service"
    loader = importlib.machinery.SourceFileLoader("install_service", str(path))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def in_image(service: str) -> set[str]:
    """Every locked package that the image of a service gets."""
    tool = image_tool()
    folder = ROOT / "services" / service
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    wanted = tool.published([tool.normal(text) for text in project["dependencies"]])
    selected = tool.select(wanted, ROOT / "requirements.lock", *folder.glob("requirements.lock"))
    return {tool.normal(line) for line in selected.splitlines() if line[:1] not in " "}


@pytest.mark.parametrize("service", ["recorder", "replay"])
def test_no_analysis_library_is_in_the_image(service):
    """What a recorder or a replay declares, and all that requires, holds no pandas, pyarrow, scipy or pyedflib."""
    found = in_image(service)
    assert {"mcap", "rosbags", "zstandard"} <= found
    assert found & HEAVY == set()


def test_analysis_has_them_all():
    """The same look finds them where they belong, so that it can see them at all."""
    assert in_image("analysis") >= HEAVY


def recorded_session(parent: Path) -> Path:
    """The first seconds of the synthetic study of the unit tests, as the recorder writes it."""
    spec = importlib.util.spec_from_file_location("synthetic_study", ROOT / "tests/unit/sense4hri_session/conftest.py")
    assert spec is not None
    assert spec.loader is not None
    study = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(study)
    return study.record(study.Study(parent), 6.0, (3.0, 4.0)).write()


def python_of(version: str) -> Path | None:
    """An interpreter of this version of Python, where this machine has one."""
    if version == f"{sys.version_info.major}.{sys.version_info.minor}":
        return Path(sys.executable)
    named = [Path(name)] if (name := shutil.which(f"python{version}")) else []
    for python in [*named, *(Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python")]:
        said = subprocess.run([python, "--version"], text=True, capture_output=True, timeout=60, check=False).stdout
        if said.startswith(f"Python {version}."):  # a shim may be of a version that is not there
            return python
    return None


def versions():
    """Pythons to install it with; all but this one are slow."""
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    return [pytest.param(one, marks=() if one == own else pytest.mark.slow) for one in ("3.11", "3.12", "3.13")]


@pytest.fixture(scope="module", params=versions())
def laptop(request, tmp_path_factory) -> Path:
    """The programs of a new environment that has nothing but `sense4hri_session` and what it requires.

    Of a newer Python it has what a stranger gets there: the newest releases, and no compiler to build one with.
    """
    interpreter = python_of(request.param)
    if interpreter is None:
        pytest.skip(f"no Python {request.param} on this machine")
    folder = tmp_path_factory.mktemp("laptop")
    sources = []
    for place in ("interfaces/sense4hri", "interfaces/sense4hri_recording", "services/analysis"):
        ignored = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
        sources.append(shutil.copytree(ROOT / place, folder / Path(place).name, ignore=ignored))
    wheel = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder / "wheels"]
    subprocess.run([*wheel, *sources], check=True, timeout=600)
    uv, python = BIN / "uv", folder / "venv" / "bin" / "python"
    subprocess.run([uv, "venv", "-q", "--python", interpreter, folder / "venv"], check=True, timeout=600)
    install = [uv, "pip", "install", "-q", "--python", python, "--find-links", folder / "wheels"]
    locks = ["-c", ROOT / "requirements.lock", "-c", ROOT / "services" / "analysis" / "requirements.lock"]
    choice = locks if request.param == "3.11" else ["--only-binary", ":all:"]
    subprocess.run([*install, *choice, "sense4hri_session"], check=True, timeout=600)
    return python.parent


@pytest.mark.timeout(1200)
def test_pip_install_opens_a_session_where_there_is_no_ros(laptop, tmp_path):
    """Wheels alone, no rclpy, no messages: a recorded session opens with all its samples, and types are declared."""
    session = recorded_session(tmp_path)
    found = json.loads(subprocess.check_output([laptop / "python", "-c", PROBE, session], text=True, timeout=600))
    assert found["samples"]["p1/ecg/h10_1"] == 650
    assert len(found["samples"]) == 4
    assert found["typed"] == [True, True, True]


@pytest.mark.timeout(1200)
def test_the_commands_are_there_too(laptop, tmp_path):
    """Export, report, repair and withdrawal run from the same environment."""
    session = recorded_session(tmp_path)
    for command in (
        ["sense4hri-export", session, "--quiet"],
        ["sense4hri-report", session],
        ["sense4hri-repair", session],
        ["sense4hri-withdraw", session, "--human", "p2", "--yes", "--quiet"],
    ):
        done = subprocess.run(
            [laptop / command[0], *command[1:]], text=True, capture_output=True, timeout=600, check=False
        )
        assert done.returncode == 0, done.stderr
    assert (session / "report.html").is_file()


def test_nothing_but_the_lock_is_of_one_system_only():
    """No module on the way to a session imports what only POSIX has; the lock does, and has another way for Windows."""
    places = ("interfaces/sense4hri_recording/src", "services/analysis/src")
    users = set()
    for module in (path for place in places for path in (ROOT / place).rglob("*.py")):
        for node in ast.walk(ast.parse(module.read_text())):
            if isinstance(node, ast.Import) and POSIX_ONLY & {alias.name for alias in node.names}:
                users.add(module.name)
            if isinstance(node, ast.ImportFrom) and node.module in POSIX_ONLY:
                users.add(module.name)
    assert users == {"lock.py"}
