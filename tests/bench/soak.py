"""`make soak`: the demo graph for a long time; memory, CPU and losses of every service, written to docs/soak.md.

python tests/bench/soak.py [--duration S]      (default 8 h)
"""

import argparse
import os
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from run import machine

ROOT = Path(__file__).resolve().parents[2]
REPORT = ROOT / "docs" / "soak.md"
SAMPLE_S = 10.0
SETTLED = 0.2  # share of the run after which memory should no longer grow


class Usage(NamedTuple):
    """One look at one process."""

    at_s: float
    rss_mib: float
    cpu_s: float


def main() -> int:
    """Run the demo, watch it, write the report; return the demo's exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, default=8 * 3600.0, metavar="S", help="seconds of streaming (8 h)")
    duration_s = parser.parse_args().duration
    command = [sys.executable, str(ROOT / "compose" / "demo.py"), "--port", "0", "--duration", str(duration_s)]
    command += ["--recordings", str(ROOT / "recordings" / "soak")]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    seen = watch(demo)
    output = demo.stdout.read() if demo.stdout is not None else ""
    print(output)
    REPORT.write_text(report(duration_s, output, seen))
    print(f"written: {REPORT.relative_to(ROOT)}")
    return demo.returncode


def watch(demo: "subprocess.Popen[str]") -> dict[str, list[Usage]]:
    """Look at the demo's children until it ends."""
    seen: dict[str, list[Usage]] = {}
    begun = time.monotonic()
    while True:
        for name, usage in children(demo.pid, time.monotonic() - begun):
            seen.setdefault(name, []).append(usage)
        try:
            demo.wait(SAMPLE_S)
        except subprocess.TimeoutExpired:
            continue
        return seen


def children(parent: int, at_s: float) -> list[tuple[str, Usage]]:
    """Return name and usage of every child process; the drivers, being alike, by their parameter file."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split() if folder.name.isdecimal() else []
            if not fields or int(fields[1]) != parent:
                continue
            words = (folder / "cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
        name = words[words.index("-m") + 1] if "-m" in words else words[0]
        name += f" {Path(words[words.index('--params-file') + 1]).stem}" if "--params-file" in words else ""
        cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        found.append((name, Usage(at_s, int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 2**20, cpu_s)))
    return found


def report(duration_s: float, output: str, seen: dict[str, list[Usage]]) -> str:
    """Return docs/soak.md."""
    lines = [
        "# Soak",
        "",
        f"{datetime.now(UTC):%F}, {machine()}: `make soak DURATION={duration_s:.0f}`.",
        "",
        f"| process | CPU, % of a core | MiB after {SETTLED:.0%} of the run | MiB at its end |",
        "|---|---|---|---|",
    ]
    for name, looks in sorted(seen.items()):
        span_s = looks[-1].at_s - looks[0].at_s
        cpu = 100 * (looks[-1].cpu_s - looks[0].cpu_s) / span_s if span_s else float("nan")
        settled = looks[int(SETTLED * len(looks))]
        lines.append(f"| {name} | {cpu:.1f} | {settled.rss_mib:.0f} | {looks[-1].rss_mib:.0f} |")
    table = output[output.find("stream ") :] if "stream " in output else output
    return "\n".join([*lines, "", "```", table.rstrip().replace(f"{ROOT}/", ""), "```", ""])


if __name__ == "__main__":
    sys.exit(main())
