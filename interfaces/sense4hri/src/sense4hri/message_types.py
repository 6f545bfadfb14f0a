"""From the name of a message type to its Python class or its definition, without running anybody else's code. Pure."""

import os
import re
import sys
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


@lru_cache(maxsize=1000)
def message_class(type_name: str) -> type | None:
    """Return the class of `package/msg/Name`; None where no such message is installed here.

    Names come from whoever publishes on the graph, so nothing is imported but a message package: it lies in one of
    the prefixes of this environment, with the definition of this very message in its `share` folder.
    """
    package, _, name = type_name.partition("/msg/")
    if not any(_imports_from(prefix, package) for prefix, _ in _installed(type_name)):
        return None
    found: type | None = getattr(import_module(f"{package}.msg"), name, None)
    return found


def definition_file(type_name: str) -> Path | None:
    """Return the `.msg` file of `package/msg/Name` in this environment; None where it is not installed here."""
    return next((path for _, path in _installed(type_name)), None)


def type_name(message: type) -> str:
    """Return the name of a message class: the inverse of `message_class`."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def _installed(type_name: str) -> list[tuple[Path, Path]]:
    """The prefixes in which this message is installed, and its file in each."""
    if (match := _NAME.fullmatch(type_name)) is None:
        return []
    files = [(prefix, prefix / "share" / match[1] / "msg" / f"{match[2]}.msg") for prefix in _prefixes()]
    return [(prefix, path) for prefix, path in files if path.is_file()]


def _imports_from(prefix: Path, package: str) -> bool:
    spec = find_spec(package)
    places = spec.submodule_search_locations if spec is not None else None
    return any(Path(place).is_relative_to(prefix) for place in places or ())


def _prefixes() -> list[Path]:
    named = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) for prefix in (*filter(None, named), sys.prefix)]
