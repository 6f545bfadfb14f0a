"""Names of files and labels for whatever a stream or topic is called."""

from __future__ import annotations

import re

MOST = 150  # characters; file systems take 255 bytes


class Names:
    """Gives every text a name of its own, also where small and capital letters are the same file.

    unwanted: characters that a name must not hold. between: stands for a run of them.
    """

    def __init__(self, unwanted: str = r"[^\w-]+", between: str = "_") -> None:
        self._unwanted, self._between = re.compile(unwanted, re.ASCII), between
        self._names: dict[str, str] = {}
        self._taken: set[str] = set()

    def of(self, text: str) -> str:
        """The name of a text, the same each time."""
        if text not in self._names:
            start = self._unwanted.sub(self._between, text)[:MOST].strip("_-") or "unnamed"
            name, number = start, 1
            while name.casefold() in self._taken:
                number += 1
                name = f"{start}{self._between}{number}"
            self._taken.add(name.casefold())
            self._names[text] = name
        return self._names[text]
