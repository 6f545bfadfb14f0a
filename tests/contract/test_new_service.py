"""`make new-driver` and the like in a copy of the tree: what they write passes what every service must pass."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
HELPERS = [str(path.relative_to(ROOT)) for path in ROOT.glob("tests/*.py")]
PARTS = ("VERSION", "pyproject.toml", "compose", "services", "interfaces", "docs", "tests/contract", *HELPERS)
LINKS = ("bare", "serial", "ble", "lsl")


class New(NamedTuple):
    """What is asked of the template, and the service that it makes."""

    words: tuple[str, ...]
    name: str

    @property
    def package(self) -> str:
        return self.name.replace("-", "_")


DRIVERS = tuple(New(("driver", f"{link}-box", link), f"driver-{link}-box") for link in LINKS)
MADE = (  # a driver last: nothing that is written after it makes up for a page it did not come into
    New(("interpreter", "accelerometer"), "interpreter-accelerometer"),
    New(("service", "my-watch"), "my-watch"),
    *DRIVERS,
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the template and the contract tests read, with one service of each kind made in it."""
    folder = tmp_path_factory.mktemp("tree")
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "static")
    for part in PARTS:
        target = folder / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, target, ignore=ignored)
        else:
            shutil.copy(ROOT / part, target)
    script = "import sys; sys.path.insert(0, 'interfaces/template'); import new; " + "; ".join(
        f"new.write(*{new.words})" for new in MADE
    )
    made = run(folder, "-c", script)
    assert made.returncode == 0, made.stderr
    return folder


def run(tree: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    sources = os.pathsep.join(str(tree / "services" / new.name / "src") for new in MADE)
    environment = os.environ | {"PYTHONPATH": sources, "GUI_PORT": "0"}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=tree, env=environment, text=True, capture_output=True, timeout=560, check=False)


def test_what_make_new_writes_holds(tree):
    """Every contract check of a service holds of it, its unit tests pass, and so does what the linter looks at."""
    chosen = " or ".join(new.name for new in MADE)
    checks = [f"tests/contract/test_{each}.py" for each in ("every_service", "devices")]
    checked = run(tree, "-m", "pytest", "-q", *checks, "-k", f"({chosen}) and not it_runs_on")
    assert checked.returncode == 0, checked.stdout
    units = [f"tests/unit/{new.name}" for new in MADE]
    tested = run(tree, "-m", "pytest", "-q", "--import-mode=importlib", *units)
    assert tested.returncode == 0, tested.stdout
    folders = [f"services/{new.name}" for new in MADE]
    for command in (["ruff", "check"], ["mypy", *(f"{folder}/src" for folder in folders)]):
        linted = run(tree, "-m", *command, *(() if command[0] == "mypy" else [*folders, *units]))
        assert linted.returncode == 0, linted.stdout


def test_the_pages_say_what_is_there(tree):
    """The one written last too: docs/devices.md has each under its own name; a driver's status says that it streams."""
    devices, status = ((tree / page).read_text() for page in ("docs/devices.md", "services/README.md"))
    for new in DRIVERS:
        device = new.words[1].replace("-", " ").capitalize()
        assert f"| {device} | [{new.name}]" in devices
        assert re.search(rf"^\| {new.name} \| .*skin conductance.* \| its emulator \|$", status, re.MULTILINE)
        assert f'description = "{device}: ' in (tree / "services" / new.name / "pyproject.toml").read_text()
    assert "| my-watch | as `make new-service` wrote it: does nothing yet | nothing yet |" in status


def test_it_can_be_started(tree):
    """Every module imports; the fields of an interpreter's results are those of its message."""
    words = "; ".join(f"import {new.package}.__main__" for new in MADE)
    fits = "from sense4hri import filling; from sense4hri_msgs.msg import Motion; "
    fits += "from interpreter_accelerometer.stream import Result; filling.check(Result, Motion)"
    checked = run(tree, "-c", f"{words}; {fits}")
    assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize("link", LINKS)
def test_nothing_is_wrong_with_the_study_of_a_new_driver(tree, link):
    """`make check`, which `make up` asks first, finds no error in it, and ends in order."""
    checked = run(tree, "compose/check_study.py", "--study", f"{link}-box", "--as", "processes", "--hours", "0.001")
    assert (checked.returncode, checked.stderr) == (0, ""), checked.stdout + checked.stderr


def test_new_drivers_stream_at_once(tree, ros_domain):
    """`make demo` of the studies written with them, as one: a session with features, nothing lost, of every KIND."""
    words = ["--study", str(as_one(tree)), "--duration", "6", "--port", "0", "--recordings", str(tree / "recordings")]
    done = run(tree, "compose/demo.py", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    for link in LINKS:
        row = re.search(rf"^p1/eda/{link}_box_1 +(\d+) +0 +0 +(\d+)", done.stdout, re.MULTILINE)
        assert row is not None, f"{link}: {done.stdout}"
        assert (int(row[1]) > 6 * 25 * 0.9, int(row[2]) > 0) == (True, True), done.stdout


def as_one(tree: Path) -> Path:
    """The drivers' studies in one file, each with a sensor-bench of its own where it has one."""
    whole = yaml.safe_load((tree / "compose" / "studies" / f"{LINKS[0]}-box.yaml").read_text())
    whole["x-study"]["required_streams"] = []
    for link in LINKS:
        study = yaml.safe_load((tree / "compose" / "studies" / f"{link}-box.yaml").read_text())
        if bench := study["services"].pop("sensor-bench", None):
            whole["services"][f"bench-of-{link}"] = bench
        whole["services"] |= study["services"]
        whole["volumes"] |= study["volumes"]
        whole["x-study"]["required_streams"] += study["x-study"]["required_streams"]
    lsl = whole["services"]["bench-of-lsl"]  # two stand-ins for BlueZ on one socket cannot be
    lsl["command"] = [word.replace("system_bus_socket", "another_socket") for word in lsl["command"]]
    written = tree / "compose" / "studies" / "of-every-kind.yaml"
    written.write_text(yaml.safe_dump(whole))
    return written


def test_another_interpreter_of_the_same_streams_is_named(tree):
    """Two that publish one message on one topic would tell everything twice; itself is no rival, nor any other."""
    made = "ROOT / 'services' / 'interpreter-accelerometer'"
    script = f"import new; from new import ROOT; print(new.rivals({made}, 'Motion'), new.rivals({made}, ''))"
    found = run(tree, "-c", f"import sys; sys.path.insert(0, 'interfaces/template'); {script}")
    assert found.stdout == "['interpreter-motion'] []\n", found.stderr


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("robot", "x"), "kind of service"),
        (("driver", "x", "usb"), "KIND"),
        (("driver", "My Box", "bare"), "NAME"),
        (("interpreter", "box"), "one of ecg"),
        (("interpreter", "temperature"), "gets its message first"),
        (("driver", "polar", "bare"), "there"),
        (("driver", "demo", "serial"), "compose/studies/demo.yaml"),
        (("driver", "driver-acme", "serial"), "without driver-"),
        (("interpreter", "interpreter-ecg"), "without interpreter-"),
        (("service", "json"), "Python has a package json already"),
        (("service", "sense4hri-msgs"), "Python has a package sense4hri_msgs already"),
        (("service", "lambda"), "a word of Python"),
        (("driver", "x" * 41, "ble"), "40 at most"),
    ],
)
def test_what_cannot_be_is_named(tree, words, named):
    """A wrong kind, a wrong name or a service that exists is one sentence, and nothing is written."""
    written = [tree / "compose" / "compose.yaml", *sorted((tree / "compose" / "studies").glob("*.yaml"))]
    before = [path.read_text() for path in written]
    made = run(tree, "interfaces/template/new.py", *words)
    assert (made.returncode, named in made.stderr) == (2, True), made.stderr
    assert [path.read_text() for path in written] == before
