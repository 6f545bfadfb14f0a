"""What a study needs of Docker: an Engine that answers, its images, the ports that it publishes."""

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import compose_yaml
from study_file import Study

from checks.finding import Finding, Places
from checks.machine import files, taken

SCRIPT = Path(__file__).resolve().parents[1] / "docker.sh"
ANSWER_S = 20.0
OURS = "sense4hri/"
MOST_PORT = 65535


def answers() -> bool:
    """Return whether a Docker Engine answers."""
    try:
        return bool(_docker("version", "--format", "{{.Server.Version}}"))
    except OSError:
        return False


def root() -> Path:
    """Return the folder of Docker's volumes, "/" where it does not say."""
    return Path(_docker("info", "--format", "{{.DockerRootDir}}").strip() or "/")


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield images that are not built, mounts that are not there, and ports that somebody else has."""
    yield from _images(study, places)
    for service in study.services:
        yield from files(service, places)
    yield from _ports(study, places)


def _images(study: Study, places: Places) -> Iterator[Finding]:
    built = set(_docker("images", "--format", "{{.Repository}}:{{.Tag}}").split())
    for service in study.services:
        image = service.image if ":" in service.image.rpartition("/")[2] else f"{service.image}:latest"
        if not service.image or image in built:
            continue
        keys = f"services.{service.name}"
        if service.image.startswith(OURS):
            name = service.image.removeprefix(OURS)
            yield places.error(keys, f"image {service.image} is not built: compose/images.sh {name}, or make images")
        else:
            yield places.warning(keys, f"image {service.image} is not on this machine; Docker will fetch it")


def _ports(study: Study, places: Places) -> Iterator[Finding]:
    """Yield ports of this machine that two services want, or that are taken by something that is not this study."""
    seen: dict[int, str] = {}
    own = _own_ports(study.file)
    for service in study.services:
        keys = f"services.{service.name}.ports"
        for port in filter(None, map(_published, service.ports)):
            if port > MOST_PORT:
                yield places.error(keys, f"port {port}: must be 1 to {MOST_PORT}", str(port))
            elif port in seen:
                yield places.error(keys, f"port {port} is that of {seen[port]} already", str(port))
            elif port not in own and taken(port):
                yield places.error(keys, f"port {port} is taken on this machine", str(port))
            seen[port] = service.name


def _published(given: Any) -> int:
    """Return the port of this machine of an entry of `ports`; 0 where Docker chooses one."""
    if isinstance(given, dict):
        return int(given.get("published") or 0)
    before = str(given).rpartition(":")[0].rpartition(":")[2]
    return int(before) if before.isdigit() else 0


def _own_ports(file: Path) -> set[int]:
    """Return the ports that containers of this study have already: `make up` again is no conflict."""
    project = compose_yaml.load(file, os.environ).get("name", "")
    label = f"label=com.docker.compose.project={project}"
    return {int(port) for port in re.findall(r":(\d+)->", _docker("ps", "--filter", label, "--format", "{{.Ports}}"))}


def _docker(*words: str) -> str:
    """Return what a command of Docker prints, "" where it fails or takes too long."""
    try:
        done = subprocess.run([str(SCRIPT), *words], capture_output=True, text=True, timeout=ANSWER_S, check=False)
    except subprocess.TimeoutExpired:
        return ""
    return done.stdout if done.returncode == 0 else ""
