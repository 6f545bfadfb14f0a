"""What was found: departures from the contract by its section, and remarks, each sentence once with its count."""

from collections import Counter
from typing import NamedTuple


class Finding(NamedTuple):
    """section: of interfaces/CONTRACT.md; 0 for a remark, which is no departure. times: how often it was seen."""

    section: int
    where: str
    what: str
    times: int

    def line(self) -> str:
        """As it is printed."""
        kind = f"section {self.section}" if self.section else "remark"
        often = f" ({self.times} times)" if self.times > 1 else ""
        return f"{kind}: {self.where}: {self.what}{often}"


class Findings:
    """Gathers them in the order in which they are first seen."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[int, str, str]] = Counter()

    def wrong(self, section: int, where: str, what: str) -> None:
        """The driver departs from this section of the contract."""
        self._counts[section, where, what] += 1

    def remark(self, where: str, what: str) -> None:
        """Worth knowing, and allowed."""
        self._counts[0, where, what] += 1

    def departures(self) -> list[Finding]:
        """By section."""
        return sorted(each for each in self._all() if each.section)

    def remarks(self) -> list[Finding]:
        """In order of appearance."""
        return [each for each in self._all() if not each.section]

    def _all(self) -> list[Finding]:
        return [Finding(*key, times) for key, times in self._counts.items()]
