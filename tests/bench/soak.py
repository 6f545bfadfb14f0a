"""`make soak`: a session of the demo study for a long time; memory, CPU, what is missing, written to docs/soak.md.

python tests/bench/soak.py [--duration S]      (default 8 h; `make bench` has 30 min of it)
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from run import machine

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "soak.md"
SAMPLE_S = 10.0
SETTLED = 0.5  # share of the run after which memory should no longer grow
GROWTH_MIB = 5.0


class Usage(NamedTuple):
    """One look at one process."""

    at_s: float
    rss_mib: float
    cpu_s: float


class Soak(NamedTuple):
    """One long run. status: the demo's exit status. report: of the session it recorded, as in report.json."""

    status: int
    output: str
    seen: dict[str, list[Usage]]
    report: dict[str, Any]

    @property
    def missing(self) -> int:
        """Samples that are not in the recording, by device time."""
        return sum(stream["missing_in_session"] for stream in self.report["streams"])

    @property
    def growth_mib(self) -> tuple[float, str]:
        """By how much memory grew after it had settled, at most, and in which process."""
        grown = {name: looks[-1].rss_mib - settled(looks).rss_mib for name, looks in self.seen.items()}
        return max((growth, name) for name, growth in grown.items())


def main() -> int:
    """Run the demo, watch it, write docs/soak.md; return the demo's exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, default=8 * 3600.0, metavar="S", help="seconds of streaming (8 h)")
    duration_s = parser.parse_args().duration
    soak = run(duration_s)
    print(soak.output)
    PAGE.write_text(page(duration_s, soak))
    print(f"written: {PAGE.relative_to(ROOT)}")
    return soak.status


def run(duration_s: float) -> Soak:
    """Record a session of so many seconds. Raises RuntimeError where nothing was recorded."""
    command = [sys.executable, str(ROOT / "compose" / "demo.py"), "--port", "0", "--duration", str(duration_s)]
    command += ["--recordings", str(ROOT / "recordings" / "soak")]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    seen = watch(demo)
    output = demo.stdout.read() if demo.stdout is not None else ""
    recorded = re.search(r"^recorded: \d+ messages in (.+)$", output, re.MULTILINE)
    if recorded is None:
        raise RuntimeError(f"nothing was recorded:\n{output}")
    subprocess.run([sys.executable, "-m", "sense4hri_report", recorded[1]], check=True)
    report = json.loads((Path(recorded[1]) / "report.json").read_text())
    return Soak(demo.returncode, output, seen, report)


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
    """Return name and usage of every child process; the drivers, being alike, with their sensor."""
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
        sensor = next((word.partition(":=")[2] for word in words if word.startswith("sensor_id:=")), "")
        name = f"{name} {sensor}".rstrip()
        cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        found.append((name, Usage(at_s, int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 2**20, cpu_s)))
    return found


def settled(looks: list[Usage]) -> Usage:
    """The look after which memory should no longer grow."""
    return looks[int(SETTLED * len(looks))]


def page(duration_s: float, soak: Soak) -> str:
    """Return docs/soak.md."""
    lines = [
        "# Soak",
        "",
        f"{datetime.now(UTC):%F}, {machine()}: `make soak DURATION={duration_s:.0f}`. Missing from the recording: "
        f"{soak.missing} samples; verdict: {soak.report['verdict']}.",
        "",
        f"| process | CPU, % of a core | MiB after {SETTLED:.0%} of the run | MiB at its end |",
        "|---|---|---|---|",
    ]
    for name, looks in sorted(soak.seen.items()):
        span_s = looks[-1].at_s - looks[0].at_s
        cpu = 100 * (looks[-1].cpu_s - looks[0].cpu_s) / span_s if span_s else float("nan")
        lines.append(f"| {name} | {cpu:.1f} | {settled(looks).rss_mib:.0f} | {looks[-1].rss_mib:.0f} |")
    table = soak.output[soak.output.find("stream ") :]
    return "\n".join([*lines, "", "```", table.rstrip().replace(f"{ROOT}/", ""), "```", ""])


if __name__ == "__main__":
    sys.exit(main())
