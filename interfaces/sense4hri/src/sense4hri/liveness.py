"""Whether every thread of a service still turns: `/healthz`, `/readyz`, and the end of a process that hangs. Pure."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence

from sense4hri.processor import Processor

TICK_S = 1.0
SILENT_S = 5.0
HUNG_S = 30.0
Ask = Callable[[Callable[[], None]], None]
"""ask(answer) has a thread call answer() when its turn comes."""


class Liveness:
    """Asks every thread that must turn for ever, once per TICK_S, from a thread of its own.

    asks: by the name of the thread. At most TICK_S is counted per tick, so the time in which the whole process was
    stopped counts for nobody. on_hung(names) is called once, for those that have not answered for HUNG_S in which they
    did not wait for a processor: a machine that is too busy makes a service slow, and does not end it.
    """

    def __init__(self, asks: Mapping[str, Ask], on_hung: Callable[[Sequence[str]], None]) -> None:
        self._hearts = {name: _Heart(ask) for name, ask in asks.items()}
        self._on_hung, self._told = on_hung, False
        self._closed = threading.Event()

    def keep_asking(self) -> None:
        """Ask until closed, on a thread of its own."""
        processor: Processor | None = None  # asked only while somebody is late: it costs more than all the rest here
        self.tick(0.0)
        before_s = time.monotonic()
        while not self._closed.wait(TICK_S):
            now_s = time.monotonic()
            self.tick(now_s - before_s, processor.own(now_s - before_s) if processor else None)
            processor = (processor or Processor()) if self.silent(TICK_S / 2) else None
            before_s = now_s

    def close(self) -> None:
        """Ask no more."""
        self._closed.set()

    def watch(self, name: str, ask: Ask) -> None:
        """Ask one more thread, which has just begun; from any thread."""
        self._hearts[name] = _Heart(ask, 0.0)

    def forget(self, name: str) -> None:
        """Ask a thread no more, for it ends; from any thread."""
        self._hearts.pop(name, None)

    def silent(self, seconds: float = SILENT_S) -> list[str]:
        """Return the names of those that have not answered for so long, or not yet."""
        return [name for name, heart in list(self._hearts.items()) if heart.silent_s >= seconds]

    def tick(self, elapsed_s: float, own: Mapping[int, float] | None = None) -> None:
        """Take note of who has answered, elapsed_s after the last tick, and ask those again.

        own: by native id, the share of that time in which a thread did not wait for a processor (`Processor.own`).
        """
        for heart in list(self._hearts.values()):
            heart.tick(min(elapsed_s, TICK_S), own or {})
        hung = [name for name, heart in list(self._hearts.items()) if heart.own_s >= HUNG_S]
        if hung and not self._told:
            self._told = True
            self._on_hung(hung)


class Pulse:
    """Answers for a thread that waits for something of its own: the thread lets it beat in each of its rounds."""

    def __init__(self) -> None:
        self._answer: Callable[[], None] | None = None

    def ask(self, answer: Callable[[], None]) -> None:
        """Have answer() called in the next round; from any thread."""
        self._answer = answer

    def beat(self) -> None:
        """Answer, where somebody has asked."""
        answer, self._answer = self._answer, None
        if answer is not None:
            answer()


class _Heart:
    """What one thread has answered. silent_s: seconds since then; at first, where nothing is said, as if for long.

    own_s: as many of them as it did not wait for a processor. Which thread it is shows with its first answer; until
    then it has waited as long as the one that waited longest.
    """

    def __init__(self, ask: Ask, silent_s: float = SILENT_S) -> None:
        self._ask = ask
        self._asked = False
        self._thread: int | None = None
        self._lock = threading.Lock()
        self.silent_s = self.own_s = silent_s

    def tick(self, elapsed_s: float, own: Mapping[int, float]) -> None:
        with self._lock:
            if self._asked:
                least = min(own.values(), default=1.0)
                self.silent_s += elapsed_s
                self.own_s += elapsed_s * (least if self._thread is None else own.get(self._thread, 1.0))
            asked, self._asked = self._asked, True
        if not asked:
            self._ask(self._answer)

    def _answer(self) -> None:
        with self._lock:
            self._asked, self._thread = False, threading.get_native_id()
            self.silent_s = self.own_s = 0.0
