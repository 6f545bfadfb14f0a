"""`sense4hri-check-driver` beside whatever else a test does."""

import json
import subprocess
import sys

ENDS_S = 90.0


class DriverCheck:
    """The command as a process, in this process's ROS domain."""

    def __init__(self, sensor_id: str, seconds: float, *options: str) -> None:
        words = ["-m", "check_driver", sensor_id, "--json", "--seconds", f"{seconds:g}", *options]
        self._process = subprocess.Popen(
            [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def departures(self) -> list[str]:
        """Wait for its end; return where the driver departs from the contract."""
        try:
            told, said = self._process.communicate(timeout=ENDS_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            told, said = self._process.communicate()
        assert told, said
        return [f"{each['where']}: {each['what']}" for each in json.loads(told)["departures"]]
