"""A service's log: each entry is one line of visible characters, whatever others on the graph call their things."""

import time
from typing import Any

from sense4hri.plain_text import plain


class Log:
    """Writes to a ROS logger."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._quiet_until_s: dict[str, float] = {}

    def info(self, text: str) -> None:
        """Write what happened."""
        self._logger.info(plain(text))

    def warning(self, text: str) -> None:
        """Write what somebody should look at."""
        self._logger.warning(plain(text))

    def warning_at_times(self, text: str, every_s: float, about: str = "") -> None:
        """Write what may come with every frame, of each thing that it is about at most once in so long."""
        now_s = time.monotonic()
        self._quiet_until_s = {each: until_s for each, until_s in self._quiet_until_s.items() if until_s > now_s}
        if about not in self._quiet_until_s:
            self._quiet_until_s[about] = now_s + every_s
            self.warning(text)

    def error(self, text: str) -> None:
        """Write what went wrong."""
        self._logger.error(plain(text))
