"""What is printed beside a failure, so that a CI's log alone shows its cause."""

from pathlib import Path

import jobs

TESTS = Path(__file__).resolve().parents[2]
BROKEN = """
def test_broken(tmp_path):
    (tmp_path / "0_recorder.log").write_text("the disk is full")
    assert False
"""


def test_a_failure_tells_what_its_processes_said_last(tmp_path, monkeypatch):
    """Their logs, the ROS domain and the load of the machine stand in the output of the file."""
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    monkeypatch.setenv("ROS_DOMAIN_ID", "47")
    file = tmp_path / "test_it.py"
    file.write_text(BROKEN)
    (result,) = jobs.run([jobs.Job("graph", file)], jobs.Room(1, 1), 60.0, tmp_path, ["-p", "conftest"])
    assert result.failed == 1
    for words in ("Log 0_recorder.log", "the disk is full", "ROS_DOMAIN_ID=47, load "):
        assert words in result.output
