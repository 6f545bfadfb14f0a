"""The part of the Compose format that says what runs: `extends`, `${NAME:-default}`, command, environment, volumes,
and the tags `!override` and `!reset`, which replace what a service extends and leave it out.

Pure. Keys that change what runs and are not read here are refused, and so are keys that Compose does not know; all
others (restart, networks ...) matter to containers alone. Everything that is wrong is a StudyError, one sentence that
names the file and the key.
"""

import codecs
import difflib
import functools
import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import yaml
from compose_keys import SERVICE, TABLES, TOP

REFUSED = {
    "entrypoint": "write the whole command under `command`",
    "env_file": "write its lines under `environment`",
    "scale": "write one entry per process",
}
VARIABLE = re.compile(r"\$(?:(?P<dollar>\$)|\{(?P<braced>\w+)(?::-(?P<default>[^}$]*))?\}|(?P<plain>\w+)|)")
TEXTS = re.compile(r"(?:(?i:yes|no|on|off)|=|[-+]?\d[\d_]*(?::[0-5]?\d)+(?:\.[\d_]*)?)$")
"""What is no text in YAML 1.1 alone."""
RESET = object()
"""Stands for what has the tag `!reset`."""
Keys = tuple[str, ...]
NAMED_VOLUME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


class StudyError(Exception):
    """A study file that cannot be used: a sentence that names the file and the key."""


class _Tagged(NamedTuple):
    """A value that has one of Compose's tags."""

    value: Any


class _Loader(yaml.SafeLoader):
    """Refuses a key that is given twice or is no text, as Compose does, and takes the same words for texts."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {
        sign: [("tag:yaml.org,2002:str", TEXTS), *others]
        for sign, others in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.composer.ComposerError(None, None, "a key must be a text", key.start_mark)
            if key.value in seen:
                raise yaml.composer.ComposerError(None, None, f"the key {key.value!r} is there twice", key.start_mark)
            seen.add(key.value)
        return node


def _override(loader: _Loader, node: Any) -> _Tagged:
    tag = loader.resolve(type(node), node.value, (getattr(node, "style", None) is None, True))
    return _Tagged(loader.construct_object(type(node)(tag, node.value, node.start_mark, node.end_mark), deep=True))


_Loader.add_constructor("!override", _override)
_Loader.add_constructor("!reset", lambda loader, node: _Tagged(RESET))


@functools.lru_cache(maxsize=8)
def _parsed(text: str) -> tuple[Any, frozenset[Keys]]:
    """Return the content without Compose's tags, and the keys that lead to each of them."""
    tagged: set[Keys] = set()
    return _untagged(yaml.load(text, _Loader), (), tagged), frozenset(tagged)


def _untagged(value: Any, keys: Keys, tagged: set[Keys]) -> Any:
    if isinstance(value, _Tagged):
        tagged.add(keys)
        value = value.value
    if isinstance(value, list):
        entries = [_untagged(entry, (*keys, str(number)), tagged) for number, entry in enumerate(value)]
        return [entry for entry in entries if entry is not RESET]
    if isinstance(value, dict):
        table = {key: _untagged(entry, (*keys, str(key)), tagged) for key, entry in value.items()}
        return {key: entry for key, entry in table.items() if entry is not RESET}
    return value


def load(file: Path, environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the content of a compose file with its variables filled in; it is to be read only.

    A study reads the file that its services extend once for each of them.
    """
    return _content(file, text_of(str(file), file), tuple(environment.items()))


@functools.lru_cache(maxsize=8)
def _content(file: Path, text: str, environment: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    try:
        content, _ = _parsed(text)
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise StudyError(f"{file} has a character that no text has, {error.character:#04x}, in line {line}") from error
    except yaml.YAMLError as error:
        raise StudyError(f"{file} is no YAML: {said(error)}") from error
    except RecursionError as error:
        raise StudyError(f"{file}: an anchor holds itself") from error
    services = content.get("services") if isinstance(content, dict) else None
    if not isinstance(services, dict):
        raise StudyError(f"{file}: services: must be a table of services, each with its keys")
    for name, entry in services.items():
        if not isinstance(name, str):
            raise StudyError(f"{file}: services.{name}: the name {name!r} must be a text: put it in quotes")
        if not isinstance(entry, dict):
            raise StudyError(f"{file}: services.{name}: is {entry!r}, must be a table of its keys")
    _check_top(file, content)
    if "include" in content:
        raise StudyError(f"{file}: include: is not read outside of containers; name each service, with `extends`")
    variables = dict(environment)
    return {key: _filled(f"{file}: {key}", entry, variables) for key, entry in content.items()}


def said(error: yaml.YAMLError) -> str:
    """Return what YAML says of a text in one line, without its own word for where the text is from."""
    return " ".join(str(error).replace('"<unicode string>", ', "").split())


def text_of(where: str, file: Path) -> str:
    """Return the text of a file. where: begins the StudyError of one that cannot be read, or is not in UTF-8."""
    try:
        return file.read_text("utf-8")
    except OSError as error:
        raise StudyError(f"{where} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        is_utf_16 = error.object.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        line = error.object.count(b"\n", 0, error.start) + 1
        told = f"{'is in UTF-16' if is_utf_16 else 'is not in UTF-8'}, line {line}: save it as UTF-8"
        raise StudyError(f"{where} {told}") from error


def near(name: str, known: Iterable[str], alike: float = 0.6) -> str:
    """Return the known name that is most like this one as `; did you mean X?`, "" where none is so much alike."""
    found = difflib.get_close_matches(name, known, 1, alike)
    return f"; did you mean {found[0]}?" if found else ""


def _check_top(file: Path, content: Mapping[Any, Any]) -> None:
    for key in map(str, content):
        if key not in TOP and not key.startswith("x-"):
            raise StudyError(f"{file}: {key}: there is no such key in a study file{near(key, [*TOP, 'x-study'])}")
    for key in TABLES:
        if not isinstance(given := content.get(key), dict | None):
            raise StudyError(f"{file}: {key}: is {given!r}, must be a table")


def service(file: Path, name: str, environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the keys below of one service, with what it extends. Raises StudyError.

    `command` and `x-process` as words; `environment`; `working_dir`; `volumes`: path in the container -> absolute path
    on this machine, or name of a volume; `read_only`: those paths in the container that are only read; `image`; `ports`
    and `devices` as they stand there; `profiles`; `x-host`; `mem_limit` and `cpus`, here or under `deploy`, as
    texts.
    """
    return _service(file, name, environment, ())


def _service(file: Path, name: str, environment: Mapping[str, str], above: tuple[Any, ...]) -> dict[str, Any]:
    where = f"{file}: services.{name}"
    given = load(file, environment)["services"].get(name)
    if given is None:
        raise StudyError(f"{where}: there is no such service")
    if (file, name) in above:
        raise StudyError(f"{where}.extends: it extends itself")
    _check_keys(where, given)
    base = _extended(where, file, given, environment, (*above, (file, name)))
    for key, *inner in _replaced(file, name):
        if key in base:
            base[key] = _without(base[key], inner)
    variables = base["environment"] | _environment(f"{where}.environment", given.get("environment"), environment)
    mounts = [
        _mount(f"{where}.volumes", entry, file.parent) for entry in _list(f"{where}.volumes", given.get("volumes"))
    ]
    own_words = {key: _words(f"{where}.{key}", given[key]) for key in ("command", "x-process") if key in given}
    return {
        **base,
        **own_words,
        "environment": {name: text for name, text in variables.items() if text is not None},
        "volumes": base["volumes"] | {target: source for target, source, _ in mounts},
        "read_only": base["read_only"] - {mount[0] for mount in mounts} | {target for target, _, ro in mounts if ro},
        "mem_limit": str(given.get("mem_limit", _limit(given.get("deploy"), "memory") or base["mem_limit"])),
        "cpus": str(given.get("cpus", _limit(given.get("deploy"), "cpus") or base["cpus"])),
        "profiles": _list(f"{where}.profiles", given.get("profiles", base["profiles"])),
        **{key: _text(f"{where}.{key}", given.get(key, base[key])) for key in ("working_dir", "image", "x-host")},
        **{key: _further(base[key], _list(f"{where}.{key}", given.get(key))) for key in ("ports", "devices")},
    }


def _further(base: list[Any], own: list[Any]) -> list[Any]:
    """Return the entries of a base and those that a service adds to them."""
    return [*base, *(entry for entry in own if entry not in base)]


def _replaced(file: Path, name: str) -> Iterator[Keys]:
    """Yield the keys of a service that have one of Compose's tags."""
    _, tagged = _parsed(file.read_text("utf-8"))
    return (keys[2:] for keys in tagged if keys[:2] == ("services", name) and keys[2:])


def _without(base: Any, inner: list[str]) -> Any:
    """Return what is extended without the entry of the first of these keys; nothing of it where there are none."""
    if not inner:
        return type(base)()
    return {key: entry for key, entry in base.items() if key != inner[0]} if isinstance(base, dict) else base


def _check_keys(where: str, given: Mapping[str, Any]) -> None:
    """Raise StudyError for a key that is refused, or that Compose does not know."""
    for key in map(str, given):
        if key in REFUSED:
            raise StudyError(f"{where}.{key}: is not read outside of containers; {REFUSED[key]}")
        if key not in SERVICE and not key.startswith("x-"):
            raise StudyError(f"{where}.{key}: there is no such key{near(key, SERVICE)}")


def _extended(
    where: str, file: Path, given: Mapping[str, Any], environment: Mapping[str, str], above: tuple[Any, ...]
) -> dict[str, Any]:
    """Return what a service extends, an empty service where it extends nothing."""
    extends = given.get("extends")
    if extends is None:
        tables: dict[str, Any] = {"environment": {}, "volumes": {}, "read_only": set()}
        lists: dict[str, Any] = {"command": [], "x-process": [], "profiles": [], "ports": [], "devices": []}
        return tables | lists | {"working_dir": "", "image": "", "x-host": "", "mem_limit": "", "cpus": ""}
    if isinstance(extends, str):
        extends = {"service": extends}
    known_keys = isinstance(extends, dict) and "service" in extends and not extends.keys() - {"file", "service"}
    if not known_keys or not isinstance(extends.get("file", ""), str):
        raise StudyError(f"{where}.extends: is {extends!r}, must be {{file: ..., service: ...}}")
    of, name = (file.parent / extends["file"]).resolve() if "file" in extends else file, str(extends["service"])
    if not os.path.isfile(of):
        raise StudyError(f"{where}.extends: {extends['file']} cannot be read: No such file")
    known = load(of, environment)["services"]
    if name not in known:
        raise StudyError(f"{where}.extends: {of.name} has no service {name!r}{near(name, known)}")
    return _service(of, name, environment, above)


def _text(where: str, given: Any) -> str:
    if not isinstance(given, str):
        raise StudyError(f"{where}: is {given!r}, must be a text")
    return given


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


def _environment(where: str, given: Any, environment: Mapping[str, str]) -> dict[str, str | None]:
    """Return the variables of a table or a list of NAME=value; without a value it is this machine's, None = not set."""
    if isinstance(given, list):
        pairs = (str(entry).partition("=") for entry in given)
        given = {name: value if equals else None for name, equals, value in pairs}
    if not isinstance(given, dict | None):
        raise StudyError(f"{where}: is {given!r}, must be a table")
    for name, value in (given or {}).items():
        if not name or not isinstance(value, str | int | float | None):
            raise StudyError(f"{where}: {name!r} is {value!r}: a variable has a name, and a text or a number")
    values = {name: environment.get(name) if value is None else value for name, value in (given or {}).items()}
    texts = {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in values.items()}
    return texts | {name: None for name, value in values.items() if value is None}


def _list(where: str, given: Any) -> list[Any]:
    if not isinstance(given, list | None):
        raise StudyError(f"{where}: is {given!r}, must be a list")
    return given or []


def _limit(deploy: Any, what: str) -> str:
    """Return the limit of memory or cpus that is given under `deploy`, "" where there is none."""
    for key in ("resources", "limits", what):
        deploy = deploy.get(key) if isinstance(deploy, dict) else None
    return str(deploy or "")


def _mount(where: str, entry: Any, folder: Path) -> tuple[str, str, bool]:
    """Return path in the container, source, and whether it is only read, of an entry of `volumes`.

    It is `source:target[:ro]` or {source: ..., target: ..., read_only: ...}.
    """
    if isinstance(entry, dict):
        source, target = str(entry.get("source", "")), str(entry.get("target", ""))
        read_only = entry.get("read_only") is True
    else:
        source, _, rest = str(entry).partition(":")
        target, _, options = rest.partition(":")
        read_only = "ro" in options.split(",")
    if not source or not target.startswith("/"):
        raise StudyError(f"{where}: {entry!r} must be source:/path/in/the/container")
    if source.startswith(("/", ".", "~")):
        source = os.path.normpath(folder / Path(source).expanduser())
    elif not NAMED_VOLUME.fullmatch(source):
        raise StudyError(f"{where}: {source!r} is neither the name of a volume nor a path that begins with ./ or /")
    return target.rstrip("/"), source, read_only


def _filled(where: str, value: Any, environment: Mapping[str, str]) -> Any:
    """Return a value with `${NAME}` and `${NAME:-default}` replaced in every text of it, and `$$` by `$`."""

    def one(found: re.Match[str]) -> str:
        if found["dollar"]:
            return "$"
        name = found["braced"] or found["plain"]
        if not name:
            raise StudyError(f"{where}: {value!r}: write ${{NAME}}, ${{NAME:-default}}, or $$ for a dollar sign")
        return environment.get(name) or found["default"] or ""

    if isinstance(value, dict):
        return {key: _filled(f"{where}.{key}", entry, environment) for key, entry in value.items()}
    if isinstance(value, list):
        return [_filled(where, entry, environment) for entry in value]
    return VARIABLE.sub(one, value) if isinstance(value, str) else value
