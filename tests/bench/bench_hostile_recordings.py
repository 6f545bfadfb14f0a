"""A thousand damaged and hostile recordings through the six tools that read recordings.

    .venv/bin/python tests/bench/bench_hostile_recordings.py [--seconds 380]

Each run is a forked process of its own with 1 GB and 20 s of processor time (`tests/hostile/tools.py`). What was done
is kept in build/ after every round of all mutations, so that it can be done in pieces: --seconds ends after the round
in which they are over, and the next call goes on. What must not be is listed as it is found.
"""

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hostile.mutations import MUTATIONS
from hostile.tools import TOOLS, sweep

ROUNDS = -(-1000 // len(MUTATIONS))
KEPT = Path(__file__).resolve().parents[2] / "build" / "hostile_recordings.json"
NOTHING: dict[str, Any] = {"rounds": 0, "ran": 0, "slowest_s": 0.0, "largest_mb": 0.0, "wrong": []}


def rows() -> list[dict[str, Any]]:
    """Measure whatever is not measured yet; the next call begins afresh."""
    found = go_on(float("inf"))
    KEPT.unlink()
    kinds = Counter(wrong.split(" /")[0] for _, _, _, wrong, _ in found["wrong"])
    told = ", ".join(f"{number} {kind}" for kind, number in kinds.items()) or "0 tracebacks, 0 over 20 s, 0 changed"
    return [
        {
            "what": f"damaged and hostile recordings, {ROUNDS * len(MUTATIONS)} mutations x {len(TOOLS)} tools",
            "target": "0 tracebacks, 0 over 20 s, <= 1 GB, input never changed",
            "measured": f"{found['ran']} runs: {told}; {found['slowest_s']:.1f} s of one processor and "
            f"{found['largest_mb']:.0f} MB at most",
            "ok": not found["wrong"] and found["largest_mb"] <= 1024,
        }
    ]


def go_on(seconds: float) -> dict[str, Any]:
    """Rounds after those that are kept, until all are done or the time is over."""
    until_s = time.monotonic() + seconds
    found = json.loads(KEPT.read_text()) if KEPT.is_file() else dict(NOTHING)
    while found["rounds"] < ROUNDS and time.monotonic() < until_s:
        found = _round(found)
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps(found))
        wrong, slowest = len(found["wrong"]), f"{found['slowest_s']:.1f} s, {found['largest_mb']:.0f} MB at most"
        print(f"{found['rounds']}/{ROUNDS}: {found['ran']} runs, {wrong} wrong, {slowest}", file=sys.stderr)
    return found


def _round(before: dict[str, Any]) -> dict[str, Any]:
    seed, found = before["rounds"], before | {"wrong": list(before["wrong"]), "rounds": before["rounds"] + 1}
    for one in sweep(list(MUTATIONS), range(seed, seed + 1), list(TOOLS)):
        found["ran"] += 1
        found["slowest_s"] = max(found["slowest_s"], one.took_s)
        found["largest_mb"] = max(found["largest_mb"], one.peak_mb)
        if one.wrong:
            found["wrong"].append([one.mutation, one.seed, one.tool, one.wrong, one.said.strip()[-300:]])
            print(f"{one.mutation} {one.seed} {one.tool}: {one.wrong}\n{one.said.strip()[-1500:]}", file=sys.stderr)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end after about so long")
    go_on(parser.parse_args().seconds)
