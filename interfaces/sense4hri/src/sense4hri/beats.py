"""Who of the services lives: each says so once a second (`sense4hri.diagnostics`). Pure.

A service that hangs, is stopped or was killed says nothing, whatever the graph still shows of it.
"""

from typing import NamedTuple

EVERY_S = 1.0
HEARD_WITHIN_S = 0.5  # as many come as there are services: they are taken together
SILENT_S = 3.5  # of three beats, and some way for a busy machine; told within 5 s
UNANSWERED_S = 2.0  # of a thread, until its service says so
AFRESH_S = 10.0
MAKES_ROOM_S = 600.0  # silent for so long, where others come
MOST = 500
TWO_NODES = "two nodes have this name, and nobody can tell them apart"
END_ONE = "end one, or have them in two ROS domains"
TWINS = f"{TWO_NODES}; {END_ONE}"
"""What is told of whom `Beats.twins` returns."""


class Beat(NamedTuple):
    """What a service says of itself.

    service: name of its node. run: of this process, another one after a restart. trouble: a sentence, empty where all
    its threads turn. ended: it ends in order. missing: why `/readyz` says no, and more of it; empty where it is ready.
    dropped: messages dropped because it fell behind, since its start.
    """

    service: str
    run: str
    trouble: str = ""
    ended: bool = False
    missing: str = ""
    dropped: int = 0


class _Heard(NamedTuple):
    beat: Beat
    at_s: float
    afresh_s: float
    """When it was first heard again after another run of it had not ended in order."""
    former: str = ""
    """The run that was heard before this one."""
    twin_s: float = -AFRESH_S
    """When a run was heard last after another one that had been heard after it: both live."""


class Beats:
    """The newest beat of every service. now_s: any steady clock. Who has never said anything is not judged."""

    def __init__(self) -> None:
        self._heard: dict[str, _Heard] = {}

    def take(self, beat: Beat, now_s: float) -> None:
        """Take in one beat; who ends in order is forgotten."""
        before = self._heard.pop(beat.service, None)
        if beat.ended or (before is None and not self._has_room(now_s)):
            return
        self._heard[beat.service] = _after(before, beat, now_s)

    def _has_room(self, now_s: float) -> bool:
        """Whether one more can be kept: where as many are as may be, who has long been silent makes room."""
        if len(self._heard) < MOST:
            return True
        name, heard = min(self._heard.items(), key=lambda each: each[1].at_s)
        if now_s - heard.at_s <= MAKES_ROOM_S:
            return False
        del self._heard[name]
        return True

    def newest(self, now_s: float) -> list[Beat]:
        """Return what everybody said last of whom there is news."""
        return [heard.beat for heard in self._heard.values() if now_s - heard.at_s <= SILENT_S]

    def troubles(self, now_s: float) -> dict[str, str]:
        """Return what is wrong with whom: a sentence by the name of the node, the same until it lives again."""
        return {name: why for name, heard in self._heard.items() if (why := _trouble(heard, now_s))}

    def twins(self, now_s: float) -> list[str]:
        """Return under whose name two live, by what has been heard in the last SILENT_S."""
        return [name for name, heard in self._heard.items() if now_s - heard.twin_s <= SILENT_S]

    def afresh(self, now_s: float) -> list[str]:
        """Return who was started afresh a moment ago, though it had not ended in order."""
        return [name for name, heard in self._heard.items() if now_s - heard.afresh_s < AFRESH_S]


def _after(before: _Heard | None, beat: Beat, now_s: float) -> _Heard:
    """Return what is known after one more beat."""
    if before is None:
        return _Heard(beat, now_s, -AFRESH_S)
    if beat.run == before.beat.run:
        return before._replace(beat=beat, at_s=now_s)
    if beat.run == before.former:
        return _Heard(beat, now_s, -AFRESH_S, before.beat.run, now_s)
    return _Heard(beat, now_s, now_s, before.beat.run, before.twin_s)


def _trouble(heard: _Heard, now_s: float) -> str:
    if now_s - heard.at_s > SILENT_S:
        return f"no heartbeat for more than {SILENT_S:g} s: it hangs, is stopped or was killed"
    return heard.beat.trouble
