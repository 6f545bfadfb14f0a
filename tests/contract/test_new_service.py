"""`make new` in a copy of the tree: what it writes works and passes what every service must pass."""

import os
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
    ("kind", "short", "name"),
    [
        ("driver", "my-box", "driver-my-box"),
        ("interpreter", "accelerometer", "interpreter-accelerometer"),
        ("service", "my-watch", "my-watch"),
    ],
)
def test_what_make_new_writes_works(tree, kind, short, name):
    """Its unit test passes, its modules import, and every contract check of it holds."""
    made = run(tree, name, "interfaces/template/new.py", kind, short)
    assert made.returncode == 0, made.stderr
    package = name.replace("-", "_")
    assert run(tree, name, "-c", f"import {package}.__main__").returncode == 0
    if kind == "interpreter":
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


@pytest.mark.parametrize(
    ("kind", "short", "named"),
    [
        ("robot", "x", "KIND"),
        ("driver", "My Box", "NAME"),
        ("interpreter", "box", "one of ecg"),
        ("driver", "polar", "there"),
    ],
)
def test_what_cannot_be_is_named(tree, kind, short, named):
    """A wrong kind, a wrong name or a service that exists is one sentence, and nothing is written."""
    before = (tree / "compose" / "compose.yaml").read_text()
    made = run(tree, "none", "interfaces/template/new.py", kind, short)
    assert (made.returncode, named in made.stderr) == (2, True), made.stderr
    assert (tree / "compose" / "compose.yaml").read_text() == before
