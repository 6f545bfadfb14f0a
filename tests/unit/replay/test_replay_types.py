"""A recording chooses no code: types are those of the environment's message packages."""

import sys

import pytest
from sense4hri.message_types import message_class

EVIL = "import pathlib\npathlib.Path({mark!r}).touch()\nclass Evil: pass\n"


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """A package `hostile` with a definition beside it, in the working directory, which is on the path."""
    mark = tmp_path / "was run"
    for name in ("__init__.py", "msg.py"):
        path = tmp_path / "hostile_package" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(EVIL.format(mark=str(mark)))
    definition = tmp_path / "share" / "hostile_package" / "msg" / "Evil.msg"
    definition.parent.mkdir(parents=True)
    definition.write_text("bool x\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")
    message_class.cache_clear()
    return mark


@pytest.mark.parametrize("name", ["hostile_package/msg/Evil", "os/msg/Evil", "hostile_package.msg/msg/Evil"])
def test_no_package_of_the_working_directory_is_imported(mark, name):
    """A message type whose package lies beside the recording, where the program was started, is not installed."""
    assert message_class(name) is None
    assert not mark.exists()
    assert "hostile_package" not in sys.modules
