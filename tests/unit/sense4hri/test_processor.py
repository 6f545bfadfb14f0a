"""Which share of a time a thread did not wait for a processor."""

import os
import subprocess
import sys

import pytest
from sense4hri.processor import Processor


class Threads:
    """A folder as Linux has it of a process's threads."""

    def __init__(self, folder):
        self.folder = folder

    def are(self, **threads):
        """Set how long each thread has run and waited so far, in s."""
        for name, (ran_s, waited_s) in threads.items():
            (self.folder / name).mkdir(exist_ok=True)
            (self.folder / name / "schedstat").write_text(f"{round(ran_s * 1e9)} {round(waited_s * 1e9)} 17\n")


@pytest.fixture
def threads(tmp_path):
    return Threads(tmp_path)


def test_the_share_is_what_is_left_after_it_waited(threads):
    """Of each thread for itself; how long it ran is no matter, and more than all of the time is all of it."""
    threads.are(**{"1": (5.0, 9.0), "2": (5.0, 9.0), "3": (5.0, 9.0)})
    processor = Processor(threads.folder)
    threads.are(**{"1": (5.9, 9.0), "2": (5.0, 9.5), "3": (5.0, 12.0)})
    assert processor.own(2.0) == pytest.approx({1: 1.0, 2: 0.75, 3: 0.0})


def test_each_time_is_counted_once(threads):
    """What a thread had waited before the last call is no longer of interest, nor is a thread that has ended."""
    threads.are(**{"1": (1.0, 0.0), "2": (1.0, 0.0)})
    processor = Processor(threads.folder)
    threads.are(**{"1": (1.0, 1.0), "2": (1.0, 1.0)})
    assert processor.own(1.0) == {1: 0.0, 2: 0.0}
    (threads.folder / "2" / "schedstat").unlink()
    assert processor.own(1.0) == {1: 1.0}


def test_where_nothing_is_told_nobody_waited(tmp_path):
    """A machine without schedstat, or none whose numbers can be read: nobody is excused."""
    assert Processor(tmp_path / "nothing").own(1.0) == {}
    (tmp_path / "1").mkdir()
    (tmp_path / "1" / "schedstat").write_text("none\n")
    assert Processor(tmp_path).own(1.0) == {}


@pytest.mark.skipif(not os.path.exists("/proc/self/schedstat"), reason="this machine tells nothing of its scheduler")
def test_a_process_beside_others_on_one_processor_gets_its_part():
    """A real one: five processes that compute on one core; the first is told that it waited for most of the time."""
    program = "\n".join(
        (
            "import os, sys, time",
            "from sense4hri.processor import Processor",
            "os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})",
            "first = os.getpid()",
            "for _ in range(4):",
            "    if os.fork() == 0:",
            "        while os.getppid() == first: pass",
            "        os._exit(0)",
            "processor, begun_s = Processor(), time.monotonic()",
            "while time.monotonic() < begun_s + 2.0: pass",
            "print(processor.own(time.monotonic() - begun_s)[first])",
        )
    )
    told = subprocess.check_output([sys.executable, "-c", program], text=True, timeout=60)
    assert float(told) < 0.6
