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
    *" ls "*) echo sense4hri-small ;;
    *" up "*) echo "TLS_ADDRESS ${{TLS_ADDRESS-is not set}}" ;;
    *" ps --services"*) printf '%s\\n' {running} ;;
esac
"""


def up(tmp_path: Path, running: str) -> str:
    """What is printed where these services run."""
    (tmp_path / "docker").write_text(DOCKER.format(running=running))
    (tmp_path / "docker").chmod(0o755)
    tokens = [sys.executable, "compose/study_tokens.py", "--kept", str(tmp_path / "tokens"), "demo"]
    command = ["make", "-s", "-o", "images", "up", "RUN=none", f"TOKENS={shlex.join(tokens)}"]
    ports = {"GUI_PORT": "8080", "PROMETHEUS_PORT": "9091"}
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"} | ports
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(("running", "told"), [("recorder web-gui", True), ("recorder", False)])
def test_the_pages_address_is_told_where_a_page_runs(tmp_path: Path, running: str, told: bool) -> None:
    """Not of a study without one, nor on those of several machines that have none."""
    assert up(tmp_path, running).count("http://127.0.0.1:8080/#token=") == (2 if told else 0)


@pytest.mark.parametrize(("running", "told"), [("recorder prometheus", True), ("recorder", False)])
def test_what_prometheus_asks_for_is_told_where_it_runs(tmp_path: Path, running: str, told: bool) -> None:
    """Its address, the user, and the command that prints the password; never the password itself."""
    printed = up(tmp_path, running)
    assert printed.count("http://127.0.0.1:9091, user study; its password is printed by: ") == told
    assert (tmp_path / "tokens" / "demo" / "view").read_text().strip() not in printed


def test_how_to_stop_it_is_told(tmp_path: Path) -> None:
    """`make down` alone stops the demo study, whatever runs."""
    assert up(tmp_path, "recorder").endswith("to stop it: make down STUDY=demo\n")


def test_no_variable_of_https_is_unset(tmp_path: Path) -> None:
    """Compose warns of each, four times."""
    assert "TLS_ADDRESS is not set" not in up(tmp_path, "recorder")


def test_what_still_runs_is_told(tmp_path: Path) -> None:
    """Whoever forgot STUDY has stopped nothing."""
    (tmp_path / "docker").write_text(DOCKER.format(running="recorder"))
    (tmp_path / "docker").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(["make", "-s", "down"], cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    assert "still running: sense4hri-small; make down STUDY=NAME stops a study" in done.stdout


def test_an_engine_without_compose_is_told_before_images_are_built(tmp_path: Path) -> None:
    """As Debian 12 has it: the images take minutes, and would be of no use."""
    (tmp_path / "docker").write_text("#!/bin/sh\n[ $1 != compose ] || { echo 'compose is no command' >&2; exit 1; }\n")
    (tmp_path / "docker").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = ["make", "-s", "up", "RUN=none"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "compose is no command\nmake up needs Docker Compose v2. Ubuntu: apt-get install" in done.stderr
    assert "images:" not in done.stdout
