"""Who has said what about the phase that a session is in, and who is no longer waited for. No ROS, no clock."""

from collections.abc import Collection

from sense4hri.waiting import Waited

from session_coordinator.session import Ack

MOST_ANSWERS = 1000  # of services that nobody expects


class Answers:
    """The answers to one phase. last_services: those that finish after all others have."""

    def __init__(self, last_services: Collection[str]) -> None:
        self._last_services = last_services
        self._acks: dict[str, Ack] = {}
        self.given_up: tuple[str, ...] = ()
        """Who has not finished in time and is left behind."""

    def clear(self) -> None:
        """Begin a phase: nobody has answered."""
        self._acks, self.given_up = {}, ()

    def take(self, ack: Ack, expected: Collection[str]) -> bool:
        """Take what a service says; False where strangers have said too much already."""
        known = ack.service in self._acks or ack.service in expected
        if not known and len(self._acks) >= MOST_ANSWERS:
            return False
        self._acks[ack.service] = ack
        return True

    def forget(self, name: str) -> None:
        """Let a service answer again: it has gone, or it is another process."""
        self._acks.pop(name, None)

    def give_up(self, names: tuple[str, ...]) -> None:
        """Wait no longer for these."""
        self.given_up += names

    def is_ok(self, name: str) -> bool:
        """Return whether a service has done what the phase asks of it."""
        return name in self._acks and self._acks[name].ok

    def silent(self, expected: Collection[str]) -> list[str]:
        """Return who of these has said nothing."""
        return [name for name in expected if name not in self._acks]

    def unfinished(self, expected: Collection[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return who of these has not finished: all but the last services, and these."""
        names = [name for name in expected if not self.is_ok(name) and name not in self.given_up]
        last = self._last_services
        return tuple(n for n in names if n not in last), tuple(n for n in names if n in last)

    def waited(self, expected: Collection[str]) -> list[Waited]:
        """Return who of these is waited for, and why."""
        first, last = self.unfinished(expected)
        names = [name for name in expected if name in first + last]
        return [Waited(n, self._acks[n].detail if n in self._acks else "no answer yet") for n in names]

    def of_last(self) -> dict[str, Ack]:
        """Return what those say that finish last, by name."""
        return {name: self._acks[name] for name in self._last_services if name in self._acks}
