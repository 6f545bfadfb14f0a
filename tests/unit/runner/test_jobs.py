"""Test files as processes: counted, limited, and ended with all that they have started."""

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jobs
import numpy as np
import pytest
from processes import poll

THREE = """
import pytest

def test_true(): pass
def test_false(): assert 1 == 2, "one is not two"
def test_left_out(): pytest.skip("no such thing here")
"""
KEEPS = """
import sys

def test_compiled_code_is_kept(): assert not sys.dont_write_bytecode
"""
TELLS = """
import os
from pathlib import Path

def test_tells(): Path(__file__).with_name("pure").write_text(str(os.nice(0)))
"""
LISTENS = f"""
import os, sys
from pathlib import Path
sys.path.insert(0, {str(Path(jobs.__file__).parent)!r})
from processes import poll

def test_listens():
    told = Path(__file__).with_name("pure")
    poll(lambda: told.exists() and told.read_text(), "the other has told its priority")
    told.with_name("alone").write_text(str(os.nice(0)))
"""
HANGS = """
import os, subprocess, time
from pathlib import Path

def test_hangs():
    child = subprocess.Popen(["sleep", "1000"])
    Path(__file__).with_suffix(".pids").write_text(f"{os.getpid()} {child.pid}")
    time.sleep(1000)
"""


def job(folder: Path, name: str, text: str) -> jobs.Job:
    path = folder / name
    path.write_text(text)
    return jobs.Job("unit", path)


def gone(process_id: int) -> bool:
    """True where there is no such process, or it has ended and nobody has asked."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def pids(hanging: jobs.Job) -> list[int]:
    written = hanging.path.with_suffix(".pids")
    return [int(word) for word in written.read_text().split()] if written.exists() else []


def test_what_passed_failed_and_was_skipped_is_counted(tmp_path):
    """A failing test fails its file, whose output says why; a file without tests does not."""
    made = [job(tmp_path, "test_three.py", THREE), job(tmp_path, "test_none.py", "")]
    found = {result.job.name: result for result in jobs.run(made, jobs.Room(2, 2), 60.0, tmp_path, [])}
    three, none = found["test_three.py"], found["test_none.py"]
    assert (three.ok, three.passed, three.failed, dict(three.skipped)) == (False, 1, 1, {"no such thing here": 1})
    assert three.said() == "1 passed, 1 failed, 1 skipped"
    assert "one is not two" in three.output
    assert three.cpu_s > 0
    assert none.ok
    assert none.said() == "no tests"


def test_arguments_reach_pytest(tmp_path):
    """`-k` chooses tests in every file."""
    (result,) = jobs.run([job(tmp_path, "test_three.py", THREE)], jobs.Room(1, 1), 60.0, tmp_path, ["-k", "true"])
    assert result.ok
    assert result.said() == "1 passed"


def test_what_is_compiled_is_kept(tmp_path, monkeypatch):
    """Also where the machine forbids it: an interpreter of signals takes four times as long to start without."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    (result,) = jobs.run([job(tmp_path, "test_keeps.py", KEEPS)], jobs.Room(1, 1), 60.0, tmp_path, [])
    assert (result.ok, result.said()) == (True, "1 passed")


def test_every_file_writes_into_a_folder_of_its_own_kept_where_it_failed(tmp_path):
    """Two processes with one folder clean up behind each other's backs, and one of them ends with a warning of it."""
    for name, ending in (("a", "pass"), ("b", "assert False")):
        text = f"def test_it(tmp_path):\n    open({str(tmp_path / name)!r}, 'w').write(str(tmp_path))\n    {ending}\n"
        job(tmp_path, f"test_{name}.py", text)
    made = [jobs.Job("unit", tmp_path / f"test_{name}.py") for name in "ab"]
    assert [result.ok for result in jobs.run(made, jobs.Room(1, 1), 60.0, tmp_path, [])] == [True, False]
    passed, failed = (Path((tmp_path / name).read_text()) for name in "ab")
    assert passed.parent != failed.parent
    assert not passed.exists()
    assert failed.is_dir()


def test_there_is_room_for_more_while_cores_have_nothing_to_do(monkeypatch):
    """One more after each look at a machine with time to spare, one less where it has none, between the two bounds."""
    used_percent = iter([0.0, 50.0, 84.0, 90.0, 20.0, 20.0, 100.0, 99.0, 100.0, 100.0, 100.0])
    monkeypatch.setattr(jobs, "used_percent", lambda: next(used_percent))
    now_s = [100.0]
    monkeypatch.setattr(jobs.time, "monotonic", lambda: now_s[0])
    room, seen = jobs.Room(3, 6), []
    for _ in range(10):
        assert room.jobs() == (seen[-1] if seen else 3)  # nothing changes before the next look
        now_s[0] += jobs.LOOK_S
        seen.append(room.jobs())
    assert seen == [4, 5, 5, 6, 6, 5, 4, 3, 3, 3]


def test_no_more_run_than_there_is_room_for(tmp_path, monkeypatch):
    """The next one is begun when one has ended, in their order."""
    made = [job(tmp_path, f"test_{number}.py", "") for number in range(4)]
    beside, begun = [], []
    begin, ended = jobs.Running.__init__, jobs.Running.result

    def noted(running: jobs.Running, of: jobs.Job, *rest: Any) -> None:
        begun.append(of)
        beside.append(1)
        begin(running, of, *rest)

    def counted(running: jobs.Running) -> jobs.Result | None:
        result = ended(running)
        beside.append(-1 if result else 0)
        return result

    monkeypatch.setattr(jobs.Running, "__init__", noted)
    monkeypatch.setattr(jobs.Running, "result", counted)
    assert len(list(jobs.run(made, jobs.Room(2, 2), 60.0, tmp_path, []))) == 4
    assert begun == made
    assert max(np.cumsum(beside)) == 2


ALONE = jobs.Job("graph", Path("test_alone.py"), alone=True)
GRAPH, UNIT = (jobs.Job(group, Path(f"test_{group}.py")) for group in ("graph", "unit"))


def test_pure_code_runs_beside_what_there_is_room_for():
    """On every core, and takes nobody's place; where so many files at a time were asked for it is one of them."""
    assert jobs.following([GRAPH, UNIT], [], 1, 2) == GRAPH
    assert jobs.following([GRAPH, UNIT], [GRAPH], 1, 2) == UNIT
    assert jobs.following([GRAPH, UNIT], [GRAPH, UNIT, UNIT], 1, 2) is None
    assert jobs.following([GRAPH, UNIT], [UNIT, UNIT], 1, 2) == GRAPH
    assert jobs.following([UNIT, GRAPH], [GRAPH, UNIT], 3, 0) == UNIT
    assert jobs.following([UNIT, GRAPH], [GRAPH, UNIT], 2, 0) is None


def test_beside_what_is_alone_only_pure_code_runs(monkeypatch):
    """On every core but one, and nothing where it would be a file like any other; afterwards whatever is next."""
    monkeypatch.setattr(jobs.os, "sched_getaffinity", lambda _: {0, 1})
    assert jobs.following([ALONE, GRAPH, UNIT], [], 3, 2) == ALONE
    assert jobs.following([GRAPH, UNIT], [ALONE], 3, 2) == UNIT
    assert jobs.following([GRAPH, UNIT], [ALONE, UNIT], 3, 2) is None
    assert jobs.following([GRAPH, UNIT], [ALONE], 3, 0) is None
    assert jobs.following([GRAPH, UNIT], [UNIT], 3, 2) == GRAPH


def test_pure_code_gives_way_to_what_runs_beside_it(tmp_path, monkeypatch):
    """Its priority is lower; that of the other is what it was."""
    monkeypatch.setattr(jobs.os, "sched_getaffinity", lambda _: {0, 1})
    pure, alone = job(tmp_path, "test_pure.py", TELLS), job(tmp_path, "test_alone.py", LISTENS)
    alone = alone._replace(group="graph", alone=True)
    results = list(jobs.run([alone, pure], jobs.Room(1, 1, 1), 60.0, tmp_path, []))
    assert [result.output for result in results if not result.ok] == []
    others, own = (int((tmp_path / name).read_text()) for name in ("pure", "alone"))
    assert (own, others) == (os.nice(0), min(os.nice(0) + int(jobs.GIVES_WAY[-1]), 19))


@pytest.mark.parametrize(
    ("user", "nice", "used"), [(38.0, 60.0, 64.0), (65.0, 25.0, 100.0), (78.0, 0.0, 88.0), (71.0, 10.0, 90.0)]
)
def test_what_gives_way_leaves_room(monkeypatch, user, nice, used):
    """Cores that compute for nobody else have time to spare; where the others want all, its quarter is not theirs."""
    times = SimpleNamespace(user=user, nice=nice, system=10.0, idle=90.0 - user - nice)
    monkeypatch.setattr(jobs.psutil, "cpu_times_percent", lambda: times)
    assert jobs.used_percent() == used


def test_a_file_that_hangs_is_ended_and_has_failed(tmp_path):
    """Past its limit a file is ended with what it had started."""
    hanging = job(tmp_path, "test_hangs.py", HANGS)
    (result,) = jobs.run([hanging], jobs.Room(1, 1), 3.0, tmp_path, [])
    assert not result.ok
    assert "took longer than 3 s" in result.output
    poll(lambda: all(gone(number) for number in pids(hanging)), "its processes have ended")


def test_who_stops_listening_ends_what_runs(tmp_path):
    """After an interrupt no process of a running file is left."""
    hanging, quick = job(tmp_path, "test_hangs.py", HANGS), job(tmp_path, "test_three.py", THREE)
    results = jobs.run([hanging, quick], jobs.Room(2, 2), 60.0, tmp_path, [])
    next(results)
    poll(lambda: len(pids(hanging)) == 2, "the file hangs")
    results.close()
    assert os.getpid() not in pids(hanging)
    poll(lambda: all(gone(number) for number in pids(hanging)), "its processes have ended")


@pytest.mark.parametrize(("status", "said"), [(-9, "ended with -9"), (2, "ended with 2"), (0, "no tests")])
def test_an_end_without_a_count_is_told(tmp_path, status, said):
    """Of a process that could not write its report, its status stands in the line."""
    assert jobs.Result(jobs.Job("unit", tmp_path), status, 1.0, 1.0, "").said() == said
