"""The processes that write a session, and what is known to be missing of it because of them. No ROS, no clock."""

from collections.abc import Collection, Mapping


class Writers:
    """Who writes, since the recording began; names: the nodes that do."""

    def __init__(self, names: Collection[str]) -> None:
        self._names = names
        self._processes: dict[str, frozenset[bytes]] = {}
        self._lacking: set[str] = set()

    def seen(self, present: Mapping[str, frozenset[bytes]]) -> None:
        """Take who is there now, with their processes: another one than began has not written all of it."""
        for name in {*self._names} & present.keys():
            known = self._processes.setdefault(name, present[name])
            if present[name] - known:
                self._processes[name] = known | present[name]
                self._lacking.add(f"{name} was started afresh in the middle")

    @property
    def lacking(self) -> list[str]:
        """What is known to be missing, a sentence each."""
        return sorted(self._lacking)
