"""A test tool's bump rebuilds no image: its lock is in no image's context, and no other lock follows from it."""

import importlib.util
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).resolve().parents[2]
RULES = (ROOT / ".dockerignore").read_text().split()


def in_context(path: str) -> bool:
    """True where Docker hands a file to the builds: the last rule that fits it or a folder above decides."""
    places = [each for each in (PurePosixPath(path), *PurePosixPath(path).parents) if each.name]
    kept = True
    for rule in RULES:
        glob = rule.removeprefix("!").removeprefix("**/")
        if any(fnmatch(place.name if "**/" in rule else str(place), glob) for place in places):
            kept = rule.startswith("!")
    return kept


def test_what_only_tests_need_is_in_no_images_context() -> None:
    """Of all files of the checkout none that names test tools is; the locks that images are made of are."""
    tracked = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True, timeout=60).splitlines()
    handed = set(filter(in_context, tracked))
    assert handed >= {"requirements.lock", "services/analysis/requirements.lock", "interfaces/build-requirements.lock"}
    assert [name for name in handed if "requirements-test" in name or name.startswith("tests/")] == []


def test_the_rules_are_read_as_docker_reads_them() -> None:
    """A later rule goes before an earlier one, and a rule for a folder counts for what is in it."""
    assert in_context("services/recorder/src/recorder/bag.py")
    assert not in_context("services/recorder/src/recorder/__pycache__/bag.pyc")
    assert not in_context("compose/compose.yaml")


def test_the_locks_of_images_are_resolved_without_the_test_tools(monkeypatch: pytest.MonkeyPatch) -> None:
    """`environment.py lock` names the test tools' lists only where it writes their own lock."""
    monkeypatch.syspath_prepend(str(ROOT / "interfaces"))
    spec = importlib.util.spec_from_file_location("environment_of_locks", ROOT / "interfaces" / "environment.py")
    assert spec is not None
    assert spec.loader is not None
    environment = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(environment)
    written: dict[str, str] = {}
    monkeypatch.setattr(
        environment, "run", lambda *words: written.update({str(words[words.index("-o") + 1]): f"{words}"})
    )
    environment.lock()
    assert str(environment.LOCK) in written
    assert [lock for lock, words in written.items() if "requirements-test" in words] == [str(environment.TEST_LOCK)]
