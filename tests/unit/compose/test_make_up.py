"""`make up`, with a Docker that only says what it would be asked."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
DOCKER = """#!/bin/sh
case "$*" in
    *" config "*) echo '{{"services": {{"recorder": {{"environment": {{"ROS_DOMAIN_ID": "0"}}}}}}}}' ;;
    *" ps --services"*) printf '%s\\n' {running} ;;
esac
"""


@pytest.mark.parametrize(("running", "told"), [("recorder web-gui", True), ("recorder", False)])
def test_the_pages_address_is_told_where_a_page_runs(tmp_path: Path, running: str, told: bool) -> None:
    """Not of a study without one, nor on those of several machines that have none."""
    (tmp_path / "docker").write_text(DOCKER.format(running=running))
    (tmp_path / "docker").chmod(0o755)
    tokens = [sys.executable, "compose/study_tokens.py", "--kept", str(tmp_path / "tokens"), "demo"]
    command = ["make", "-s", "-o", "images", "up", "RUN=none", f"TOKENS={shlex.join(tokens)}"]
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "GUI_PORT": "8080"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("http://127.0.0.1:8080/#token=") == (2 if told else 0)
