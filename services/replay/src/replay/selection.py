"""Which recorded topics are played, and under which names."""

import re
from collections.abc import Iterable

from sense4hri.patterns import Patterns

# every node publishes these itself
NEVER = frozenset(["/rosout", "/parameter_events"])
COMPUTED = (
    "/humans/physiological/*/*/*/features",
    "/humans/physiological/*/*/*/clock",
    "/humans/physiological/*/state",
    "/study/ack",
    "/diagnostics",
    "/clock",
)


class Selection:
    """What is played. what: `all`, or `raw`, which leaves out what services compute from the rest.

    remap: rules `/from:=/to`; the first whose `/from` is the topic, or its beginning up to a slash, is applied.
    Raises ValueError for a rule that is none.
    """

    def __init__(self, what: str, topics: Iterable[str], exclude: Iterable[str], remap: Iterable[str] = ()) -> None:
        self._wanted, self._excluded = Patterns(topics), Patterns(exclude)
        self._computed = Patterns(COMPUTED if what == "raw" else ())
        self._rules = [_rule(text) for text in remap]

    def target(self, topic: str) -> str | None:
        """Return the name under which a recorded topic is played, None where it is not."""
        if not self._wanted.match(topic) or self._excluded.match(topic) or self._computed.match(topic):
            return None
        name = self._renamed(topic)
        return None if name in NEVER else name

    def _renamed(self, topic: str) -> str:
        for old, new in self._rules:
            if topic == old or topic.startswith(old + "/"):
                return new + topic[len(old) :]
        return topic


def _rule(text: str) -> tuple[str, str]:
    old, mark, new = text.partition(":=")
    if not mark or not re.fullmatch(r"(/[A-Za-z_]\w*)+", old, re.ASCII):
        raise ValueError(f"parameter 'remap': {text!r} must be '/from:=/to'")
    if not re.fullmatch(r"(/[A-Za-z_]\w*)+", new, re.ASCII):
        raise ValueError(f"parameter 'remap': {new!r} in {text!r} is no topic name")
    return old, new
