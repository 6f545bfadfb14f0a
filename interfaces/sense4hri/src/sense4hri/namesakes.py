"""Two nodes of one name, which nobody can tell apart: each says so of itself. Pure."""

from collections.abc import Iterable

LOOK_S = 5.0
TOLD_AFTER_S = 30.0
"""DDS remembers a process that was killed until its lease ends, 20 s; started anew it is no other node."""


class Namesakes:
    """Looks whether the own name is on the graph more than once, and for how long it has been."""

    def __init__(self, name: str, namespace: str) -> None:
        self._own = name, namespace
        self._since_s: float | None = None
        self._told = False

    def look(self, nodes: Iterable[tuple[str, str]], now_s: float) -> str:
        """Return the sentence where it is to be told now, else nothing.

        nodes: name and namespace of all on the graph, the own one among them. now_s: any steady clock.
        """
        if sum(node[:2] == self._own for node in nodes) < 2:
            self._since_s, self._told = None, False
            return ""
        self._since_s = now_s if self._since_s is None else self._since_s
        if self._told or now_s - self._since_s < TOLD_AFTER_S:
            return ""
        self._told = True
        name, namespace = self._own
        what = f"another node is called {namespace.rstrip('/')}/{name} too, of this machine or another"
        return f"{what}: nobody can tell the two apart; end one of them, or have them in two ROS domains"
