"""compose.demo on a terminal that is closed."""

import os
import pty
import subprocess
import sys
from pathlib import Path

COMPOSE = Path(__file__).resolve().parents[3] / "compose"
DEADLINE_S = 60.0


def test_a_line_for_a_terminal_that_is_closed_just_then_ends_nothing():
    """It is lost; that the terminal is closed is told by a signal that comes a moment later."""
    terminal, its_end = pty.openpty()
    script = "import demo; input(); demo._say('lost'); demo._say('nobody reads'); print('this', flush=True)"
    run = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=its_end, stderr=its_end, cwd=COMPOSE
    )
    os.close(its_end)
    os.close(terminal)
    run.communicate(b"\n", DEADLINE_S)
    assert run.returncode == 0
