"""The line of a command: a signal ends what it waits for, and is never lost in what rclpy is doing."""

import subprocess
import sys

PROGRAM = """
import os, signal
from contextlib import closing
from types import SimpleNamespace
from sense4hri.line import Line

done = []

def spin_once(timeout_sec):
    os.kill(os.getpid(), signal.SIGINT)
    done.append("spun")

with closing(Line("sense4hri-trial", "nobody")) as line:
    executor, line._executor = line._executor, SimpleNamespace(spin_once=spin_once)
    try:
        line.until(lambda: None, 60.0)
    except KeyboardInterrupt:
        done.append("interrupted")
    line._executor = executor
print(*done)
"""


def test_a_signal_is_raised_once_rclpy_works_on_nothing() -> None:
    """In the midst of a message that is being converted rclpy would make a RuntimeError of it."""
    ran = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60, check=False)
    assert ran.stdout.split() == ["spun", "interrupted"], ran.stderr
