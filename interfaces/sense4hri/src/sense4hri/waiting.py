"""Entries of `SessionState.waiting_for`: `<node>`, `<node>: <why>` or `<topic or glob>: <why>`. Imports no ROS."""

from collections.abc import Iterable
from typing import NamedTuple

STREAMS_NOT_LOOKED_AT = "required streams"
"""Who is waited for while the coordinator has not looked at any required stream yet."""


class Waited(NamedTuple):
    """Who is waited for: a node, a topic or a glob; and why, where somebody said so."""

    who: str
    why: str = ""

    def __str__(self) -> str:
        return f"{self.who}: {self.why}" if self.why else self.who

    @classmethod
    def parse(cls, entry: str) -> "Waited":
        """Return an entry's two parts; a node's name and a topic hold no colon."""
        who, _, why = entry.partition(":")
        return cls(who, why.strip())


def waits_for(waiting_for: Iterable[str], service: str) -> bool:
    """True where the coordinator waits for this service."""
    return any(Waited.parse(entry).who == service for entry in waiting_for)
