"""Examples that hypothesis draws are the same on any machine, and who draws none does not wait for hypothesis."""

from pathlib import Path

import jobs

TESTS = Path(__file__).resolve().parents[2]
DRAWS = """
from hypothesis import settings

FEW = settings(max_examples=3)

def test_alike():
    assert FEW.derandomize
    assert FEW.deadline is None
"""
DRAWS_NONE = """
import atexit
import sys

def test_true():
    atexit.register(lambda: print([name for name in sys.modules if name.startswith("hypo" + "thesis")]))
"""


def passed(text: str, folder: Path) -> jobs.Result:
    """What came of a file with this text, beside the fixtures that every kind of test shares."""
    file = folder / "test_it.py"
    file.write_text(text)
    (result,) = jobs.run([jobs.Job("unit", file)], jobs.Room(1, 1), 60.0, folder, ["-p", "conftest"])
    assert result.said() == "1 passed"
    return result


def test_examples_are_drawn_alike_on_any_machine(tmp_path, monkeypatch):
    """What a file sets of its own keeps to that: no example hangs on chance, and none fails for its time."""
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    passed(DRAWS, tmp_path)


def test_a_file_that_draws_none_runs_without_hypothesis(tmp_path, monkeypatch):
    """It is not imported from the begin to the end of the process."""
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    assert passed(DRAWS_NONE, tmp_path).output.endswith("[]\n")
