"""The tokens of a study in containers: made once, for their owner alone, in files and nowhere else."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import study_tokens
from sense4hri.access import Access, Role

ROOT = Path(__file__).resolve().parents[3]
DEMO = ROOT / "compose" / "studies" / "demo.yaml"
COMPOSE = [str(ROOT / "compose" / "docker.sh"), "compose"]


def has_compose() -> bool:
    try:
        return subprocess.run([*COMPOSE, "version"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def test_tokens_are_made_once_and_reached_by_their_owner_alone(tmp_path: Path) -> None:
    """The second time they are the same; roles differ, studies differ, nobody else gets through the folder."""
    kept = tmp_path / "tokens"
    own = study_tokens.folder("demo", kept)
    first = [(own / role).read_text() for role in study_tokens.ROLES]
    assert [(study_tokens.folder("demo", kept) / role).read_text() for role in study_tokens.ROLES] == first
    assert kept.stat().st_mode & 0o777 == 0o700
    other = study_tokens.folder("here/other.yaml", kept)
    assert len({*first, *((other / role).read_text() for role in study_tokens.ROLES)}) == 4


def test_a_folder_left_open_is_closed_and_an_empty_token_made_anew(tmp_path: Path) -> None:
    """What a full disk or a careless hand left is put right by the next `make up`."""
    own = study_tokens.folder("demo", tmp_path / "tokens")
    (own / "operate").write_text("")
    own.parent.chmod(0o755)
    study_tokens.folder("demo", tmp_path / "tokens")
    assert len((own / "operate").read_text()) > 40
    assert own.parent.stat().st_mode & 0o077 == 0


def test_the_kit_takes_them(tmp_path: Path) -> None:
    """What is made is what a service reads from the file, each with its role."""
    own = study_tokens.folder("demo", tmp_path / "tokens")
    named = {f"SENSE4HRI_{role.upper()}_TOKEN_FILE": str(own / role) for role in study_tokens.ROLES}
    access = Access.from_environment("0.0.0.0", named)
    assert access.bearer((own / "operate").read_text().strip()) is Role.OPERATE
    assert access.bearer((own / "view").read_text().strip()) is Role.VIEW


@pytest.mark.skipif(not has_compose(), reason="no docker compose on this machine")
def test_every_service_with_http_gets_the_files_and_no_token_is_in_what_docker_shows(tmp_path: Path) -> None:
    """Compose takes both files together; tokens are in no environment, label or command. What only watches gets the one
    to view, and the rest none.
    """
    own = study_tokens.folder("demo", tmp_path / "tokens")
    files = ["--profile", "*", "-f", str(DEMO), "-f", str(study_tokens.overlay(study_tokens.taking(DEMO), own))]
    done = subprocess.run([*COMPOSE, *files, "config", "--format", "json"], capture_output=True, text=True, check=True)
    assert not any((own / role).read_text().strip() in done.stdout for role in study_tokens.ROLES)
    services = json.loads(done.stdout)["services"]
    given = {name: {one["source"] for one in keys.get("secrets", [])} for name, keys in services.items()}
    nodes = {name for name, keys in services.items() if "ROS_DOMAIN_ID" in keys.get("environment", {})}
    watching = {"prometheus", "alertmanager", "grafana"}
    assert {"web-gui", "recorder", "h10-1"} <= nodes
    both, view = frozenset(study_tokens.ROLES), frozenset({"view"})
    wanted = dict.fromkeys(services, frozenset()) | dict.fromkeys(nodes, both) | dict.fromkeys(watching, view)
    assert given == wanted
    told = services["web-gui"]
    assert told["environment"]["SENSE4HRI_OPERATE_TOKEN_FILE"] == "/run/secrets/operate"
    assert {(one["source"], one["target"]) for one in told["secrets"]} >= {("operate", "/run/secrets/operate")}


def test_a_study_that_is_none_gets_no_tokens(tmp_path: Path) -> None:
    """`make up` of a mistyped name leaves nothing behind."""
    kept = tmp_path / "tokens"
    command = [sys.executable, str(ROOT / "compose" / "study_tokens.py"), "no-such-study", "--compose"]
    wrong = subprocess.run([*command, "--kept", str(kept)], capture_output=True, text=True, check=False)
    assert "there is no study file" in wrong.stderr
    assert not kept.exists()


@pytest.mark.skipif(not has_compose(), reason="no docker compose on this machine")
@pytest.mark.parametrize(("host", "status"), [("", 1), ("lab-b", 0)])
def test_a_study_on_several_machines_is_not_started_whole_on_one(tmp_path: Path, host: str, status: int) -> None:
    """`make up` without HOST says so also where no .venv is there to check it, and leaves nothing behind."""
    study, kept = tmp_path / "two.yaml", tmp_path / "tokens"
    hosts = "{lab-a: 192.168.1.10, lab-b: 192.168.1.11}"
    study.write_text(
        f"name: two\nx-study: {{name: two, hosts: {hosts}}}\nservices: {{recorder: {{image: recorder}}}}\n"
    )
    command = [sys.executable, str(ROOT / "compose" / "study_tokens.py"), str(study), "--compose", "--host", host]
    done = subprocess.run([*command, "--kept", str(kept)], capture_output=True, text=True, check=False)
    assert (done.returncode, kept.exists()) == (status, not status)
    told = f"{study}: x-study.hosts: HOST must say which of its machines this is; it names lab-a, lab-b\n"
    assert done.stderr == (told if status else "")


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no git checkout")
def test_a_folder_that_is_not_ones_own_is_told_in_a_sentence(tmp_path: Path) -> None:
    """Whoever started a study once as root is told whose the tokens are, and what to do."""
    (tmp_path / "tokens").write_text("no folder")
    command = [sys.executable, str(ROOT / "compose" / "study_tokens.py"), "demo", "--kept", str(tmp_path / "tokens")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"the tokens in {tmp_path}/tokens cannot be used: ")
    assert len(done.stderr.splitlines()) == 1


def test_no_token_is_part_of_the_repository() -> None:
    """Wherever they lie below compose/, git neither holds them nor would take them."""
    command = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", "compose"]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "compose/study_tokens.py" in names
    assert [name for name in names if "/." in name] == []


def test_the_link_has_the_token_in_its_fragment(tmp_path: Path) -> None:
    """What a browser is given to click sends the token to no server, log or history of a proxy."""
    command = [sys.executable, str(ROOT / "compose" / "study_tokens.py"), "demo", "--kept", str(tmp_path / "tokens")]
    command += ["--link", "http://127.0.0.1:8080"]
    link = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    address, _, fragment = link.partition("#token=")
    assert address == "http://127.0.0.1:8080/"
    assert Access(operate_token=fragment).bearer(fragment) is Role.OPERATE
    assert subprocess.run(["git", "check-ignore", "-q", "compose/.tokens/demo/operate"], cwd=ROOT).returncode == 0
