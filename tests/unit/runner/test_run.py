"""What fails is tried once more, alone, and told; what is broken stays broken."""

from pathlib import Path

import jobs
import pytest
import run

ONCE = """
from pathlib import Path

def test_passes_when_it_has_failed_before():
    been = Path(__file__).with_suffix(".been")
    there = been.exists()
    been.touch()
    assert there, "the first of all"
"""


def results(folder: Path, group: str, *texts: str) -> list[jobs.Result]:
    """Of a first and, where the rules say so, a second try."""
    made = []
    for number, text in enumerate(texts):
        path = folder / f"test_{number}.py"
        path.write_text(text)
        made.append(jobs.Job(group, path))
    return run.try_again(list(jobs.run(made, jobs.Room(2, 2), 60.0, folder, [])), [])


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "LOGS", tmp_path)
    monkeypatch.setattr(run, "ROOT", tmp_path)


def test_what_passes_alone_is_told_as_unstable(tmp_path, capsys):
    """Such a file passes, and its first failure is printed."""
    found = results(tmp_path, "graph", ONCE)
    assert run.report(found, 1.0) == 0
    printed = capsys.readouterr().out
    assert "the first of all" in printed
    assert "UNSTABLE test_0.py: failed once" in printed


def test_what_fails_twice_has_failed(tmp_path, capsys):
    """A second try does not save what is broken."""
    found = results(tmp_path, "graph", "def test_false(): assert False")
    assert run.report(found, 1.0) == 1
    printed = capsys.readouterr().out
    assert "FAILED test_0.py: 1 failed" in printed
    assert "UNSTABLE" not in printed


@pytest.mark.parametrize(("group", "files"), [("unit", 1), ("graph", run.MOST_TRIED_AGAIN + 1)])
def test_what_the_machine_cannot_be_blamed_for_is_not_tried_again(tmp_path, group, files):
    """Neither pure code nor many files at once."""
    assert [result.ok for result in results(tmp_path, group, *[ONCE] * files)] == [False] * files


def test_what_a_quick_run_leaves_out_is_what_the_readme_says():
    """What is marked in these files, and README.md tells of it."""
    assert run.slow_files() == [
        "contract/test_colcon_workspace.py",
        "contract/test_every_service.py",
        "contract/test_reading_without_ros.py",
        "graph/test_demo_graph.py",
        "graph/test_device_studies.py",
        "graph/test_graph_fuzz.py",
        "graph/test_nine_modalities.py",
        "graph/test_replay_law.py",
        "graph/test_scripted_study.py",
        "graph/test_session.py",
        "graph/test_three_hosts.py",
        "unit/interpreter-ecg/test_ecg_recordings.py",
        "unit/interpreter-eog/test_eog_wander.py",
        "unit/interpreter-ppg/test_ppg_recordings.py",
        "unit/interpreter-respiration/test_respiration.py",
        "unit/sense4hri_session/test_session_hostile.py",
        "unit/sense4hri_session/test_session_notebook.py",
        "unit/sense4hri_session/test_session_withdraw.py",
    ]


def test_a_quick_run_leaves_out_what_is_marked(tmp_path):
    """And nothing else of the file."""
    text = "from pytest import mark\n\n@mark.slow\ndef test_long(): assert False\n\ndef test_short(): pass\n"
    path = tmp_path / "test_0.py"
    path.write_text(text)
    (result,) = jobs.run([jobs.Job("unit", path)], jobs.Room(1, 1), 60.0, tmp_path, run.QUICK)
    assert (result.ok, [name.rpartition(".")[2] for name in result.tests]) == (True, ["test_0::test_short"])


def test_what_is_alone_goes_first_then_what_was_never_run_then_the_longest(tmp_path, monkeypatch):
    """However short it is: what is pure runs beside it, and nothing waits for it at the end."""
    monkeypatch.setattr(run, "SECONDS", tmp_path / "seconds.json")
    names = ("test_faults.py", "test_new.py", "test_long.py", "test_short.py")
    made = [jobs.Job("graph", tmp_path / name, name in run.ALONE) for name in names]
    run.SECONDS.write_text('{"test_short.py": 1.0, "test_long.py": 9.0, "test_faults.py": 0.5}')
    assert run.longest_first(made[::-1]) == made


def test_lonely_and_long_files_are_there():
    """No name is left of a file that was renamed, which would then run beside others, or last."""
    known = {*run.GROUPS, *(path.name for path in run.TESTS.rglob("test_*.py"))}
    known |= {path.name for path in (run.TESTS / "unit").iterdir()}
    assert run.ALONE - known == set()
    assert set(run.MINUTES) - known == set()
