"""tests/bench: what a page of numbers keeps when one bench is measured anew."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))
import benchmark_pages
from benchmark_pages import known, machine, row, tables

ROOT = Path(__file__).resolve().parents[3]
HEAD = [row("bench", "what"), "|---|---|"]
PAGE = "\n".join(["# Numbers", "", "Of what.", *tables(HEAD, {"a": (machine(), [row("a", "1"), row("a", "2")])})])


def test_what_is_written_is_read():
    """Every row by its bench, none of the head's, of each machine its own."""
    rows = {"a *": (machine(), [row("a *", "1")]), "b": ("an abacus", [row("b", "2"), row("b", "3")])}
    assert known("\n".join(tables(HEAD, rows))) == rows


def test_a_bench_measured_on_another_machine_leaves_the_old_table(monkeypatch):
    """A bench stands once, under the machine that it ran on last; this machine's table is the first."""
    monkeypatch.setattr(benchmark_pages, "machine", lambda: "an abacus")
    lines = tables(HEAD, known(PAGE) | {"b": ("an abacus", [row("b", "3")])})
    assert lines[1] == "## an abacus"
    assert known("\n".join(lines)) == known(PAGE) | {"b": ("an abacus", [row("b", "3")])}


def test_the_pages_that_are_there_lose_no_row():
    """docs/benchmarks.md and docs/benchmarks-compared.md, read and written, have the rows they had."""
    for name in ("benchmarks.md", "benchmarks-compared.md"):
        page = (ROOT / "docs" / name).read_text()
        heads = [line for line in page.splitlines() if line.startswith("| bench | ")]
        lines = [line for line in page.splitlines() if line.startswith("| ") and line not in heads]
        assert sorted(line for _, rows in known(page).values() for line in rows) == sorted(lines)
        assert len(lines) > 50
