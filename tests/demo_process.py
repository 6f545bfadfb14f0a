"""`make demo` as a process: its lines as they come, and a sure end."""

import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


class Demo:
    """compose/demo.py with its output in a list of lines."""

    def __init__(self, folder: Path, *options: str) -> None:
        command = [sys.executable, str(ROOT / "compose" / "demo.py"), "--port", "0"]
        self.process = subprocess.Popen(
            [*command, "--recordings", str(folder), *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))

    @property
    def logs(self) -> Path:
        """Folder of the processes' logs, which the demo names first of all."""
        found = next(found for line in self.lines if (found := re.search(r"logs in (\S+)", line)))
        return Path(found[1])

    def wait(self, seconds: float) -> int:
        status = self.process.wait(seconds)
        self._reader.join(5)
        return status

    def until(self, text: str, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while not any(text in line for line in self.lines):
            assert time.monotonic() < deadline, f"no {text!r} within {seconds} s:\n" + "\n".join(self.lines)
            assert self.process.poll() is None, "\n".join(self.lines)
            time.sleep(0.05)

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(15)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self._reader.join(5)
        if self.process.stdout is not None:
            self.process.stdout.close()
