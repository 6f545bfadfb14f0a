"""The part of the Compose format that says what runs: `extends`, `${NAME:-default}`, command, environment, volumes.

Pure. Keys that change what runs and are not read here are refused; all others (image, restart, networks ...) matter to
containers alone. Everything that is wrong is a StudyError, one sentence that names the file and the key.
"""

import difflib
import os
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

REFUSED = {
    "entrypoint": "write the whole command under `command`",
    "env_file": "write its lines under `environment`",
    "scale": "write one entry per process",
}
READ = ("command", "environment", "extends", "profiles", "volumes", "working_dir", "x-process")
MISSPELT = 0.8  # likeness from which a key is taken for a wrong spelling of one that is read; `volumes_from` has 0.74
VARIABLE = re.compile(r"\$(?:(?P<dollar>\$)|\{(?P<braced>\w+)(?::-(?P<default>[^}]*))?\}|(?P<plain>\w+)|)")
NAMED_VOLUME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


class StudyError(Exception):
    """A study file that cannot be used: a sentence that names the file and the key."""


class _Loader(yaml.SafeLoader):
    """Refuses a key that is given twice, as Compose does."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.composer.ComposerError(None, None, f"the key {key.value!r} is there twice", key.start_mark)
            seen.add(key.value)
        return node


def load(file: Path, environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the content of a compose file with its variables filled in."""
    try:
        content = yaml.load(file.read_text("utf-8"), _Loader)
    except OSError as error:
        raise StudyError(f"{file} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise StudyError(f"{file} is no YAML: {' '.join(str(error).split())}") from error
    services = content.get("services") if isinstance(content, dict) else None
    if not isinstance(services, dict) or not all(isinstance(entry, dict) for entry in services.values()):
        raise StudyError(f"{file}: services: must be a table of services, each with its keys")
    if "include" in content:
        raise StudyError(f"{file}: include: is not read outside of containers; name each service, with `extends`")
    return dict(_filled(file, content, environment))


def services(file: Path, environment: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the keys below of every service by its name, with what it extends.

    Those with `profiles` are left out: Compose does not start them either, they are run when asked (`analysis`).

    `command` and `x-process` as words; `environment`; `working_dir`; `volumes`: path in the container -> absolute path
    on this machine, or name of a volume; `image`; `ports` and `devices` as they stand there.
    """
    found = {name: _service(file, name, environment, ()) for name in load(file, environment)["services"]}
    return {name: keys for name, keys in found.items() if not keys["profiles"]}


def _service(file: Path, name: str, environment: Mapping[str, str], above: tuple[Any, ...]) -> dict[str, Any]:
    where = f"{file}: services.{name}"
    given = load(file, environment)["services"].get(name)
    if given is None:
        raise StudyError(f"{where}: there is no such service")
    if (file, name) in above:
        raise StudyError(f"{where}.extends: it extends itself")
    _check_keys(where, given)
    base = _extended(where, file, given, environment, (*above, (file, name)))
    own_words = {key: _words(f"{where}.{key}", given[key]) for key in ("command", "x-process") if key in given}
    return {
        **base,
        **own_words,
        "environment": base["environment"]
        | _environment(f"{where}.environment", given.get("environment"), environment),
        "volumes": base["volumes"] | _volumes(f"{where}.volumes", given.get("volumes"), file.parent),
        "working_dir": given.get("working_dir", base["working_dir"]),
        "profiles": given.get("profiles", base["profiles"]),
        "image": given.get("image", base["image"]),
        **{key: [*base[key], *_list(f"{where}.{key}", given.get(key))] for key in ("ports", "devices")},
    }


def _check_keys(where: str, given: Mapping[str, Any]) -> None:
    """Raise StudyError for a key that is refused, or that looks like one that is read and is not."""
    for key in map(str, given):
        if key in REFUSED:
            raise StudyError(f"{where}.{key}: is not read outside of containers; {REFUSED[key]}")
        if key not in READ and (meant := difflib.get_close_matches(key, READ, 1, MISSPELT)):
            raise StudyError(f"{where}.{key}: there is no such key; write {meant[0]}")


def _extended(
    where: str, file: Path, given: Mapping[str, Any], environment: Mapping[str, str], above: tuple[Any, ...]
) -> dict[str, Any]:
    """Return what a service extends, an empty service where it extends nothing."""
    extends = given.get("extends")
    if extends is None:
        tables: dict[str, Any] = {"environment": {}, "volumes": {}}
        lists: dict[str, Any] = {"command": [], "x-process": [], "profiles": [], "ports": [], "devices": []}
        return tables | lists | {"working_dir": "", "image": ""}
    if isinstance(extends, str):
        extends = {"service": extends}
    if not isinstance(extends, dict) or "service" not in extends or extends.keys() - {"file", "service"}:
        raise StudyError(f"{where}.extends: is {extends!r}, must be {{file: ..., service: ...}}")
    of = (file.parent / extends["file"]).resolve() if "file" in extends else file
    return _service(of, str(extends["service"]), environment, above)


def _words(where: str, given: Any) -> list[str]:
    """Return a command's words; a text is split as a shell would, without a shell's variables and operators."""
    if isinstance(given, list) and all(isinstance(word, str | int | float) for word in given):
        return [str(word) for word in given]
    if given is not None and not isinstance(given, str):
        raise StudyError(f"{where}: is {given!r}, must be a text or a list of words")
    try:
        return shlex.split(given or "")
    except ValueError as error:
        raise StudyError(f"{where}: {error}") from error


def _environment(where: str, given: Any, environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of a table or a list of NAME=value; one without a value is passed on."""
    if isinstance(given, list):
        pairs = (str(entry).partition("=") for entry in given)
        given = {name: value if equals else None for name, equals, value in pairs}
    if not isinstance(given, dict | None):
        raise StudyError(f"{where}: is {given!r}, must be a table")
    values = {name: environment.get(name) if value is None else value for name, value in (given or {}).items()}
    return {name: str(value) for name, value in values.items() if value is not None}


def _list(where: str, given: Any) -> list[Any]:
    if not isinstance(given, list | None):
        raise StudyError(f"{where}: is {given!r}, must be a list")
    return given or []


def _volumes(where: str, given: Any, folder: Path) -> dict[str, str]:
    return dict(_mount(where, entry, folder) for entry in _list(where, given))


def _mount(where: str, entry: Any, folder: Path) -> tuple[str, str]:
    """Return path in the container and source of `source:target[:ro]` or {source: ..., target: ...}."""
    if isinstance(entry, dict):
        source, target = str(entry.get("source", "")), str(entry.get("target", ""))
    else:
        source, _, rest = str(entry).partition(":")
        target = rest.partition(":")[0]
    if not source or not target.startswith("/"):
        raise StudyError(f"{where}: {entry!r} must be source:/path/in/the/container")
    if source.startswith(("/", ".", "~")):
        source = os.path.normpath(folder / Path(source).expanduser())
    elif not NAMED_VOLUME.fullmatch(source):
        raise StudyError(f"{where}: {source!r} is neither the name of a volume nor a path that begins with ./ or /")
    return target.rstrip("/"), source


def _filled(where: Any, value: Any, environment: Mapping[str, str]) -> Any:
    """Return a value with `${NAME}` and `${NAME:-default}` replaced in every text of it, and `$$` by `$`."""

    def one(found: re.Match[str]) -> str:
        if found["dollar"]:
            return "$"
        name = found["braced"] or found["plain"]
        if not name:
            raise StudyError(f"{where}: {value!r}: write ${{NAME}}, ${{NAME:-default}}, or $$ for a dollar sign")
        return environment.get(name) or found["default"] or ""

    if isinstance(value, dict):
        return {key: _filled(f"{where}: {key}", entry, environment) for key, entry in value.items()}
    if isinstance(value, list):
        return [_filled(where, entry, environment) for entry in value]
    return VARIABLE.sub(one, value) if isinstance(value, str) else value
