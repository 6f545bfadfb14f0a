"""A thousand damaged and hostile recordings through the six tools that read recordings.

    .venv/bin/python tests/bench/bench_hostile_recordings.py

Each run is a process of its own with 1 GB and 20 s (`tests/hostile`); what must not be is listed by kind.
"""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hostile.mutations import MUTATIONS

MUTATIONS_IN_ALL = 1000
TOOLS = Path(__file__).resolve().parents[1] / "hostile" / "tools.py"


def rows(mutations: int = MUTATIONS_IN_ALL) -> list[dict[str, Any]]:
    """Measure."""
    seeds = -(-mutations // len(MUTATIONS))
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(TOOLS), "--seeds", f"0:{seeds}"]
    found = json.loads(subprocess.run(command, env=env, capture_output=True, text=True, check=False).stdout)
    kinds = Counter(wrong.split(" /")[0] for _, _, _, wrong, _ in found["wrong"])
    told = ", ".join(f"{number} {kind}" for kind, number in kinds.items()) or "0 tracebacks, 0 over 20 s, 0 changed"
    return [
        {
            "what": f"damaged and hostile recordings, {seeds * len(MUTATIONS)} mutations x 6 tools",
            "target": "0 tracebacks, 0 over 20 s, <= 1 GB, input never changed",
            "measured": f"{found['ran']} runs: {told}; {found['slowest_s']} s and {found['largest_mb']} MB at most",
            "ok": not found["wrong"] and found["largest_mb"] <= 1024,
        }
    ]


if __name__ == "__main__":
    for item in rows():
        print(item)
