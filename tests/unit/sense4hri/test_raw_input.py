"""What an interpreter refuses of a raw stream goes the way of everything that is refused: by topic and sender."""

from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message
from sense4hri.intake import LONGEST_NAME
from sense4hri.interpreter import _RawInput
from sense4hri.names import StreamName
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

NAME = StreamName("p1", "ecg", "h10_1")


class Heard:
    """A service that keeps what it is told; the raw input of one stream beside it."""

    def __init__(self) -> None:
        self.refused: list[tuple[str, str, str]] = []
        self.chunks: list[object] = []
        self.metrics = SimpleNamespace(counter=lambda *_, **__: SimpleNamespace(inc=lambda: None))
        self.input = _RawInput(self, NAME, self.chunks.append)

    def subscribe(self, _message, _topic, handler, *_, **__):
        self.put = handler

    def refuse(self, place, kind, why):
        self.refused.append((place, kind, why))


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
def test_each_bad_message_is_refused_with_its_topic(message, why):
    """Every one of them, so that each sender is named; nothing of it comes in, and the next good one does."""
    heard = Heard()
    for _ in range(2):
        heard.put(message)
    assert [(place, kind) for place, kind, _ in heard.refused] == [(NAME.topic("raw"), "PhysioRaw")] * 2
    assert all(why in said for _, _, said in heard.refused)
    heard.put(raw("é" * LONGEST_NAME, 1.0))
    assert len(heard.chunks) == 1
