"""Full definitions of message types, as an MCAP channel needs them, from the `share` folders of the environment."""

import re
from functools import cache

from sense4hri.message_types import definition_file

_SEPARATOR = "=" * 80
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[a-zA-Z]")
_PRIMITIVE = frozenset(
    ["bool", "byte", "char", "float32", "float64", "string", "wstring"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)


class UnknownType(LookupError):
    """A message type whose definition is not installed here."""


@cache
def definition(name: str) -> str:
    """The text of type `pkg/msg/Name` followed by that of every type nested in it. Raises UnknownType, naming which."""
    texts = {name: _text(name)}
    waiting = [name]
    while waiting:
        package = waiting[0].split("/")[0]
        for nested in _nested(texts[waiting.pop(0)], package):
            if nested not in texts:
                texts[nested] = _text(nested)
                waiting.append(nested)
    parts = [texts.pop(name)]
    for nested, text in texts.items():
        package, short = nested.split("/")[0], nested.split("/")[-1]
        parts.append(f"{_SEPARATOR}\nMSG: {package}/{short}\n{text}")
    return "\n".join(parts)


@cache
def begins_with_header(name: str) -> bool:
    """True where the first field of the type is a std_msgs/Header."""
    first = next((line for line in _text(name).splitlines() if _FIELD.match(line.split("#")[0])), "")
    match = _FIELD.match(first)
    return match is not None and match[1] in ("std_msgs/Header", "std_msgs/msg/Header", "Header")


def _nested(text: str, package: str) -> list[str]:
    found = []
    for line in text.splitlines():
        match = _FIELD.match(line.split("#")[0])
        if match is None or match[1] in _PRIMITIVE:
            continue
        parts = match[1].split("/")
        home = parts[0] if len(parts) > 1 else "std_msgs" if parts[0] == "Header" else package
        found.append(f"{home}/msg/{parts[-1]}")
    return found


def _text(name: str) -> str:
    if (path := definition_file(name)) is None:
        raise UnknownType(f"{name}: no definition of this message type is installed here")
    return path.read_text("utf-8").rstrip() + "\n"
