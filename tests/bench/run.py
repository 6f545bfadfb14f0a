"""`make bench`: measures every number the project promises and writes docs/benchmarks.md.

Each `bench_*.py` here has `rows()`, a list of {what, target, measured, ok}; ok is None for a figure without a target.
Numbers, never pass or fail on time: the exit status is 0 unless a bench crashes.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import benchmark_pages
from benchmark_pages import machine

BENCH = Path(__file__).resolve().parent
REPORT = BENCH.parents[1] / "docs" / "benchmarks.md"
RESULTS = BENCH.parents[1] / "build" / "bench"
ASK = "import json, sys, importlib; sys.stdout.write('\\n' + json.dumps(importlib.import_module(sys.argv[1]).rows()))"
HEAD = ["| bench | what | target | measured | |", "|---|---|---|---|---|"]
MARKS = {True: "met", False: "**missed**", None: ""}


def main() -> int:
    """Run what was asked for, then write the report from the newest result of every bench."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    names = [path.stem.removeprefix("bench_") for path in sorted(BENCH.glob("bench_*.py"))]
    parser.add_argument("only", nargs="*", choices=[[], *names], help="names of benches; all where none is given")
    chosen = parser.parse_args().only or names
    RESULTS.mkdir(parents=True, exist_ok=True)
    crashed = [name for name in chosen if not measure(name)]
    REPORT.write_text(report(names, REPORT.read_text()))
    print(f"written: {REPORT.relative_to(BENCH.parents[1])}")
    for name in crashed:
        print(f"bench_{name} crashed", file=sys.stderr)
    return 1 if crashed else 0


def measure(name: str) -> bool:
    """Run one bench in a process of its own and keep its rows; False where it crashed."""
    print(f"{name} ...", flush=True)
    begun = time.monotonic()
    rows = rows_of(BENCH, name, {})
    if rows is None:
        return False
    took_s = time.monotonic() - begun
    (RESULTS / f"{name}.json").write_text(json.dumps({"took_s": took_s, "at": f"{datetime.now(UTC):%F}", "rows": rows}))
    for row in rows:
        print(f"  {row['what']}: {row['measured']} (target {row['target']}) {MARKS[row['ok']]}", flush=True)
    return True


def rows_of(folder: Path, name: str, env: dict[str, str]) -> list[dict[str, Any]] | None:
    """Return the rows of a bench of that folder, run in a process of its own; None where it crashed."""
    env = os.environ | {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"} | env
    command = [sys.executable, "-c", ASK, f"bench_{name}"]
    done = subprocess.run(command, cwd=folder, env=env, stdout=subprocess.PIPE, text=True, check=False)
    return None if done.returncode else list(json.loads(done.stdout.rpartition("\n")[2]))


def report(names: list[str], before: str) -> str:
    """Return docs/benchmarks.md: of every bench measured here the newest result, of the others what stood there."""
    known = benchmark_pages.known(before)
    for name in names:
        if (file := RESULTS / f"{name}.json").exists():
            known[name] = machine(), [table_row(name, row) for row in json.loads(file.read_text())["rows"]]
    lines = ["# Benchmarks", "", "Command: `make bench`, or one alone: `.venv/bin/python tests/bench/run.py NAME`."]
    lines += benchmark_pages.tables(HEAD, known)
    if missing := [name for name in names if name not in known]:
        lines += ["", f"Not run yet: {', '.join(missing)}."]
    return "\n".join(lines) + "\n"


def table_row(name: str, row: dict[str, Any]) -> str:
    return benchmark_pages.row(name, row["what"], row["target"], row["measured"], MARKS[row["ok"]])


if __name__ == "__main__":
    sys.exit(main())
