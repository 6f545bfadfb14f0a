"""`make new-driver` and the like in a copy of the tree: what they write passes what every service must pass."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HELPERS = [str(path.relative_to(ROOT)) for path in ROOT.glob("tests/*.py")]
PARTS = ("VERSION", "pyproject.toml", "compose", "services", "interfaces", "docs", "tests/contract", *HELPERS)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of what the template and the contract tests read."""
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "static")
    for part in PARTS:
        target = tmp_path / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, target, ignore=ignored)
        else:
            shutil.copy(ROOT / part, target)
    return tmp_path


def run(tree: Path, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(tree / "services" / name / "src")}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=tree, env=environment, text=True, capture_output=True, timeout=280, check=False)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("driver", "my-box", "bare"), "driver-my-box"),
        (("driver", "my-box", "serial"), "driver-my-box"),
        (("interpreter", "accelerometer"), "interpreter-accelerometer"),
        (("service", "my-watch"), "my-watch"),
    ],
)
def test_what_make_new_writes_works(tree, words, name):
    """Its unit test passes, its modules import, and every contract check of it holds."""
    made = run(tree, name, "interfaces/template/new.py", *words)
    assert made.returncode == 0, made.stderr
    package = name.replace("-", "_")
    assert run(tree, name, "-c", f"import {package}.__main__").returncode == 0
    if words[0] == "interpreter":
        fits = "from sense4hri import filling; from sense4hri_msgs.msg import Motion; from {0}.stream import Result"
        checked = run(tree, name, "-c", f"{fits.format(package)}; filling.check(Result, Motion)")
        assert checked.returncode == 0, checked.stderr
    held = [f"tests/contract/test_{each}.py" for each in ("every_service", "devices")]
    checks = [*held, "-k", f"{name} and not it_runs_on"]
    tested = run(tree, name, "-m", "pytest", "-q", f"tests/unit/{name}", *checks)
    unit = run(tree, name, "-m", "pytest", "-q", f"tests/unit/{name}")
    assert (tested.returncode, unit.returncode) == (0, 0), tested.stdout + unit.stdout
    lint = [sys.executable, "-m", "ruff", "check", f"services/{name}", f"tests/unit/{name}"]
    linted = subprocess.run(lint, cwd=tree, capture_output=True, text=True, check=False)
    assert linted.returncode == 0, linted.stdout


@pytest.mark.parametrize("link", ["bare", "serial"])
def test_a_new_driver_streams_at_once(tree, ros_domain, link):
    """`make demo` of the study that is written with it records a session, with features, and nothing is lost."""
    assert run(tree, "driver-my-box", "interfaces/template/new.py", "driver", "my-box", link).returncode == 0
    words = ["--study", "my-box", "--duration", "6", "--port", "0", "--recordings", str(tree / "recordings")]
    done = run(tree, "driver-my-box", "compose/demo.py", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    row = re.search(r"^p1/eda/my_box_1 +(\d+) +0 +0 +(\d+)", done.stdout, re.MULTILINE)
    assert row is not None, done.stdout
    assert (int(row[1]) > 6 * 25, int(row[2]) > 0) == (True, True), done.stdout


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("robot", "x"), "kind of service"),
        (("driver", "x", "usb"), "KIND"),
        (("driver", "x", "ble"), "driver-ble-heart-rate"),
        (("driver", "x", "lsl"), "driver-lsl"),
        (("driver", "My Box", "bare"), "NAME"),
        (("interpreter", "box"), "one of ecg"),
        (("driver", "polar", "bare"), "there"),
    ],
)
def test_what_cannot_be_is_named(tree, words, named):
    """A wrong kind, a wrong name or a service that exists is one sentence, and nothing is written."""
    before = (tree / "compose" / "compose.yaml").read_text()
    made = run(tree, "none", "interfaces/template/new.py", *words)
    assert (made.returncode, named in made.stderr) == (2, True), made.stderr
    assert (tree / "compose" / "compose.yaml").read_text() == before
