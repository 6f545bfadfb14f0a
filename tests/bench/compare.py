"""The same benches at an earlier revision and now, one right after the other: docs/benchmarks-compared.md.

    .venv/bin/python tests/bench/compare.py REV [NAME ...] [--times 2] [--by-this-bench]

The speed of a machine changes from hour to hour, so a number of last week says little beside one of today: here both
are measured within minutes. What the earlier revision's sources need is this environment, message definitions too.
A bench that itself has changed since (other seeds, another statistic) compares nothing: with `--by-this-bench` the
earlier sources, too, are measured by the bench of now, where they still have what it asks for.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import benchmark_pages
from benchmark_pages import machine
from run import BENCH, RESULTS, rows_of

ROOT = BENCH.parents[1]
REPORT = ROOT / "docs" / "benchmarks-compared.md"
COMPARED = RESULTS / "compared"
ONE_BENCH = " *"
HEAD = ["| bench | what | target | before | now | day |", "|---|---|---|---|---|---|"]


class Tree(NamedTuple):
    """Sources to be measured, and the folder of the benches that measure them."""

    root: Path
    bench: Path

    @property
    def names(self) -> set[str]:
        """Of its benches."""
        return {path.stem.removeprefix("bench_") for path in self.bench.glob("bench_*.py")}

    def rows(self, name: str) -> list[dict[str, Any]] | None:
        """Run a bench; None where it crashes."""
        folders = [*self.root.glob("interfaces/*/src"), *self.root.glob("services/*/src"), self.bench.parent]
        return rows_of(self.bench, name, {"PYTHONPATH": os.pathsep.join(map(str, folders))})


def main() -> int:
    """Measure what was asked for, then write the report of everything compared with that revision; 1 after a crash."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("revision", help="of git, to compare with")
    parser.add_argument(
        "only", nargs="*", metavar="NAME", help="names of benches; all that both have where none is given"
    )
    parser.add_argument("--times", type=int, default=1, help="how often each is run, in turns")
    parser.add_argument("--by-this-bench", action="store_true", help="measure the earlier sources by the bench of now")
    asked = parser.parse_args()
    revision = _git("rev-parse", "--short=8", f"{asked.revision}^{{commit}}")
    kept = COMPARED / revision
    kept.mkdir(parents=True, exist_ok=True)
    with checked_out(revision) as tree:
        now = Tree(ROOT, BENCH)
        before = Tree(tree, BENCH if asked.by_this_bench else tree / "tests" / "bench")
        both = before.names & now.names
        if unknown := sorted(set(asked.only) - both):
            parser.error(f"not a bench of both revisions: {', '.join(unknown)}; there are {', '.join(sorted(both))}")
        crashed = [name for name in asked.only or sorted(both) if not compared(name, before, now, asked.times, kept)]
    REPORT.write_text(report(revision, both, kept, REPORT.read_text()))
    print(f"written: {REPORT.relative_to(ROOT)}")
    return 1 if crashed else 0


def compared(name: str, before: Tree, now: Tree, times: int, kept: Path) -> bool:
    """Run a bench of both in turns and keep its rows; False where it crashed."""
    print(f"{name} ...", flush=True)
    turns = [(before.rows(name), now.rows(name)) for _ in range(times)]
    if any(rows is None for turn in turns for rows in turn):
        print(f"bench_{name} crashed", file=sys.stderr)
        return False
    one_bench = before.bench == now.bench
    found = {"at": f"{datetime.now(UTC):%F}", "by_this_bench": one_bench, "turns": turns}
    (kept / f"{name}.json").write_text(json.dumps(found))
    return True


@contextmanager
def checked_out(revision: str) -> Iterator[Path]:
    """The sources of a revision in a folder of their own, beside the recordings that the benches look for."""
    folder = RESULTS / "before"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if (data := ROOT.parent / "shared").is_dir():
        (folder / "shared").symlink_to(data)
    tree = folder / "tree"
    tree.mkdir()
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout
    subprocess.run(["tar", "--extract", "--directory", tree], input=archive, check=True)
    (tree / ".venv").symlink_to(ROOT / ".venv")
    try:
        yield tree
    finally:
        shutil.rmtree(folder)


def report(revision: str, both: set[str], kept: Path, before: str) -> str:
    """Return docs/benchmarks-compared.md: what was compared here, of all others what stood there before.

    both: names of the benches that both revisions have.
    """
    first = f"Before: {revision} ("
    known = benchmark_pages.known(before) if f"\n{first}" in before else {}
    for path in sorted(kept.glob("*.json")):
        name, found = path.stem, json.loads(path.read_text())
        known.pop(name, None)
        known.pop(name + ONE_BENCH, None)
        marked = name + ONE_BENCH * found["by_this_bench"]
        known[marked] = machine(), list(table(marked, found["turns"], found["at"]))
    subject = _git("show", "--no-patch", "--format=%as, %s", revision)
    lines = [
        "# Benchmarks, before and now",
        "",
        f"{first}{subject}). Both measured within minutes of each other, in turns set apart by `;`.",
        f"Command: `.venv/bin/python tests/bench/compare.py {revision} [NAME ...]`.",
        f"Where a name has{ONE_BENCH}, both were measured by the bench of now: with `--by-this-bench`.",
        *benchmark_pages.tables(HEAD, known),
    ]
    if missing := sorted(both - {name.removesuffix(ONE_BENCH) for name in known}):
        lines += ["", f"Not compared yet: {', '.join(missing)}."]
    return "\n".join(lines) + "\n"


def table(name: str, turns: list[list[list[dict[str, Any]]]], day: str) -> Iterator[str]:
    """One line for each row that every turn has at both revisions."""
    sides = [[{row["what"]: row for row in turn[side]} for turn in turns] for side in (0, 1)]
    for what, row in sides[1][0].items():
        if all(what in rows for side in sides for rows in side):
            before, now = (" ; ".join(rows[what]["measured"] for rows in side) for side in sides)
            yield benchmark_pages.row(name, what, row["target"], before, now, day)


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
