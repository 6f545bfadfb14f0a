"""How long `make test` takes where everything is built: on an idle machine, without an Engine and a test cluster."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

TESTS = Path(__file__).resolve().parents[1]
GROUPS = ("unit", "kit", "contract", "graph", "browser")
TARGET_MIN = 12.0
ALL = re.compile(r"^all +(\d+) +(\d+) +(\d+) +(\d+) +(\d+) +(\d+)$", re.MULTILINE)
"""The last line of the table: files, passed, failed, skipped, seconds of all files, CPU seconds."""
WALL = re.compile(r"^(\d+) s on the wall$", re.MULTILINE)


def rows() -> list[dict[str, Any]]:
    """One run of all tests that are not slow."""
    only = [word for group in GROUPS for word in ("--only", group)]
    done = subprocess.run([sys.executable, TESTS / "run.py", *only], stdout=subprocess.PIPE, text=True, check=False)
    told, wall = ALL.search(done.stdout), WALL.search(done.stdout)
    if told is None or wall is None:
        raise RuntimeError(f"tests/run.py ended with {done.returncode} and no table")
    _, passed, failed, skipped, _, cpu_s = told.groups()
    minutes, of_cpu = int(wall[1]) / 60, f"{int(cpu_s) / 60:.1f} min of CPU"
    return [
        {
            "what": "make test, with everything built",
            "target": f"<= {TARGET_MIN:.0f} min on two idle cores",
            "measured": f"{minutes:.1f} min, {of_cpu}; {passed} passed, {failed} failed, {skipped} skipped",
            "ok": minutes <= TARGET_MIN and not int(failed),
        }
    ]
