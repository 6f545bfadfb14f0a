"""Runs every test this machine can run, files side by side, and says, one line each, what it leaves out.

    python tests/run.py [--only containers] [--slow] [--strict] [--jobs 3] [--once] [pytest arguments]

Groups: unit, kit, contract, graph, browser; containers where a Docker Engine answers; kubernetes where
k8s/cluster/build.sh has put what a test cluster needs. Every file (of the unit tests every folder) is a pytest process
of its own, with its own ROS domain and ports. Unit tests compute and wait for nobody: they take the time that the
others leave, at a lower priority. The output of those that fail stands at the end. A file that waits for other
processes and fails is tried once more, alone; where it then passes it is told as UNSTABLE with the output of its
failure. The exit status is 0 where all have passed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence

from cluster_cache import KUBECTL
from jobs import NOTHING_COLLECTED, ROOT, Job, Result, Room, run

sys.path.insert(0, str(ROOT / "interfaces"))
from environment import network_environment

TESTS = ROOT / "tests"
GROUPS = ("unit", "kit", "contract", "graph", "browser", "containers", "kubernetes")
ALONE = {"containers", "test_cluster.py", "test_replay_law.py", "test_nine_modalities.py", "test_faults.py"}
"""One file at a time, before all others, beside nothing but pure code that gives way to it: what shares something of
this machine, and studies beside which nobody may want its cores. There the first state of a replay at 20x has 25 ms for
its features, sixteen services have 10 s to stop, and beside one that is killed nobody may be silent for 3.5 s."""
ONE = Room(1, 1)
MOST_OF_A_CORE = 3
"""Files at a time for each core, where all of them wait."""
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
QUICK = ("-m", "not slow")
MOST_TRIED_AGAIN = 3
"""Files; where more have failed, the machine is not the reason."""
LOGS = ROOT / "build" / "tests"
SECONDS = LOGS / "seconds.json"
LIMIT_S = 2400.0
"""Of one file; only a hang takes as long."""
SLOWEST = 10
MINUTES = {
    "test_colcon_workspace.py": 9,
    "interpreter-ecg": 6,
    "test_device_studies.py": 5,
    **dict.fromkeys(("test_every_service.py", "test_gui_ways.py", "test_session.py", "sense4hri_session"), 4),
    "interpreter-ppg": 3,
    "test_gui.py": 3,
    "test_replay.py": 3,
    **dict.fromkeys(("test_check_driver.py", "test_demo_graph.py", "test_driver_polar.py", "test_driver_shell.py"), 2),
    **dict.fromkeys(("test_recorder.py", "test_scripted_study.py", "test_sensor_bench.py", "test_service.py"), 2),
    **dict.fromkeys(("test_stranger.py", "test_three_hosts.py", "test_gui_eight.py", "test_gui_lanes.py"), 2),
    **dict.fromkeys(("test_gui_session.py", "test_gui_strangers.py", "interpreter-respiration"), 2),
    **dict.fromkeys(("interpreter-eda", "interpreter-eog", "test_reading_without_ros.py", "test_gui_access.py"), 1),
    **dict.fromkeys(("test_alerts.py", "test_asked.py", "test_faults.py", "test_new_service.py"), 1),
    **dict.fromkeys(("test_gui_assign.py", "test_gui_modalities.py"), 1),
    **dict.fromkeys(("test_host_clocks.py", "test_clock_sync.py", "test_driver_brainflow.py", "test_bridge_lsl.py"), 1),
    **dict.fromkeys(("test_fusion_affect.py", "test_interpreter_shell.py", "test_interpreter_sources.py"), 1),
    **dict.fromkeys(("test_metadata_registry.py", "test_graph_fuzz.py", "compose", "sense4hri"), 1),
}
"""Of the longest, beside others: what goes first on a machine that has run none of them yet."""


def docker_answers() -> bool:
    """True where a Docker Engine answers within 20 s."""
    command = [str(ROOT / "compose" / "docker.sh"), "version", "--format", "{{.Server.Version}}"]
    try:
        return subprocess.run(command, capture_output=True, timeout=20, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def left_out(groups: Sequence[str]) -> dict[str, str]:
    """Which of the groups cannot run here, with the reason."""
    reasons = {}
    if "browser" in groups and not any(shutil.which(name) for name in CHROMIUM):
        reasons["browser"] = "no Chromium, on Debian: apt-get install chromium"
    if "containers" in groups and not docker_answers():
        reasons["containers"] = "no Docker Engine answers, on Debian: apt-get install docker.io"
    if "kubernetes" in groups and not KUBECTL.exists():
        reasons["kubernetes"] = "no kubectl of the test cluster: k8s/cluster/build.sh"
    return reasons


def slow_files() -> list[str]:
    """Files with tests that are marked slow."""
    files = sorted(TESTS.rglob("test_*.py"))
    return [str(file.relative_to(TESTS)) for file in files if "pytest.mark.slow" in file.read_text()]


def jobs_of(group: str) -> list[Job]:
    """Its files; of the unit tests, many and quick, the folders."""
    files = sorted((TESTS / group).rglob("test_*.py"))
    paths = sorted({file.parent for file in files}) if group == "unit" else files
    return [Job(group, path, bool({group, path.name} & ALONE)) for path in paths]


def longest_first(jobs: list[Job]) -> list[Job]:
    """In the order of what they took last time; those never run here before the others, those that are alone first."""
    known = last_time()

    def key(job: Job) -> tuple[bool, bool, float]:
        return job.alone, name_of(job) not in known, known.get(name_of(job), MINUTES.get(job.name, 0.0))

    return sorted(jobs, key=key, reverse=True)


def name_of(job: Job) -> str:
    return str(job.path.relative_to(ROOT))


def last_time() -> dict[str, float]:
    """Seconds of each job when it last passed here."""
    return json.loads(SECONDS.read_text()) if SECONDS.exists() else {}


def remember(results: Sequence[Result]) -> None:
    """Keep what each took, for the order of the next run."""
    took = {name_of(result.job): round(result.seconds, 1) for result in results if result.ok}
    SECONDS.write_text(json.dumps(last_time() | took, indent=1) + "\n")


def room_for(jobs: int | None) -> Room:
    """So many files at a time; where it is left to the machine, one more than cores at least, and pure code aside."""
    cores = len(os.sched_getaffinity(0))
    return Room(jobs, jobs) if jobs else Room(cores + 1, MOST_OF_A_CORE * cores, cores)


def run_all(jobs: list[Job], room: Room, arguments: Sequence[str]) -> list[Result]:
    """Run them, a line for each that has ended."""
    results: list[Result] = []
    for result in run(longest_first(jobs), room, LIMIT_S, LOGS, arguments):
        results.append(result)
        tell(f"[{len(results):3d}/{len(jobs)}]", result)
    return results


def tell(count: str, result: Result) -> None:
    """Print the line of a file that has ended."""
    mark = "" if result.ok else "  FAILED"
    line = f"{count} {result.job.group:10} {result.job.name:34} {result.said():26}"
    line += f"{result.seconds:6.1f} s {result.cpu_s:6.1f} CPU s"
    print(line + mark, flush=True)


def try_again(results: Sequence[Result], arguments: Sequence[str]) -> list[Result]:
    """The results, with those of a second try, alone, in place of the first that failed; `unstable` where it passed."""
    failed = [result for result in results if not result.ok and not result.job.pure]  # it would fail again
    if len(failed) > MOST_TRIED_AGAIN:
        return [*results]
    first = {result.job: result for result in failed}
    second = {}
    for result in run([*first], ONE, LIMIT_S, LOGS, arguments):
        tell("[again]", result)
        result.unstable = first[result.job].output if result.ok else ""
        second[result.job] = result
    return [second.get(result.job, result) for result in results]


def summary(results: Sequence[Result], wall_s: float) -> list[str]:
    """Lines: the slowest tests, why some were skipped, and a table by group."""
    tests = Counter({name: seconds for result in results for name, seconds in result.tests.items()})
    lines = ["", "slowest tests", *(f"{seconds:8.1f} s  {name}" for name, seconds in tests.most_common(SLOWEST))]
    skipped = sum((result.skipped for result in results), Counter[str]())
    lines += [f"skipped {count}: {reason}" for reason, count in skipped.items()]
    lines += ["", "group         files   passed   failed  skipped  seconds  CPU seconds"]
    for group in GROUPS:
        lines += _row(group, [result for result in results if result.job.group == group])
    return [*lines, *_row("all", results), f"{wall_s:.0f} s on the wall"]


def _row(name: str, of: Sequence[Result]) -> list[str]:
    if not of:
        return []
    counts = [len(of), sum(r.passed for r in of), sum(r.failed for r in of), sum(r.skipped.total() for r in of)]
    columns = "".join(f"{count:9d}" for count in counts)
    return [f"{name:10}{columns}{sum(r.seconds for r in of):9.0f}{sum(r.cpu_s for r in of):13.0f}"]


def report(results: Sequence[Result], wall_s: float) -> int:
    """Print the output of what failed, and the summary; return the exit status."""
    failures = [result for result in results if not result.ok]
    unstable = [result for result in results if result.unstable]
    for result in [*unstable, *failures]:
        print(f"\n===== {name_of(result.job)}\n{result.unstable or result.output}", flush=True)
    print("\n".join(summary(results, wall_s)))
    for result in unstable:
        print(f"UNSTABLE {name_of(result.job)}: failed once, passed when it was tried again alone; mend it")
    for result in failures:
        print(f"FAILED {name_of(result.job)}: {result.said()}")
    if not any(result.tests for result in results):
        print("tests: nothing was run")
        return NOTHING_COLLECTED
    return 1 if failures else 0


def chosen() -> tuple[argparse.Namespace, list[str]]:
    """The options of this script, and what is left for pytest."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=GROUPS, action="append", help="only this group; may be given several times")
    parser.add_argument("--slow", action="store_true", help="also what is marked slow: minutes of a core for one test")
    parser.add_argument("--strict", action="store_true", help="a group that cannot run here is a failure")
    parser.add_argument("--once", action="store_true", help="what fails is not tried again")
    parser.add_argument("--jobs", type=int, help="files at a time; else as many as keep the cores of this machine busy")
    options, others = parser.parse_known_args()
    if options.jobs is not None and options.jobs < 1:
        parser.error(f"--jobs is {options.jobs}, must be at least 1")
    return options, others


def main() -> int:
    options, pytest_arguments = chosen()
    groups = options.only or GROUPS
    reasons = left_out(groups)
    for group, reason in reasons.items():
        print(f"tests: {group} left out: {reason}", flush=True)
    jobs = [job for group in groups if group not in reasons for job in jobs_of(group)]
    if not jobs or (reasons and options.strict):
        return 1 if options.strict else 0
    if not options.slow:
        print(f"tests: what is marked slow is left out, it runs with --slow: {', '.join(slow_files())}", flush=True)
    begun = time.monotonic()
    LOGS.mkdir(parents=True, exist_ok=True)
    os.environ.update(network_environment())  # some tests install packages, by uv
    arguments = pytest_arguments if options.slow else [*QUICK, *pytest_arguments]
    results = run_all(jobs, room_for(options.jobs), arguments)
    if not options.once:
        results = try_again(results, arguments)
    if not pytest_arguments:  # they may have left out tests
        remember(results)
    return report(results, time.monotonic() - begun)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("interrupted: what was running has been ended")
