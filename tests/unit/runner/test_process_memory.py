"""What a further process costs a machine."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))

import bench_scaling
from process_memory import further_mib, own_and_proportional_mib, resident_mib

SHARED_MIB = 64
FORKED = f"""
import os, sys
kept = bytearray(os.urandom({SHARED_MIB} * 1024 * 1024))
for _ in range(3):
    if not (child := os.fork()):
        sys.stdin.read()
        os._exit(0)
    print(child, flush=True)
print("all", flush=True)
sys.stdin.read()
"""


def test_pages_that_processes_share_count_once():
    """Of 64 MiB that four processes have in common each is charged 16; resident memory charges all of them to each."""
    command = [sys.executable, "-c", FORKED]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pids = [parent.pid, *(int(parent.stdout.readline()) for _ in range(3))]
        assert parent.stdout.readline() == "all\n"
        resident, proportional = map(resident_mib, pids), [own_and_proportional_mib(pid)[1] for pid in pids]
        assert min(resident) > SHARED_MIB
        assert SHARED_MIB < sum(proportional) < 2 * SHARED_MIB


@pytest.mark.parametrize(
    ("some", "all_of_them", "each"),
    [([50.0, 50.0], [45.0, 45.0, 45.0, 45.0], 40.0), ([], [70.0], 70.0), ([50.0], [50.0], math.nan)],
)
def test_a_further_process_costs_what_all_have_more(some, all_of_them, each):
    """What those before it are relieved of is taken off; without a further one there is no number."""
    assert further_mib(some, all_of_them) == pytest.approx(each, nan_ok=True)


@pytest.mark.parametrize(
    ("costs", "said"),
    [
        ([0.42, 0.42, 0.29], (False, ", falling")),
        ([0.97, 1.56, 1.76], (False, ", rising")),
        ([0.35, 0.46, 0.38], (True, "")),
    ],
)
def test_a_cost_that_is_not_even_says_which_way_it_goes(costs, said):
    """It stays a miss of the bound either way."""
    percents = [0.0]
    for cost in costs:
        percents.append(percents[-1] + cost)
    points = [bench_scaling.Point(n, {"x": percent}, 0.0, 0, 0, (), 0, 0) for n, percent in enumerate(percents)]
    row = bench_scaling._service_row("x", points)
    assert (row["ok"], row["measured"].partition(" % of a core")[2]) == said


def test_a_cost_is_told_by_the_speed_of_the_first_point_too():
    """Cores that take twice the CPU for one work make a study look twice as dear; not known, it is not told."""
    points = [
        bench_scaling.Point(n, {"x": percent}, 0.0, 0, 0, (), 0, 0, work_ms=work_ms)
        for n, percent, work_ms in ((0, 1.0, 0.4), (10, 6.0, 0.4), (20, 22.0, 0.8))
    ]
    row = bench_scaling._service_row("x", points)
    assert (row["ok"], row["measured"].partition("): ")[2]) == (False, "0.50, 0.50 % of a core")
    unknown = [point._replace(work_ms=math.nan) for point in points]
    assert "speed" not in bench_scaling._service_row("x", unknown)["measured"]


def test_the_same_work_takes_as_much_of_a_core_again():
    """It is the CPU that is measured, which waiting takes none of."""
    assert 0 < bench_scaling.worked_ms(0.3) < 50
