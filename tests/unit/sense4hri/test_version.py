"""The version that software tells of itself."""

import subprocess
from pathlib import Path

import pytest
from sense4hri import version
from sense4hri.version import checkout_version, software_version

GIT = ("git", "-c", "user.name=t", "-c", "user.email=t@t", "-c", "commit.gpgsign=false")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A folder that says which release it is, and a file deep in it."""
    (tmp_path / "VERSION").write_text("0.3.0\n")
    file = tmp_path / "kit" / "src" / "module.py"
    file.parent.mkdir(parents=True)
    file.write_text("")
    checkout_version.cache_clear()
    return file


def commit(root: Path, message: str) -> None:
    for words in (("init", "-q"), ("add", "-A"), ("commit", "-q", "--allow-empty", "-m", message)):
        subprocess.run([*GIT, "-C", root, *words], check=True)


def test_the_commit_that_writes_the_release_is_it_and_later_ones_are_counted(tree):
    """`0.3.0` at the release, `0.3.0+2.g<commit>` two commits later."""
    root = tree.parents[2]
    commit(root, "release")
    assert checkout_version(tree) == "0.3.0"
    checkout_version.cache_clear()
    commit(root, "one")
    commit(root, "two")
    head = subprocess.check_output(["git", "-C", root, "rev-parse", "--short=7", "HEAD"], text=True).strip()
    assert checkout_version(tree) == f"0.3.0+2.g{head}"


def test_without_git_the_release_is_told(tree, monkeypatch):
    """A tarball, or a machine without git, still says which release it is."""
    assert checkout_version(tree) == "0.3.0"
    checkout_version.cache_clear()
    monkeypatch.setenv("PATH", "")
    assert checkout_version(tree) == "0.3.0"


def test_an_installed_package_outside_a_checkout_says_what_it_was_built_as(tmp_path, monkeypatch):
    """An image says what it was built as; a wheel its own version; what is not installed nothing."""
    monkeypatch.setattr(version, "__file__", str(tmp_path / "version.py"))
    monkeypatch.delenv("SENSE4HRI_VERSION", raising=False)
    assert software_version("pytest") == pytest.__version__
    monkeypatch.setenv("SENSE4HRI_VERSION", "0.3.0+5.gabcdef0")
    assert software_version("pytest") == "0.3.0+5.gabcdef0"
    assert software_version("no_such_package") == ""
