#!/usr/bin/env python3
"""The tokens of a study in containers: made once, handed to its services as files, kept out of their environments.

    compose/study_tokens.py STUDY              prints the token to operate; `STUDY view`: the one to view
    compose/study_tokens.py STUDY --link PAGE  prints the page's address with it in the fragment, which is sent nowhere
    compose/study_tokens.py STUDY --compose    prints the path of a compose file that hands them to the services;
                                               --host: which machine this is, of a study on several

A ROS node gets both; any other service those whose file, as /run/secrets/view, its environment names.
They lie in compose/.tokens/STUDY/operate and .../view, in a folder that its owner alone may enter (mode 700) and git
does not see; studies of one file name share them. Who loses one, or wants another one: remove the folder, `make up`
again.
"""

import argparse
import json
import os
import secrets
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

HERE = Path(__file__).resolve().parent
KEPT = HERE / ".tokens"
ROLES = ("operate", "view")
INSIDE = "/run/secrets"


def folder(study: str, kept: Path = KEPT) -> Path:
    """Return the folder with a study's tokens, made where it is not there yet. study: its name or file."""
    kept.mkdir(mode=0o700, exist_ok=True)
    kept.chmod(0o700)
    own = kept / Path(study).name.removesuffix(".yaml").removesuffix(".yml")
    own.mkdir(exist_ok=True)
    for role in ROLES:
        _make(own / role)
    return own


def _make(file: Path) -> None:
    """Write a token once; whole or not at all, for a container may be started beside."""
    if file.is_file() and file.stat().st_size:
        return
    new = file.with_suffix(".new")
    new.write_text(secrets.token_urlsafe(32) + "\n")
    new.chmod(0o644)  # services run as a user of their own; who keeps others out is the folder above
    new.replace(file)


def overlay(given: Mapping[str, tuple[str, ...]], own: Path) -> Path:
    """Write, beside the tokens, the compose file that hands them to these services, each with its roles."""
    file = own / "compose.json"
    services = {name: {"environment": files_of(roles), "secrets": list(roles)} for name, roles in given.items()}
    content = {"services": services, "secrets": {role: {"file": str(own / role)} for role in ROLES}}
    file.write_text(json.dumps(content, indent=1))
    return file


def files_of(roles: tuple[str, ...]) -> dict[str, str]:
    """Return the variables that name the files of these roles."""
    return {f"SENSE4HRI_{role.upper()}_TOKEN_FILE": f"{INSIDE}/{role}" for role in roles}


def roles_of(environment: Mapping[str, str | None]) -> tuple[str, ...]:
    """Return the roles whose tokens a service with these variables gets."""
    if "ROS_DOMAIN_ID" in environment:
        return ROLES
    return tuple(role for role in ROLES if any(f"{INSIDE}/{role}" in (text or "") for text in environment.values()))


def taking(study: Path, host: str = "") -> dict[str, tuple[str, ...]]:
    """Return the study's services that get a token, each with its roles. Asks Docker Compose; SystemExit.

    host: which machine this is. Without it no study on several is taken, for it would be started whole on one.
    """
    command = [str(HERE / "docker.sh"), "compose", "-f", str(study), "--profile", "*", "config", "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{study} is not read by docker compose: {done.stderr.strip()}")
    content = json.loads(done.stdout)
    about = content.get("x-study")
    if not host and isinstance(about, dict) and about.get("hosts"):
        told = f"HOST must say which of its machines this is; it names {', '.join(about['hosts'])}"
        raise SystemExit(f"{study}: x-study.hosts: {told}")
    roles = {name: roles_of(keys.get("environment") or {}) for name, keys in sorted(content["services"].items())}
    return {name: own for name, own in roles.items() if own}


def file_of(study: str) -> Path:
    """Return the file of a study by its name or path."""
    path = Path(study) if study.endswith((".yaml", ".yml")) else HERE / "studies" / f"{study}.yaml"
    if not os.path.isfile(path):  # Path's own raises where the name is too long for one
        raise SystemExit(f"{study}: there is no study file {path}")
    return path.resolve()


def main() -> int:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description="the tokens of a study in containers")
    parser.add_argument("study", nargs="?", default="demo", help="its name or file; demo where none is given")
    parser.add_argument("role", nargs="?", default="operate", choices=ROLES)
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument("--link", metavar="PAGE", help="print the page's address with the token, to be clicked")
    asked.add_argument("--compose", action="store_true", help="print the compose file that hands them to the services")
    parser.add_argument("--host", default="", help="which machine this is, of a study on several")
    parser.add_argument("--kept", type=Path, default=KEPT, metavar="FOLDER", help="where they lie (%(default)s)")
    options = parser.parse_args()
    os.umask(0o022)
    given = taking(file_of(options.study), options.host) if options.compose else None
    try:
        own = folder(options.study, options.kept)
        token = (own / options.role).read_text().strip()
        told = overlay(given, own) if given is not None else f"{options.link}/#token={token}" if options.link else token
    except OSError as error:
        whose = "if another user of this machine has made them, that user removes the folder"
        raise SystemExit(f"the tokens in {options.kept} cannot be used: {error.strerror}; {whose}") from error
    print(told)
    return 0


if __name__ == "__main__":
    sys.exit(main())
