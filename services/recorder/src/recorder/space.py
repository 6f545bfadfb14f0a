"""How long the disk will last: refuse to begin, warn, and stop in time."""

from __future__ import annotations

import os
from collections import deque
from pathlib import Path

WINDOW_S = 60.0
OTHERS_S = 10.0  # after which what others take of the disk counts; what a recording keeps aside is sudden
RESERVE_BYTES = 4 << 20  # kept aside by every recording so that a full disk still takes the index
STOP_SHARE, GO_ON_SHARE = 10, 5  # a recording that runs stops at this part of the floor, and goes on at that


def free_bytes(path: Path) -> int:
    """Free space of the disk a folder is on, or its nearest parent that exists."""
    while not path.exists() and path != path.parent:
        path = path.parent
    disk = os.statvfs(path)
    return disk.f_bavail * disk.f_frsize


class Space:
    """floor_bytes: below it no recording begins.

    One that runs stops at a tenth of it, and goes on at a fifth: without what it had kept aside and may have used.
    """

    def __init__(self, floor_bytes: int) -> None:
        self._floor_bytes, self._stop_bytes = floor_bytes, floor_bytes // STOP_SHARE
        self.go_on_bytes = floor_bytes // GO_ON_SHARE + RESERVE_BYTES
        self._seen: deque[tuple[float, int, int]] = deque()
        self.free_bytes = 0
        self.minutes_left: float | None = None
        """Until a running recording stops, at the rate of the last minute, whoever fills the disk; None: not known."""

    def look(self, now_s: float, written_bytes: int, free: int) -> None:
        """Take in how much a recording has written so far, and what is free. now_s: any steady clock."""
        self.free_bytes = free
        if self._seen and written_bytes < self._seen[-1][1]:
            self._seen.clear()  # another recording
        self._seen.append((now_s, written_bytes, free))
        while now_s - self._seen[0][0] > WINDOW_S:
            self._seen.popleft()
        (first_s, first, free_first), (last_s, last, _) = self._seen[0], self._seen[-1]
        self.minutes_left = None
        if last > first and last_s > first_s:
            fallen = free_first - free if last_s - first_s >= OTHERS_S else 0
            per_s = max(last - first, fallen) / (last_s - first_s)
            self.minutes_left = max(free - self._stop_bytes, 0) / per_s / 60.0

    @property
    def refusal(self) -> str:
        """Why no recording may begin; empty: it may."""
        if self.free_bytes >= self._floor_bytes:
            return ""
        return f"{self.free_bytes / 1e6:.0f} MB free, free_floor_mb is {self._floor_bytes / 1e6:.0f}"

    @property
    def must_stop(self) -> bool:
        """True where a recording that runs must end its file now."""
        return self.free_bytes < self._stop_bytes

    @property
    def may_go_on(self) -> bool:
        """True where one that was stopped for want of space may go on."""
        return self.free_bytes >= self.go_on_bytes
