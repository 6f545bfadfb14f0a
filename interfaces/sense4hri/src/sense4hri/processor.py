"""How long each thread of this process was kept waiting for a processor: Linux tells it. Pure."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

SECOND_NS = 1_000_000_000


class Processor:
    """Tells which share of a time each thread had for itself: 1 where it slept or ran and never waited to run.

    tasks: a folder with one folder per thread, named by its native id, in it `schedstat`: how long it ran and how long
    it was ready to and waited, in ns (Linux, Documentation/scheduler/sched-stats.rst). Without them nobody waited.
    """

    def __init__(self, tasks: Path = Path("/proc/self/task")) -> None:
        self._tasks = tasks
        self._before = dict(self._read())

    def own(self, elapsed_s: float) -> dict[int, float]:
        """Return the share of every thread in the elapsed_s since the last call, 0 to 1."""
        before, self._before = self._before, dict(self._read())
        return {
            thread: min(max(1.0 - (waited_ns - before.get(thread, 0)) / SECOND_NS / elapsed_s, 0.0), 1.0)
            for thread, waited_ns in self._before.items()
            if elapsed_s > 0
        }

    def _read(self) -> Iterator[tuple[int, int]]:
        with suppress(OSError):
            for task in self._tasks.iterdir():
                with suppress(OSError, ValueError):  # the thread has ended meanwhile
                    _, waited_ns, _ = map(int, (task / "schedstat").read_text().split())
                    yield int(task.name), waited_ns
