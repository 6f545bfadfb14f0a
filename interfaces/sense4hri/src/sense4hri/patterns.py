"""Which topics are meant: globs over topic names."""

import re
from collections.abc import Iterable


class Patterns:
    """`*` and `?` stay between two slashes, a part that is `**` is any number of parts, also none."""

    def __init__(self, globs: Iterable[str]) -> None:
        self._expressions = [re.compile(_expression(glob)) for glob in globs]

    def match(self, topic: str) -> bool:
        """True where any of the globs covers the whole topic name."""
        return any(expression.fullmatch(topic) for expression in self._expressions)


def _expression(glob: str) -> str:
    out = ""
    for part in glob.strip("/").split("/"):
        if part == "**":
            out += "(/[^/]+)*"
        else:
            out += "/" + re.escape(part).replace(r"\*\*", "[^/]*").replace(r"\*", "[^/]*").replace(r"\?", "[^/]")
    return out
