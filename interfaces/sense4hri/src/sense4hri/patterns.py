"""Which topics are meant: globs over topic names, in a time that no glob can blow up. Pure.

`*` and `?` stay between two slashes, a part that is `**` is any number of parts, also none.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

from sense4hri.errors import Refusal

LONGEST, MOST = 256, 256
_Part = Callable[[str], object] | None
"""Says whether it covers one part of a topic name; None: `**`."""


class Patterns:
    """Any of several globs. Globs that somebody else wrote are `checked` where they come in."""

    def __init__(self, globs: Iterable[str]) -> None:
        self._globs = [_parts(glob) for glob in globs]

    def match(self, topic: str) -> bool:
        """True where any of the globs covers the whole topic name."""
        root, *parts = topic.split("/")
        return not root and any(_covers(glob, parts) for glob in self._globs)


def checked(globs: Sequence[str], what: str) -> tuple[str, ...]:
    """Return the globs. what: how they are called where they are refused.

    Raises Refusal, a ValueError, for more than MOST of them or one that is longer than LONGEST characters.
    """
    if len(globs) > MOST:
        raise Refusal(f"{what}: {len(globs)} globs, at most {MOST} are allowed", what)
    for glob in globs:
        if len(glob) > LONGEST:
            said = f"{what}: a glob of {len(glob)} characters, {glob[:20]!r}..; at most {LONGEST} are allowed"
            raise Refusal(said, what)
    return tuple(globs)


def _covers(glob: Sequence[_Part], parts: Sequence[str]) -> bool:
    """Where a part does not fit, the newest `**` takes one more; those before it never need a second look."""
    at = there = 0
    again: tuple[int, int] | None = None
    while there < len(parts):
        part = glob[at] if at < len(glob) else _nothing
        if part is None:
            at += 1
            again = at, there
        elif part(parts[there]):
            at, there = at + 1, there + 1
        elif again is not None:
            at, there = again = again[0], again[1] + 1
        else:
            return False
    return all(part is None for part in glob[at:])


@lru_cache(maxsize=1024)
def _parts(glob: str) -> tuple[_Part, ...]:
    found = [_part(text) for text in glob.strip("/").split("/")]
    return tuple(part for at, part in enumerate(found) if part is not None or at == 0 or found[at - 1] is not None)


def _part(glob: str) -> _Part:
    """Return whether a part is covered, matched without going back (`(?>`) behind a piece between two `*`."""
    if glob == "**":
        return None
    first, *others = (re.escape(piece).replace(r"\?", ".") for piece in re.split(r"\*+", glob))
    between = "".join(f"(?>.*?{piece})" for piece in others[:-1])
    return re.compile(first + between + "".join(f".*{piece}" for piece in others[-1:]), re.DOTALL).fullmatch


def _nothing(part: str) -> bool:
    """Cover no part: the glob has ended."""
    return False
