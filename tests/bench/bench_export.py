"""What exporting a long session costs: two hours of ten streams, all formats by one command, and each by its own.

    .venv/bin/python tests/bench/bench_export.py

The recording is that of `bench_report.py`; each command is a process of its own, whose peak memory is measured.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from bench_report import long_recording
from sense4hri_session.export import FORMATS

Row = dict[str, Any]
MOST_S, MOST_MB = 120.0, 600.0


def rows() -> list[Row]:
    """Measure."""
    with tempfile.TemporaryDirectory() as folder:
        path, messages = long_recording(Path(folder) / "long")
        total_s, cpu_s, peak_mb, _ = _cost(path, Path(folder) / "all", *FORMATS)
        costs = {name: _cost(path, Path(folder) / name, name) for name in FORMATS}
        found = [
            {
                "what": f"export of 2 h of ten streams to {name}",
                "target": "none set",
                "measured": f"{took_s:.0f} s ({own_s:.0f} s of CPU), {own_mb:.0f} MB at the peak, {written_mb:.0f} MB",
                "ok": None,
            }
            for name, (took_s, own_s, own_mb, written_mb) in costs.items()
        ]
        size_mb = sum(file.stat().st_size for file in path.iterdir()) / 1e6
        return [
            {
                "what": f"export of 2 h of ten streams ({messages} messages, {size_mb:.0f} MB) to everything",
                "target": f"<= {MOST_S:.0f} s, bounded memory (<= {MOST_MB:.0f} MB)",
                "measured": f"{total_s:.0f} s ({cpu_s:.0f} s of CPU), {peak_mb:.0f} MB at the peak",
                "ok": bool(total_s <= MOST_S and peak_mb <= MOST_MB),
            },
            *found,
        ]


def _cost(path: Path, out: Path, *formats: str) -> tuple[float, float, float, float]:
    """Wall time and CPU time in s, peak memory in MB and MB written of one command."""
    begun = time.monotonic()
    command = [
        sys.executable,
        "-m",
        "sense4hri_session",
        str(path),
        "--out",
        str(out),
        "--quiet",
        "--formats",
        *formats,
    ]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{formats} was not exported")
    written = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    return time.monotonic() - begun, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, written / 1e6


if __name__ == "__main__":
    print("| what | target | measured | |\n|---|---|---|---|")
    for item in rows():
        print(f"| {item['what']} | {item['target']} | {item['measured']} | {item['ok']} |")
