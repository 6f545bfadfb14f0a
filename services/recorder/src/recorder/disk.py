"""What may wait long for the disk is done on a thread of its own."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from sense4hri.liveness import Pulse

from recorder.bag import Job

StartThread = Callable[[str, Callable[[], None], Pulse | None], threading.Thread]
"""start_thread(name, work, pulse): a running thread, whose failure is the service's failure."""


class Disk:
    """Does what may wait long for the disk, one thing after the other."""

    def __init__(self, start_thread: StartThread) -> None:
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._thread = start_thread("fsync", self._work, None)

    def do(self, job: Job) -> None:
        self._jobs.put(job)

    def close(self) -> None:
        """Wait until everything is done; what a failed thread has left is done by this one."""
        self._jobs.put(None)
        self._thread.join()
        while not self._jobs.empty():
            if (job := self._jobs.get()) is not None:
                job()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()
