"""The processes of a study that runs without containers."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from children import Children
from processes import poll
from study_file import Process

DEAF = (
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('my radio', flush=True); time.sleep(600)"
)
SLOW = (
    "import signal, sys, time; signal.signal(signal.SIGTERM, lambda *_: (time.sleep(2), sys.exit()));"
    "print('I write', flush=True); time.sleep(600)"
)
IN_TIME = "import time; print('here', flush=True); time.sleep(600)"
IN_A_SHELL = "sleep 600 & echo $!; wait"
LAUNCHER = """
import sys, time
from pathlib import Path
from children import Children
from study_file import Process
Children(Path(sys.argv[1]), ()).start("strap", Process(["sh", "-c", "echo $$; exec sleep 600"], {}, None))
time.sleep(600)
"""


@pytest.mark.parametrize(("program", "killed"), [(DEAF, ["strap: my radio"]), (IN_TIME, [])])
def test_who_does_not_end_in_time_is_killed_and_told_with_what_it_said_last(tmp_path, program, killed):
    """One that releases its radio for ever would hold up the end of a study; its log goes with the study."""
    children = Children(tmp_path, ())
    strap = children.start("strap", Process([sys.executable, "-c", program], {}, str(tmp_path)))
    poll(strap.log, "it has begun")
    assert [f"{child.name}: {child.last_words()}" for child in children.end(2.0)] == killed
    assert not strap.running()


def test_who_ends_last_has_its_whole_time(tmp_path):
    """The recorder ends after all others; however long they took, it may finish its file."""
    children = Children(tmp_path, ("recorder",))
    for name, program in (("strap", DEAF), ("recorder", SLOW)):
        child = children.start(name, Process([sys.executable, "-c", program], {}, str(tmp_path)))
        poll(child.log, f"{name} has begun")
    assert [child.name for child in children.end(6.0)] == ["strap"]


@pytest.mark.parametrize("deaf", [False, True])
def test_what_a_child_has_started_ends_with_it(tmp_path, deaf):
    """A driver behind a shell would go on publishing; a container's processes end with its first one as well."""
    program = f"trap '' TERM; {IN_A_SHELL}" if deaf else IN_A_SHELL
    children = Children(tmp_path, ())
    strap = children.start("strap", Process(["sh", "-c", program], {}, str(tmp_path)))
    grandchild = int(poll(strap.log, "it has begun"))
    children.end(0.5 if deaf else 5.0)
    poll(lambda: not runs(grandchild), "what the child has started has ended", 5)


def test_a_launcher_that_is_killed_takes_its_children_along(tmp_path):
    """They would hold the sensors and the ports of the next run."""
    command = [sys.executable, "-c", LAUNCHER, str(tmp_path)]
    launcher = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    log = tmp_path / "strap.log"
    child = int(poll(lambda: log.exists() and log.read_text(), "it has begun"))
    launcher.kill()
    launcher.wait()
    poll(lambda: not runs(child), "the child has ended", 5)


def runs(pid: int) -> bool:
    """True for a process that has not ended, whether or not somebody has asked how."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
