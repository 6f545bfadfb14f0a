"""A wall clock that a test can step and let drift, for the processes it starts."""

import struct
import subprocess
import time
from pathlib import Path

SOURCE = Path(__file__).with_suffix(".c")


FORM = "=qqq"


class WallClock:
    """Compiles the shim into a folder. env: what a process must be started with to follow this clock."""

    def __init__(self, folder: Path) -> None:
        self.library, self.file = folder / "wall_clock.so", folder / "wall_clock.ns"
        self.file.write_bytes(struct.pack(FORM, 0, 0, 0))
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", self.library, SOURCE], check=True)
        self.env = {"LD_PRELOAD": str(self.library), "WALL_CLOCK_FILE": str(self.file)}

    def step(self, seconds: float) -> None:
        """Set the clock forward, or back where negative, for every process at once."""
        offset_ns, rate_ppb, since_ns = self._read()
        self._write(offset_ns + round(seconds * 1e9), rate_ppb, since_ns)

    def drift(self, ppm: float) -> None:
        """Let it run faster, or slower where negative, from now on."""
        self._write(self.ahead_ns(), round(ppm * 1e3), time.monotonic_ns())

    def now_ns(self) -> int:
        """What it shows."""
        return time.time_ns() + self.ahead_ns()

    def ahead_ns(self, monotonic_ns: int | None = None) -> int:
        """By how much it is ahead of the machine's; at another moment, as it is set now."""
        offset_ns, rate_ppb, since_ns = self._read()
        gone_ns = (time.monotonic_ns() if monotonic_ns is None else monotonic_ns) - since_ns
        return offset_ns + gone_ns * rate_ppb // 1_000_000_000

    def _read(self) -> tuple[int, int, int]:
        offset_ns, rate_ppb, since_ns = struct.unpack(FORM, self.file.read_bytes())
        return offset_ns, rate_ppb, since_ns

    def _write(self, *values: int) -> None:
        with self.file.open("r+b") as file:
            file.write(struct.pack(FORM, *values))
