"""The table of docs/metrics.md, made from what services export, and what it lacks.

    python tests/metrics_table.py LOGS ...

LOGS: folders with logs of a running study (`make demo` names its own). Every service that says in them on which port it
shows its metrics is asked, and its rows are written again. Those of services that do not run stay, and those with the
label `field`, which are there once something has happened.
"""

from __future__ import annotations

import re
import sys
import urllib.request
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from prometheus_client.parser import text_string_to_metric_families

PAGE = Path(__file__).resolve().parents[1] / "docs" / "metrics.md"
HEAD = "| metric | kind | labels beside `service` | of | meaning |\n|---|---|---|---|---|\n"
PORT = re.compile(r"shows its metrics on port (\d+)")
PREFIX = "sense4hri_"
EVERY = ("every service",)
EVERYWHERE = {"recorder", "web_gui", "interpreter"}
"""What these have, all have: it is the kit's."""


class Row(NamedTuple):
    """One metric. services: who exports it, sorted; drivers are one, and so are interpreters."""

    name: str
    kind: str
    labels: tuple[str, ...]
    services: tuple[str, ...]
    meaning: str

    def line(self) -> str:
        """As it stands in the page."""
        labels = ", ".join(self.labels)
        return f"| `{self.name}` | {self.kind} | {labels} | {', '.join(self.services)} | {self.meaning} |"


def rows_of(text: str) -> Iterator[Row]:
    """Those of one service's `/metrics`."""
    for family in text_string_to_metric_families(text):
        if not family.name.startswith(PREFIX) or not family.samples:
            continue
        labels = {label for sample in family.samples for label in sample.labels} - {"service", "le"}
        service = re.sub(r"^(driver|interpreter)_.*", r"\1", family.samples[0].labels["service"])
        name = family.name + ("_total" if family.type == "counter" else "")
        yield Row(name, family.type, tuple(sorted(labels)), (service,), family.documentation)


def merged(rows: Iterable[Row]) -> list[Row]:
    """One row for each name, kind, labels and meaning, by name, with all services of it."""
    services: dict[Row, set[str]] = {}
    for row in rows:
        services.setdefault(row._replace(services=()), set()).update(row.services)
    return sorted(row._replace(services=_told(of)) for row, of in services.items())


def _told(services: set[str]) -> tuple[str, ...]:
    return EVERY if services >= EVERYWHERE or {*EVERY} <= services else tuple(sorted(services))


def ports(folder: Path) -> list[int]:
    """Of the processes that have written their logs into a folder."""
    return [int(port) for log in sorted(folder.glob("*.log")) for port in PORT.findall(log.read_text(errors="replace"))]


def scraped(folder: Path) -> list[Row]:
    """What the services of a running study export."""
    texts = []
    for port in ports(folder):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as answer:
            texts.append(answer.read().decode())
    return merged(row for text in texts for row in rows_of(text))


def written() -> list[Row]:
    """The rows of the page."""
    cells = [[cell.strip() for cell in line.strip("| \n").split(" | ")] for line in PAGE.read_text().splitlines()]
    found = []
    for each in cells:
        if len(each) == 5 and each[0].startswith(f"`{PREFIX}"):
            name, kind, labels, services, meaning = each
            found.append(Row(name.strip("`"), kind, _words(labels), _words(services), meaning))
    return found


def _words(cell: str) -> tuple[str, ...]:
    return tuple(cell.split(", ")) if cell else ()


def lacking(found: Iterable[Row], page: Iterable[Row]) -> list[str]:
    """Lines: what is exported and stands nowhere, or otherwise, in the page."""
    services = {row._replace(services=()): set(row.services) for row in page}

    def there(row: Row) -> bool:
        of = services.get(row._replace(services=()), set())
        return {*row.services} <= of or {*EVERY} <= of

    return [row.line() for row in found if not there(row)]


def main() -> int:
    """Write the page's table again."""
    found = merged([row for folder in sys.argv[1:] for row in scraped(Path(folder))])
    running = {service for row in found for service in row.services}
    page = written()
    kept = [row._replace(services=left) for row in page if (left := tuple({*row.services} - running - {*EVERY}))]
    kept += [row for row in page if "field" in row.labels]
    head, _, _ = PAGE.read_text().partition(HEAD)
    PAGE.write_text(head + HEAD + "".join(row.line() + "\n" for row in merged([*found, *kept])))
    print(f"{PAGE}: {len(found)} metrics of {len(running)} services")
    return 0


if __name__ == "__main__":
    sys.exit(main())
