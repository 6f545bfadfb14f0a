"""Runs every test this machine can run and says, one line each, what it leaves out.

    python tests/run.py [--only containers] [--strict] [pytest arguments]

Groups: unit, kit, contract, graph, browser; containers where a Docker Engine answers. Ends with pytest's exit status.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parent
GROUPS = ("unit", "kit", "contract", "graph", "browser", "containers")
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")


def docker_answers() -> bool:
    """True where a Docker Engine answers within 20 s."""
    command = [TESTS.parent / "compose" / "docker.sh", "version", "--format", "{{.Server.Version}}"]
    try:
        return subprocess.run(command, capture_output=True, timeout=20, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def left_out() -> dict[str, str]:
    """Groups that cannot run here, with the reason."""
    reasons = {}
    if not any(shutil.which(name) for name in CHROMIUM):
        reasons["browser"] = "no Chromium, on Debian: apt-get install chromium"
    if not docker_answers():
        reasons["containers"] = "no Docker Engine answers, on Debian: apt-get install docker.io"
    return reasons


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=GROUPS, action="append", help="only this group; may be given several times")
    parser.add_argument("--strict", action="store_true", help="a group that cannot run here is a failure")
    options, pytest_arguments = parser.parse_known_args()
    reasons = left_out()
    wanted = [group for group in options.only or GROUPS if any((TESTS / group).rglob("test_*.py"))]
    for group in wanted:
        if group in reasons:
            print(f"tests: {group} left out: {reasons[group]}", flush=True)
            if options.strict:
                return 1
    chosen = [str(TESTS / group) for group in wanted if group not in reasons]
    if not chosen:
        return 0
    environment = os.environ | {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    environment.pop("METRICS_PORT", None)
    command = [sys.executable, "-m", "pytest", *chosen, *pytest_arguments]
    return subprocess.run(command, cwd=TESTS.parent, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
