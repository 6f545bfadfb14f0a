"""A wall clock that a test can step, for the processes it starts."""

import struct
import subprocess
import time
from pathlib import Path

SOURCE = Path(__file__).with_suffix(".c")


class WallClock:
    """Compiles the shim into a folder. env: what a process must be started with to follow this clock."""

    def __init__(self, folder: Path) -> None:
        self.library, self.file = folder / "wall_clock.so", folder / "wall_clock.ns"
        self.file.write_bytes(struct.pack("=q", 0))
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", self.library, SOURCE], check=True)
        self.env = {"LD_PRELOAD": str(self.library), "WALL_CLOCK_FILE": str(self.file)}

    def step(self, seconds: float) -> None:
        """Set the clock forward, or back where negative, for every process at once."""
        ahead_ns = self._ahead_ns() + round(seconds * 1e9)
        with self.file.open("r+b") as file:
            file.write(struct.pack("=q", ahead_ns))

    def now_ns(self) -> int:
        """What it shows."""
        return time.time_ns() + self._ahead_ns()

    def _ahead_ns(self) -> int:
        return int(struct.unpack("=q", self.file.read_bytes())[0])
