"""Reads a study file: the compose file that says which processes, sensors, parameters and streams a study has.

`docker compose up` reads the file itself; whatever starts the same study in another way (`make demo`, the ROS launch
file, the tests) reads it here. What a container would run becomes what a plain process runs by one rule: a path inside
a mount is the path of what is mounted, and a named volume is a folder. Everything that is wrong is a StudyError, one
sentence that names the file and the key.
"""

import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from dataclasses import field as dataclass_field
from functools import cached_property
from pathlib import Path
from typing import Any

import compose_yaml
from command_words import mapping, parameters_of
from compose_yaml import StudyError

__all__ = ["Process", "Service", "Study", "StudyError", "examine", "find", "read"]

STUDIES = Path(__file__).parent / "studies"
SERVICES = Path(__file__).parents[1] / "services"
UNASSIGNED = "unassigned"
PYTHON = ("python", "python3")
WRONG = 78
"""Exit status of whatever was given a study that cannot be used."""
HUMAN_ID = re.compile(r"(?!.*__)[A-Za-z][A-Za-z0-9_]{0,62}")
HOST = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
SENSOR_ID = re.compile(r"(?!.*__)[a-z][a-z0-9_]{0,62}")


@dataclass(frozen=True)
class Process:
    """What a plain process runs. env: what differs from the launcher's environment. folder: where; None = anywhere."""

    command: list[str]
    env: dict[str, str]
    folder: str | None


@dataclass(frozen=True)
class Service:
    """One entry under `services`.

    command: the words a container runs; empty where only the image knows them. added: `x-process`, the words that
    follow where it runs as a plain process. mounts: path in the container -> absolute path on this machine, or name of
    a volume. parameters: the ROS parameters that the command sets, by name. places: volumes that are a folder of this
    machine where it runs as a plain process (`x-process` under `volumes`), by name. image, ports, devices: of its
    container. host: the machine, of a study on several; empty = the first (see several_hosts.py). profiles: it runs
    where one of them is asked for; none = always. mem_limit, cpus: of its container, as in `512m`, `0.5`.
    added_parameters: those that `x-process` sets. read_only: paths in the container of mounts that are only read.
    """

    name: str
    command: tuple[str, ...]
    added: tuple[str, ...]
    environment: Mapping[str, str]
    mounts: Mapping[str, str]
    folder: str
    parameters: Mapping[str, Any]
    places: Mapping[str, str]
    image: str = ""
    ports: tuple[Any, ...] = ()
    devices: tuple[str, ...] = ()
    host: str = ""
    profiles: tuple[str, ...] = ()
    mem_limit: str = ""
    cpus: str = ""
    added_parameters: Mapping[str, Any] = dataclass_field(default_factory=dict)
    read_only: frozenset[str] = frozenset()

    @property
    def package(self) -> str:
        """The Python package it runs, as in `python -m <package>`; else its program."""
        words = self.command or self.added
        return words[words.index("-m") + 1] if "-m" in words[:-1] else " ".join(words[:1])

    @property
    def ours(self) -> bool:
        """True for a service of this repository; of somebody else's driver no HTTP is asked."""
        return bool(self.package) and os.path.isdir(SERVICES / self.package.replace("_", "-"))

    @property
    def sensor_id(self) -> str:
        """The sensor whose driver it is; empty where it is no driver."""
        return str(self.parameters.get("sensor_id", ""))

    @property
    def human_id(self) -> str:
        """Who wears the sensor when the study starts."""
        return str(self.parameters.get("human_id", UNASSIGNED))

    def process(self, volumes: Path) -> Process:
        """Return what runs it without a container; a named volume is its place, or its folder in `volumes`."""
        here = mapping({target: self.places.get(source, source) for target, source in self.mounts.items()}, volumes)
        words = [here(word) for word in (*self.command, *self.added)]
        if words[0] in PYTHON:
            words[0] = sys.executable
        return Process(words, {name: here(text) for name, text in self.environment.items()}, here(self.folder) or None)


@dataclass(frozen=True)
class Study:
    """One study. name and task: of its sessions; participants: their human_ids; required_streams: topics or globs.

    hosts: name -> address of each machine, of a study on several. on_request: what runs where its profile is asked for.
    """

    file: Path
    name: str
    task: str
    participants: tuple[str, ...]
    required_streams: tuple[str, ...]
    services: tuple[Service, ...]
    hosts: Mapping[str, str] = dataclass_field(default_factory=dict)
    on_request: tuple[Service, ...] = ()

    @cached_property
    def processes(self) -> tuple[Service, ...]:
        """What can run as a plain process."""
        return tuple(service for service in self.services if service.command or service.added)

    @property
    def only_images(self) -> tuple[Service, ...]:
        """What runs in a container alone, for only its image knows what it does."""
        return tuple(service for service in self.services if service not in self.processes)

    @property
    def sensors(self) -> tuple[Service, ...]:
        """The drivers."""
        return tuple(service for service in self.processes if service.sensor_id)

    @property
    def packages(self) -> frozenset[str]:
        """Which packages run."""
        return frozenset(service.package for service in self.processes)

    def of(self, package: str) -> Service | None:
        """Return the first service that runs this package, None where there is none."""
        return next((service for service in self.processes if service.package == package), None)

    def volumes(self) -> set[str]:
        """Names of the volumes that its processes use and that are nowhere yet."""
        named = {
            source for service in self.processes for source in service.mounts.values() if source not in service.places
        }
        return {source for source in named if not source.startswith("/")}


def find(name: str) -> Path:
    """Return the file of the study with this name, or the path itself where it is one. Raises StudyError."""
    path = Path(name) if name.endswith((".yaml", ".yml")) else STUDIES / f"{name}.yaml"
    if not os.path.isfile(path):  # Path's own raises where the name is too long for one
        known = ", ".join(sorted(file.stem for file in STUDIES.glob("*.yaml")))
        raise StudyError(f"{name}: there is no study file {path}; give the path of one, or one of {known}")
    return path.resolve()


def read(file: Path, environment: Mapping[str, str] = os.environ) -> Study:
    """Read a study file; environment: what `${NAME}` in it stands for. Raises StudyError, the first of several."""
    study, errors = examine(file, environment)
    if errors:
        raise errors[0]
    return study


def examine(file: Path, environment: Mapping[str, str] = os.environ) -> tuple[Study, list[StudyError]]:
    """Return what can be read of a study file and all that is wrong in it. Raises StudyError where nothing can be."""
    content = compose_yaml.load(file, environment)
    errors: list[StudyError] = []
    all_services = tuple(_services(file, content, environment, errors))
    services = tuple(service for service in all_services if not service.profiles)
    on_request = tuple(service for service in all_services if service.profiles)
    about: dict[str, Any] = {}
    try:
        about = _about(file, content.get("x-study"))
    except StudyError as error:
        errors.append(error)
    errors += _unfit(file, services, about)
    worn = {service.human_id for service in services if service.sensor_id} - {UNASSIGNED}
    participants = tuple(about.get("participants", sorted(worn)))
    streams = tuple(about.get("required_streams", ()))
    name, task, hosts = about.get("name", ""), about.get("task", ""), about.get("hosts", {})
    return Study(file, name, task, participants, streams, services, hosts, on_request), errors


def _services(
    file: Path, content: Mapping[str, Any], environment: Mapping[str, str], errors: list[StudyError]
) -> Iterator[Service]:
    """Yield the services that a study names; what is wrong with the others is added to errors."""
    places = _places(file, content.get("volumes"))
    for name in content["services"]:
        try:
            yield _service(file, name, compose_yaml.service(file, name, environment), places)
        except StudyError as error:
            errors.append(error)


def _unfit(file: Path, services: tuple[Service, ...], about: Mapping[str, Any]) -> Iterator[StudyError]:
    """Yield what is wrong with ids, participants and topics."""
    yield from _wrong_sensors(file, services)
    seen: set[str] = set()
    for human_id in about.get("participants", ()):
        if not HUMAN_ID.fullmatch(human_id):
            yield StudyError(f"{file}: x-study.participants: {human_id!r} is no human_id (letters, digits, _)")
        if human_id in seen:
            yield StudyError(f"{file}: x-study.participants: {human_id!r} is there twice")
        seen.add(human_id)
    for service in services:
        if service.host and service.host not in about.get("hosts", {}):
            named = f"{file}: services.{service.name}.x-host: {service.host!r}"
            yield StudyError(f"{named} is no machine of the study; give its address under x-study.hosts")
    for topic in about.get("required_streams", ()):
        if not topic.startswith("/"):
            yield StudyError(f"{file}: x-study.required_streams: {topic!r} must be a topic or glob that begins with /")


def _about(file: Path, given: Any) -> dict[str, Any]:
    """Return `x-study` with every key and type checked."""
    allowed = [field.name for field in fields(Study) if field.name not in ("file", "services", "on_request")]
    if not isinstance(given, dict) or "name" not in given:
        raise StudyError(f"{file}: x-study: must have a name, and may have {', '.join(allowed[1:])}")
    for key, value in given.items():
        if key not in allowed:
            raise StudyError(f"{file}: x-study.{key}: unknown, allowed are {', '.join(allowed)}")
        if key == "hosts":
            _check_hosts(f"{file}: x-study.hosts", value)
            continue
        many = key in ("participants", "required_streams")
        entries = value if many and isinstance(value, list) else [None] if many else [value]
        if not all(isinstance(entry, str) for entry in entries):
            raise StudyError(f"{file}: x-study.{key}: is {value!r}, must be {'a list of texts' if many else 'a text'}")
    return given


def _check_hosts(where: str, given: Any) -> None:
    """Raise StudyError unless it is a table of machines, by name, with the address of each."""
    if not isinstance(given, dict) or not all(
        isinstance(word, str) and word for pair in given.items() for word in pair
    ):
        raise StudyError(f"{where}: is {given!r}, must be a table of names of machines and their addresses")
    for name in given:
        if not HOST.fullmatch(name):
            raise StudyError(f"{where}: {name!r} must be letters, digits, '.', _ and -, a letter or digit first")


def _places(file: Path, given: Any) -> dict[str, str]:
    """Return `x-process` of every volume that has it: where plain processes find what the volume holds."""
    places = {}
    for name, about in given.items() if isinstance(given, dict) else ():
        if isinstance(about, dict) and "x-process" in about:
            places[name] = about["x-process"]
            if not isinstance(places[name], str) or not places[name].startswith("/"):
                raise StudyError(f"{file}: volumes.{name}.x-process: is {places[name]!r}, must begin with /")
    return places


def _service(file: Path, name: str, given: Mapping[str, Any], places: Mapping[str, str]) -> Service:
    where = f"{file}: services.{name}"
    if [*given["command"], *given["x-process"]][-1:] == ["-m"]:
        raise StudyError(f"{where}.command: -m must be followed by the name of a package")
    here = mapping(given["volumes"], Path("volumes"))
    parameters = parameters_of(f"{where}.command", given["command"], here)
    of_process = parameters_of(f"{where}.x-process", [*given["command"], *given["x-process"]], here)
    added = {name: value for name, value in of_process.items() if parameters.get(name) != value}
    return Service(
        name,
        tuple(given["command"]),
        tuple(given["x-process"]),
        given["environment"],
        given["volumes"],
        given["working_dir"],
        parameters,
        places,
        given["image"],
        tuple(given["ports"]),
        tuple(map(str, given["devices"])),
        given["x-host"],
        tuple(given["profiles"]),
        given["mem_limit"],
        given["cpus"],
        added,
        frozenset(given["read_only"]),
    )


def _wrong_sensors(file: Path, services: tuple[Service, ...]) -> Iterator[StudyError]:
    """Yield where an id is not as the contract wants it, or used twice."""
    seen: dict[str, str] = {}
    for service in (service for service in services if service.sensor_id):
        where = f"{file}: services.{service.name}.command"
        for what, given, form in (
            ("sensor_id", service.sensor_id, SENSOR_ID),
            ("human_id", service.human_id, HUMAN_ID),
        ):
            if not form.fullmatch(given):
                yield StudyError(f"{where}: {what} {given!r} must match {form.pattern}")
        if other := seen.get(service.sensor_id):
            yield StudyError(f"{where}: sensor_id {service.sensor_id!r} is that of {other} already; give another one")
        seen[service.sensor_id] = service.name
