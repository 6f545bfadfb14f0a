"""What a step costs: CPU beside the length of its signal, and memory."""

import os
import time
from collections.abc import Callable
from pathlib import Path


def cost_percent(run: Callable[[], object], seconds: float) -> float:
    """CPU time of a run over seconds of signal, in % of a core."""
    begun_s = time.process_time()
    run()
    return 100 * (time.process_time() - begun_s) / seconds


def memory_mib() -> float:
    """What this process holds in memory now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
