"""What the comments of a message's definition say of the columns that `tables.flatten` makes of it."""

from __future__ import annotations

import re
from typing import NamedTuple

from sense4hri_session.tables import column

TIME = "builtin_interfaces/Time"
DEEPEST = 8  # messages within messages
_SPLIT = re.compile(r"^=+\nMSG: (\S+)\n", re.MULTILINE)
_FIELD = re.compile(r"^\s*([\w/]+)(?:<=\d+)?(\[[^\]]*\])?\s+(\w+)\s*(?:#\s*(.*))?$")
_ONE = r"(?:1e-6|1|%|[mun]?s|min|[mu]?V|uS|k?Hz|bits?|deg[C]?|m?m|px|dBm|rad|unit)(?:\^?\d)?"
_UNIT = re.compile(rf"{_ONE}(?:[ /]{_ONE})*")


class About(NamedTuple):
    """A column. unit: as the comment begins, empty where it names none; is_time: ns."""

    unit: str
    text: str
    is_time: bool = False


def columns(definition: str, type_name: str) -> dict[str, About]:
    """Columns by name of a message of this type (`package/msg/Name`), nested messages among them."""
    main, *rest = _SPLIT.split(definition)
    texts = {name.replace("/msg/", "/"): text for name, text in zip(rest[::2], rest[1::2], strict=True)}
    return _of(main, type_name.split("/")[0], texts, "", 0)


def unit_of(comment: str) -> str:
    """The unit with which a comment begins: `uS/min; linear trend` gives `uS/min`, `0..1; share` none."""
    head = re.split(r"[;,]| of ", comment)[0].strip()
    return head if _UNIT.fullmatch(head) else ""


def _of(text: str, package: str, texts: dict[str, str], prefix: str, depth: int) -> dict[str, About]:
    found: dict[str, About] = {}
    listed: dict[str, About] = {}  # of messages in an array, which some tables have in rows of their own
    for line in text.splitlines():
        match = _FIELD.match(line) if "=" not in line.split("#")[0] else None
        if match is None:
            continue
        kind, array, name, comment = match[1], match[2], match[3], match[4] or ""
        nested = next((full for full in (kind, f"{package}/{kind}") if full in texts), "")
        if nested == TIME:
            found[column(f"{prefix}{name}" if array else f"{prefix}{name}_ns")] = About("ns", comment, True)
            continue
        inner = (
            {}
            if not nested or depth > DEEPEST
            else _of(texts[nested], nested.split("/")[0], texts, "" if array else f"{prefix}{name}_", depth + 1)
        )
        if array or not nested:
            found[column(f"{prefix}{name}")] = About(unit_of(comment), comment)
        (listed if array else found).update(inner)
    return listed | found
