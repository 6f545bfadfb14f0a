"""`interfaces/environment.py`: what a package declares is in a lock."""

import importlib.util
from pathlib import Path

import pytest

INTERFACES = Path(__file__).resolve().parents[3] / "interfaces"


@pytest.fixture
def environment(monkeypatch):
    """The program, as a module."""
    monkeypatch.syspath_prepend(str(INTERFACES))
    spec = importlib.util.spec_from_file_location("environment", INTERFACES / "environment.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def package(folder, *needs):
    """Make a package that declares these dependencies."""
    folder.mkdir()
    (folder / "pyproject.toml").write_text(f"[project]\nname = 'x'\ndependencies = {list(needs)}\n")
    return folder


def test_every_package_of_the_repository_declares_what_is_locked(environment):
    """So says `make env` too, before it installs."""
    environment.check_locked()


@pytest.mark.parametrize(("needs", "missing"), [("Left_Pad[x]>=1; python_version>'3'", "left-pad"), ("rxv~=2", "rxv")])
def test_a_dependency_that_is_missing_from_the_lock_is_named(environment, tmp_path, monkeypatch, needs, missing):
    """With the package that needs it and what to do; the kit and what is locked are not."""
    folder = package(tmp_path / "driver-x", "numpy", "sense4hri", needs)
    monkeypatch.setattr(environment, "packages", lambda: [folder])
    with pytest.raises(SystemExit, match=rf"^driver-x needs {missing}, not in requirements\.lock: .* make lock$"):
        environment.check_locked()


def test_a_lock_of_its_own_counts_for_its_package_alone(environment, tmp_path, monkeypatch):
    """What one service pins beside its packaging is no dependency of another."""
    one, other = package(tmp_path / "one", "rxv"), package(tmp_path / "other", "rxv")
    (one / "requirements.lock").write_text("rxv==1.0 \\\n    --hash=sha256:0\n")
    monkeypatch.setattr(environment, "OWN_LOCKS", [one / "requirements.lock"])
    monkeypatch.setattr(environment, "packages", lambda: [one])
    environment.check_locked()
    monkeypatch.setattr(environment, "packages", lambda: [one, other])
    with pytest.raises(SystemExit, match=r"^other needs rxv"):
        environment.check_locked()
