"""docs/benchmarks.md and docs/benchmarks-compared.md: a table of rows per machine, kept but for what is measured anew.

Numbers of different machines are not to be compared.
"""

import os
import platform
from collections.abc import Iterator, Sequence
from pathlib import Path

MACHINE = "## "
Known = dict[str, tuple[str, list[str]]]
"""By name of the bench: the machine it ran on last, and its rows."""


def known(page: str) -> Known:
    """Return what a page says: of each bench the rows of the last table that has it."""
    found: Known = {}
    for where, name, line in _rows(page):
        if name not in found or found[name][0] != where:
            found[name] = where, []
        found[name][1].append(line)
    return found


def tables(head: Sequence[str], rows: Known) -> list[str]:
    """Return the lines of a page: this machine's table first. head: the two lines that a table begins with."""
    lines = []
    places = dict.fromkeys(where for where, _ in rows.values())
    for where in sorted(places, key=lambda place: place != machine()):
        lines += ["", MACHINE + where, "", *head]
        lines += [line for name in sorted(rows) if rows[name][0] == where for line in rows[name][1]]
    return lines


def row(*cells: str) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(cells)} |"


def machine() -> str:
    """Return what the numbers were measured on."""
    model = next(
        (line.partition(": ")[2] for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line),
        platform.machine(),
    )
    memory_gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{os.cpu_count()} cores ({model}), {memory_gib:.0f} GiB, Python {platform.python_version()}"


def _rows(page: str) -> Iterator[tuple[str, str, str]]:
    """Yield machine, bench and line of every row; the first line of a table is its head."""
    where, before = "", ""
    for line in page.splitlines():
        if line.startswith(MACHINE):
            where = line.removeprefix(MACHINE)
        elif line.startswith("| ") and before.startswith("|"):
            yield where, line.removeprefix("| ").split(" | ")[0], line
        before = line
