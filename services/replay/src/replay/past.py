"""What a listener that was there before a moment of the recording would know; said before it is played from there."""

from __future__ import annotations

import asyncio
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

from rclpy.serialization import deserialize_message
from sense4hri_msgs.msg import SensorInfoArray

from replay.recorded import BagError, Recorded, Recording, Topic

SENSORS = "/study/sensors"
FIRST_SAID = (SENSORS, "/study/assignments", "/tf_static", "/robot_description")


class Past(NamedTuple):
    """Messages in the order of their log times; taken: topic and log time of those not to be played once more.

    held: by latched topic, what had been said before, as `Recording.messages` asks for it.
    """

    messages: list[Recorded]
    taken: set[tuple[str, int]]
    held: dict[str, deque[bytes]]


async def before(
    recording: Recording,
    topics: Sequence[Topic],
    from_ns: int,
    standing: Mapping[str, Sequence[int]],
    in_vain: Callable[[], bool],
) -> Past:
    """Return what still holds of latched topics, and what names sensors and persons, though it was said only later.

    standing: by topic, log times of what was said last and is still told to who comes; it is not said again.
    in_vain(): says that nothing will be played from there; then nothing is returned, without reading on.
    Of `/study/sensors` the message that describes most sensors is the only one played: consumers learn rates and
    units from it, and those of the first moments describe none. Raises BagError where it cannot be read.
    """
    taken: set[tuple[str, int]] = set()
    past: dict[str, deque[Recorded]] = defaultdict(deque)
    held = {topic.name: deque[bytes](maxlen=topic.repeated) for topic in topics if topic.latched}
    fullest: tuple[tuple[int, int, int], Recorded] | None = None
    for recorded in _said(recording, topics, from_ns):
        await asyncio.sleep(0)
        if in_vain():
            return Past([], set(), {})
        name, queue = recorded.topic.name, past[recorded.topic.name]
        if recorded.log_ns < from_ns and name in held:
            held[name].append(recorded.cdr)
        if name == SENSORS:
            rank = _described(recorded)
            fullest = (rank, recorded) if fullest is None or rank >= fullest[0] else fullest
            taken.add((name, recorded.log_ns))
        elif recorded.log_ns < from_ns:
            queue.append(recorded)
            if len(queue) > recorded.topic.latched_depth:
                queue.popleft()
        elif name in FIRST_SAID and (not queue or queue[-1].log_ns == recorded.log_ns):
            queue.append(recorded)
            taken.add((name, recorded.log_ns))
    if fullest is not None:
        past[SENSORS].append(fullest[1])
    return Past(_not_standing(past, standing), taken, held)


def _said(recording: Recording, topics: Sequence[Topic], from_ns: int) -> Iterator[Recorded]:
    """All of the topics whose first word holds from the beginning, then of other latched ones what came before."""
    first_said = {topic.name for topic in topics if topic.name in FIRST_SAID}
    latched = {topic.name for topic in topics if topic.latched} - first_said
    start_ns = recording.start_ns
    return chain(
        recording.messages(first_said, start_ns) if first_said else (),
        recording.messages(latched, start_ns, from_ns) if latched and from_ns > start_ns else (),
    )


def _not_standing(past: Mapping[str, deque[Recorded]], standing: Mapping[str, Sequence[int]]) -> list[Recorded]:
    """What of the past is not told already, in the order in which it was recorded."""
    for name, queue in past.items():
        for _ in range(_overlap(standing[name], [recorded.log_ns for recorded in queue])):
            queue.popleft()
    return sorted((message for queue in past.values() for message in queue), key=lambda m: m.log_ns)


def _overlap(standing: Sequence[int], wanted: Sequence[int]) -> int:
    """How many of the first wanted are the last that stand."""
    told = list(standing)
    return next(n for n in range(len(wanted), -1, -1) if told[len(told) - n :] == wanted[:n])


def _described(recorded: Recorded) -> tuple[int, int, int]:
    """Rank of a `/study/sensors` message: sensors, of which online, time."""
    try:
        sensors = deserialize_message(recorded.cdr, SensorInfoArray).sensors
    except RuntimeError as err:
        raise BagError(f"{SENSORS} holds a message that makes no sense: {err}") from err
    return len(sensors), sum(sensor.online for sensor in sensors), recorded.log_ns
