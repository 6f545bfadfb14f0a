"""What Compose itself would refuse, or read in another way than it was meant: names, and what they refer to."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from compose_yaml import load, near
from sense4hri.names import folder_name
from study_file import SERVICES, Study

from checks.finding import Finding, Places

PROJECT = re.compile(r"[a-z0-9][a-z0-9_-]*")
SERVICE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
IMAGE = re.compile(r"sense4hri/(?P<service>[^:@]+)(?P<tag>[:@].*)?")
CONDITIONS = ("service_started", "service_healthy", "service_completed_successfully")
RESTARTS = ("no", "always", "on-failure", "unless-stopped")
OF_A_SERVICE, OF_A_VOLUME, OF_THE_FILE = ("x-process", "x-host"), ("x-process",), ("x-study",)
"""Keys with which the house adds to the format; Compose looks at none that begins with `x-`."""
REFERRED = {"networks": "default", "secrets": "", "configs": ""}
"""Keys of a service whose entries the file declares under a key of the same name, and what is there undeclared."""
PORT = re.compile(
    r"(?:(?:\d+(?:\.\d+){3}|\[[0-9a-fA-F:]+\]):)?"
    r"(?P<ports>(?:\d+(?:-\d+)?:|:)?(?P<target>\d+)(?:-\d+)?)(?:/(?:tcp|udp|sctp))?"
)
MOST_PORT = 65535
SIZE = re.compile(r"-?\d+(\.\d+)?\s*([bkmg]b?)?", re.I)
SIZES = ("mem_limit", "mem_reservation", "memswap_limit", "shm_size")
DURATION = re.compile(r"(\d+(\.\d+)?(us|ms|s|m|h))+")
NUMBERS = ("cpus", "pids_limit", "mem_swappiness", "oom_score_adj")
VALUES = (
    *((key, SIZE, "a size, like 512m or 2g") for key in SIZES),
    *((key, re.compile(r"-?\d+(\.\d+)?"), "a number") for key in NUMBERS),
    ("stop_grace_period", DURATION, "a duration, like 10s or 1m30s"),
)
"""Keys of a service whose value is one word: key, its form, what that is called."""


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield what is wrong with names of the study, its services, and what they refer to."""
    content = load(study.file, os.environ)
    yield from _names(study, content, places)
    yield from _added(content, "", OF_THE_FILE, places)
    for volume, given in (content.get("volumes") or {}).items():
        yield from _added(given, f"volumes.{volume}", OF_A_VOLUME, places)
    for name, given in content["services"].items():
        yield from _added(given, f"services.{name}", OF_A_SERVICE, places)
        yield from _references(content, name, given, places)
        yield from _values(name, given, places)
        yield from _context(name, given.get("build"), places)
    yield from _images(study, places)


def _names(study: Study, content: Mapping[str, Any], places: Places) -> Iterator[Finding]:
    project = content.get("name")
    if project is None:
        text = "is missing: Compose takes the folder's, which is that of every study beside it"
        yield places.warning("name", f"{text}; write name: sense4hri-{folder_name(study.name).lower()}")
    elif not PROJECT.fullmatch(str(project)):
        yield places.error("name", f"{project!r} must be small letters, digits, _ and -, a letter or digit first")
    if study.name and (folder := folder_name(study.name)) != study.name:
        yield places.warning("x-study.name", f"{study.name!r} is {folder!r} in the path of its recordings")
    for name in content["services"]:
        if not SERVICE.fullmatch(str(name)):
            yield places.error(f"services.{name}", "a service's name is letters, digits, '.', _ and -")


def _added(given: Any, keys: str, known: tuple[str, ...], places: Places) -> Iterator[Finding]:
    """Yield keys that begin with `x-` and are nearly one of the house's: nobody reads them."""
    for key in map(str, given if isinstance(given, dict) else ()):
        if key.startswith("x-") and key not in known and (meant := near(key, known, 0.8)):
            yield places.error(f"{keys}.{key}".lstrip("."), f"nobody reads it{meant}")


def _references(content: Mapping[str, Any], name: str, given: Mapping[str, Any], places: Places) -> Iterator[Finding]:
    """Yield services, networks, secrets and configs that nobody defines."""
    services = content["services"]
    for key in ("depends_on", *REFERRED):
        if not isinstance(given.get(key), list | dict | None):
            yield places.error(f"services.{name}.{key}", f"is {given[key]!r}, must be a list or a table")
            return
    waits = given.get("depends_on") or ()
    for other in _entries(waits):
        if other not in services:
            text = f"there is no service {other!r} in the study{near(other, services)}"
            yield places.error(f"services.{name}.depends_on", text, other)
    for waited in waits.values() if isinstance(waits, dict) else ():
        condition = waited.get("condition") if isinstance(waited, dict) else None
        if condition not in (None, *CONDITIONS):
            text = f"condition {condition!r} must be one of {', '.join(CONDITIONS)}"
            yield places.error(f"services.{name}.depends_on", text, condition)
    for key, always in REFERRED.items():
        known = {always, *map(str, content.get(key) or ())}
        for other in _entries(given.get(key) or ()):
            if other not in known:
                text = f"{other!r} is not declared under `{key}`{near(other, known)}"
                yield places.error(f"services.{name}.{key}", text, other)


def _entries(given: Iterable[Any]) -> list[str]:
    """Return the names of a table, or of a list of names and of tables with `source`."""
    return [str(each.get("source", "")) if isinstance(each, dict) else str(each) for each in given]


def _values(name: str, given: Mapping[str, Any], places: Places) -> Iterator[Finding]:
    """Yield values of a service that Compose cannot read."""
    restart = given.get("restart")
    if restart is not None and (restart is False or str(restart).partition(":")[0] not in RESTARTS):
        text = f'is {restart!r}, must be one of "no", {", ".join(RESTARTS[1:])}'
        yield places.error(f"services.{name}.restart", text)
    deploy = given.get("deploy") or {}
    if not isinstance(deploy, dict):
        yield places.error(f"services.{name}.deploy", f"is {deploy!r}, must be a table")
    elif str(replicas := deploy.get("replicas", 1)) != "1":
        text = f"replicas is {replicas!r}, must be 1: write one entry per process"
        yield places.error(f"services.{name}.deploy", text)
    for key, form, called in VALUES:
        if key in given and not form.fullmatch(str(given[key])):
            yield places.error(f"services.{name}.{key}", f"{given[key]!r} must be {called}")
    for port in given.get("ports") or () if isinstance(given.get("ports"), list | None) else ():
        if wrong := _port(_short(port)):
            yield places.error(f"services.{name}.ports", wrong, str(port))


def _context(name: str, build: Any, places: Places) -> Iterator[Finding]:
    """Yield the folder that an image would be built from and that is not there; another machine's is not looked at."""
    context = str(build.get("context", ".") if isinstance(build, dict) else build or ".")
    if "://" not in context and not context.startswith("git@") and not os.path.isdir(places.file.parent / context):
        yield places.error(f"services.{name}.build", f"there is no folder {context!r}", context)


def _short(port: Any) -> str:
    """Return an entry of `ports` as it would be written in one word."""
    if not isinstance(port, dict):
        return str(port)
    published = port.get("published")
    return f"{'' if published is None else f'{published}:'}{port.get('target', '')}"


def _port(given: str) -> str:
    """Return what is wrong with an entry of `ports`, "" where nothing is."""
    found = PORT.fullmatch(given)
    if found is None:
        return f"{given!r} must be like 8080:80 or 127.0.0.1:8080:80"
    wrong = [port for port in map(int, re.findall(r"\d+", found["ports"])) if port > MOST_PORT]
    wrong += [0] * (int(found["target"]) == 0)  # published at 0 it is at any that is free
    return f"port {wrong[0]}: must be 1 to {MOST_PORT}" if wrong else ""


def _images(study: Study, places: Places) -> Iterator[Finding]:
    """Yield images of the house that it does not have, and programs that are not in their service's image."""
    houses = load(SERVICES.parent / "compose" / "compose.yaml", os.environ)["services"].values()
    known = {str(each["image"]) for each in houses if "image" in each}
    for service in study.services:
        if (image := IMAGE.fullmatch(service.image)) is None:
            continue
        keys, bare = f"services.{service.name}", f"sense4hri/{image['service']}"
        own = image["service"].replace("-", "_")
        if bare not in known:
            yield places.error(f"{keys}.image", f"there is no image {bare}{near(bare, known)}", bare)
        elif service.ours and os.path.isdir(SERVICES / image["service"]) and service.package != own:
            text = f"image {bare} has no {service.package}; extend {service.package.replace('_', '-')}"
            yield places.error(f"{keys}.extends", text)
