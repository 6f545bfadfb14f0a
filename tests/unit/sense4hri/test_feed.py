"""What a session's start cuts off a stream, and what belongs to the next segment already."""

from typing import Any

import numpy as np
from sense4hri.chunk import Chunk, TimedChunk
from sense4hri.feed import Feed, Report
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo

SECOND_NS = 10**9
INFO = StreamInfo(StreamName("p1", "ecg", "h10_1"), 10.0, "uV", ("ecg",), -1.0, 1.0, 0.0, "node")


class Heard:
    """A step that remembers what it was told."""

    def __init__(self, info: StreamInfo) -> None:
        self.told: list[float] = []

    def push(self, timed: TimedChunk) -> list[Any]:
        return []

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        self.told.append(value)


def samples(at_s: float) -> Chunk:
    return Chunk(("ecg",), np.zeros((10, 1)), round(at_s * SECOND_NS), round(at_s * SECOND_NS))


def report(at_s: float, value: float) -> Report:
    return Report(round(at_s * SECOND_NS), "heart_rate", value)


def test_a_session_hears_nothing_of_what_was_before_it_and_all_of_what_came_early():
    """A report stamped before the start, even one that comes late, is the old step's or nobody's."""
    made: list[Heard] = []

    def make(info: StreamInfo) -> Heard:
        made.append(Heard(info))
        return made[-1]

    feed = Feed(make, 1.0)
    feed.know(INFO)
    feed.cut_at(5 * SECOND_NS)
    feed.put(samples(4.0))
    feed.put(report(4.5, 60.0))
    feed.put(report(5.2, 61.0))  # of the session, before its first samples
    feed.put(samples(5.5))
    feed.put(report(4.9, 62.0))  # stamped before the session, and late
    feed.put(report(5.6, 63.0))
    old, new = made
    assert old.told == [60.0]
    assert new.told == [61.0, 63.0]
