"""A service's log: each entry is one line of visible characters, whatever others on the graph call their things."""

from typing import Any

from sense4hri.plain_text import plain


class Log:
    """Writes to a ROS logger."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def info(self, text: str) -> None:
        """Write what happened."""
        self._logger.info(plain(text))

    def warning(self, text: str) -> None:
        """Write what somebody should look at."""
        self._logger.warning(plain(text))

    def warning_at_times(self, text: str, every_s: float) -> None:
        """Write what may come with every frame, at most once in so long; to be called at one place of a program."""
        self._logger.warning(plain(text), throttle_duration_sec=every_s)

    def error(self, text: str) -> None:
        """Write what went wrong."""
        self._logger.error(plain(text))
