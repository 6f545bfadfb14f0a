"""From the name of a message type to its Python class, without running anybody else's code. Pure."""

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
    match = _NAME.fullmatch(type_name)
    if match is None or not any(_holds(prefix, match[1], match[2]) for prefix in _prefixes()):
        return None
    found: type | None = getattr(import_module(f"{match[1]}.msg"), match[2], None)
    return found


def type_name(message: type) -> str:
    """Return the name of a message class: the inverse of `message_class`."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def _holds(prefix: Path, package: str, name: str) -> bool:
    if not (prefix / "share" / package / "msg" / f"{name}.msg").is_file():
        return False
    spec = find_spec(package)
    places = spec.submodule_search_locations if spec is not None else None
    return any(Path(place).is_relative_to(prefix) for place in places or ())


def _prefixes() -> list[Path]:
    named = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) for prefix in (*filter(None, named), sys.prefix)]
