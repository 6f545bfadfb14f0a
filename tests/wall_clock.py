"""A wall clock that a test can step, for the processes it starts."""

import struct
import subprocess
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
        with self.file.open("r+b") as file:
            (before,) = struct.unpack("=q", file.read(8))
            file.seek(0)
            file.write(struct.pack("=q", before + round(seconds * 1e9)))
