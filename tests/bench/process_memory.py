"""Memory of processes, told in one way by every bench.

What one more process of an image costs a machine is its proportional share: pages that it shares with others count
once, as the kernel keeps them once. Resident memory counts them again for everybody who has them.
"""

import re
from collections.abc import Sequence
from pathlib import Path

MOST_FURTHER_MIB = 60.0
"""What a further driver may take."""


def resident_mib(pid: int) -> float:
    """Return all that a process has in memory, shared pages included, in MiB."""
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) / 1024 if found else 0.0


def own_and_proportional_mib(pid: int) -> tuple[float, float]:
    """Return what a process has alone, and what it has with its share of what others have too, in MiB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
    kib = {key: int(rest.split()[0]) for key, _, rest in (line.partition(":") for line in lines)}
    return (kib["Private_Clean"] + kib["Private_Dirty"]) / 1024, kib["Pss"] / 1024


def further_mib(some: Sequence[float], all_of_them: Sequence[float]) -> float:
    """Return what each further process took: proportional memory of some, then of all of them; NaN for none further."""
    further = len(all_of_them) - len(some)
    return (sum(all_of_them) - sum(some)) / further if further > 0 else float("nan")
