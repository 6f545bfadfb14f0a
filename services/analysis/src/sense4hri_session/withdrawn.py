"""The account of a withdrawal: what was found of a pseudonym, what became of it, and what could not be decided."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from sense4hri_session.leftovers import REPORTS

MADE_ANEW = f"anew     {' and '.join(REPORTS)}"


@dataclass
class Withdrawn:
    """What was found of a pseudonym in one folder, and removed unless it was only looked for.

    now: where the folder is afterwards. removed, changed: messages by topic. files: what became of
    files. undecided: what stays because nothing tells whose it is.
    """

    folder: Path
    now: Path
    removed: Counter[str] = field(default_factory=Counter)
    changed: Counter[str] = field(default_factory=Counter)
    files: list[str] = field(default_factory=list)
    undecided: list[str] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.removed or self.changed or self.files or self.now != self.folder)

    def lines(self) -> Iterator[str]:
        """The account, a line each."""
        yield f"{self.folder}:"
        for topic, count in sorted(self.removed.items()):
            yield f"  removed  {count} messages of {topic}"
        for topic, count in sorted(self.changed.items()):
            yield f"  changed  {count} messages of {topic}: only what concerns the pseudonym is gone"
        yield from (f"  {line}" for line in self.files)
        if self.now != self.folder:
            yield f"  renamed  to {self.now}"
        yield from (f"  left     {line}" for line in self.undecided)
