"""What an interpreter cannot use of a raw stream is counted, and handed back to who refuses it by topic and sender."""

from collections import Counter
from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message
from sense4hri.errors import FrameError
from sense4hri.intake import LONGEST_NAME
from sense4hri.interpreter_streams import RawInput
from sense4hri.names import StreamName
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

NAME = StreamName("p1", "ecg", "h10_1")


class Heard:
    """A service that has the handler of its one subscription called, and its counters; the raw input beside it."""

    def __init__(self) -> None:
        self.chunks: list[object] = []
        self.counted: Counter[str] = Counter()
        self.metrics = self
        self.input = RawInput(self, NAME, self.chunks.append)

    def subscribe(self, _message, _topic, handler, *_, **__):
        self.put = handler

    def counter(self, name, *_, **__):
        return SimpleNamespace(inc=lambda: self.counted.update([name]))


def raw(name, *samples):
    return bytes(serialize_message(PhysioRaw(channels=[PhysioRawChannel(channel_name=name, samples=samples)])))


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (bytes(serialize_message(PhysioRaw())), "samples"),
        (raw("ecg", 1e31), "beyond 1e"),
        (raw("é" * (LONGEST_NAME + 1), 1.0), f"name of {LONGEST_NAME + 1} characters"),
    ],
    ids=["no_channels", "too_large", "long_name"],
)
def test_each_bad_message_is_counted_and_handed_back(message, why):
    """Every one of them, so that each sender is named; nothing of it comes in, and the next good one does."""
    heard = Heard()
    for _ in range(2):
        with pytest.raises(FrameError, match=why):
            heard.put(message)
    assert heard.counted == {"messages": 2, "undecodable_frames": 2}
    assert heard.chunks == []
    heard.put(raw("é" * LONGEST_NAME, 1.0))
    assert len(heard.chunks) == 1
