"""Which names become message classes: nothing is imported that is not a message package of this environment."""

import subprocess
import sys

import pytest
from sense4hri.message_types import message_class, type_name

IMPORTED = "import pathlib; pathlib.Path(__file__).with_name('imported').touch()\n"


@pytest.fixture(autouse=True)
def fresh():
    message_class.cache_clear()
    yield
    message_class.cache_clear()


def package(folder, name, *messages):
    """A Python package with a `msg` module, installed below folder, and where it notes that it was imported."""
    home = folder / "lib" / name / "msg"
    home.mkdir(parents=True)
    (home.parent / "__init__.py").write_text(IMPORTED)
    (home / "__init__.py").write_text("".join(f"class {message}: pass\n" for message in messages))
    for message in messages:
        definition = folder / "share" / name / "msg" / f"{message}.msg"
        definition.parent.mkdir(parents=True, exist_ok=True)
        definition.write_text("string data\n")
    return home.parent / "imported"


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """An environment of a test's own beside this one."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    for folder in ("ros", "elsewhere"):
        monkeypatch.syspath_prepend(str(tmp_path / folder / "lib"))
    return tmp_path / "ros"


def test_an_installed_message_is_found(prefix):
    """A message whose package and definition lie in a prefix of the environment is the class of that name."""
    package(prefix, "toy_pkg_a", "Ball")
    found = message_class("toy_pkg_a/msg/Ball")
    assert found is sys.modules["toy_pkg_a.msg"].Ball


def test_a_class_has_the_name_it_was_found_by():
    """type_name is the inverse of message_class, for a class that lies as rosidl puts it."""
    kind = type("Ball", (), {"__module__": "toy_pkg.msg._ball"})
    assert type_name(kind) == "toy_pkg/msg/Ball"


def test_a_package_outside_of_the_environment_is_not_imported(prefix, tmp_path):
    """A module that merely can be imported is not: neither without a definition nor with one in another place."""
    imported = package(tmp_path / "elsewhere", "toy_pkg_b", "Ball")
    assert message_class("toy_pkg_b/msg/Ball") is None
    definition = prefix / "share" / "toy_pkg_b" / "msg" / "Ball.msg"
    definition.parent.mkdir(parents=True)
    definition.write_text("string data\n")
    message_class.cache_clear()
    assert message_class("toy_pkg_b/msg/Ball") is None
    assert not imported.exists()


@pytest.mark.parametrize(
    "name",
    ["antigravity/msg/X", "os/msg/Path", "../x/msg/Y", "a.b/msg/C", "a/srv/B", "a/msg/b", "A/msg/B", "", "/msg/"],
)
def test_other_names_are_no_messages(prefix, name):
    """What is no name of a message, or names any other module, is None, and nothing is imported."""
    before = set(sys.modules)
    assert message_class(name) is None
    assert not {module.partition(".")[0] for module in set(sys.modules) - before} & {"antigravity", "a", "A"}


def test_a_module_in_the_working_directory_is_not_imported(tmp_path):
    """Under `python -m` that directory is on the path: a package there, definition and all, is no message."""
    imported = package(tmp_path, "toy_pkg_c", "Ball")
    (tmp_path / "lib" / "asks.py").write_text(
        "from sense4hri.message_types import message_class\nprint(message_class('toy_pkg_c/msg/Ball'))\n"
    )
    command = [sys.executable, "-m", "asks"]
    done = subprocess.run(command, cwd=tmp_path / "lib", capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout == "None\n"
    assert not imported.exists()
