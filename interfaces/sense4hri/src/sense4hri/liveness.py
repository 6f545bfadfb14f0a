"""Whether every thread of a service still answers (`/healthz`). Pure."""

import threading
import time
from collections.abc import Callable

ANSWER_S = 5.0
Ask = Callable[[Callable[[], None]], None]
"""ask(answer) has a thread call answer() when its turn comes."""


class Liveness:
    """Asks every thread of a service that must turn for ever, and waits for their answers.

    asks: by the name of the thread. A thread that hangs, or is busy for longer than answer_s, makes the service
    unhealthy; so it is never asked by one of these threads.
    """

    def __init__(self, asks: dict[str, Ask], answer_s: float = ANSWER_S) -> None:
        self._asks, self._answer_s = asks, answer_s

    def silent(self) -> list[str]:
        """Return the names of those that have not answered within answer_s; they are all asked at once."""
        deadline_s = time.monotonic() + self._answer_s
        answers = {name: _asked(ask) for name, ask in self._asks.items()}
        return [name for name, answer in answers.items() if not answer.wait(max(0.0, deadline_s - time.monotonic()))]


def _asked(ask: Ask) -> threading.Event:
    answered = threading.Event()
    ask(answered.set)
    return answered
