"""The processes of a study that runs without containers."""

import sys

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
