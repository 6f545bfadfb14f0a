"""Messages are decoded by the definition that their own recording carries."""

from __future__ import annotations

import struct
from typing import NamedTuple

import pytest
from sense4hri_recording.types import Types

HEAD = b"\0\1\0\0"


class Topic(NamedTuple):
    """A topic's type."""

    definition: str
    type_name: str = "lab_msgs/msg/Thing"


def test_two_recordings_may_mean_different_things_by_one_name():
    """A type that was read from one recording is not taken for that of another, nor is its refusal."""
    one, other, damaged = Types(), Types(), Types()
    assert one.decode(Topic("float64 x\n"), HEAD + struct.pack("<d", 1.5)).x == 1.5
    assert other.decode(Topic("int32 count\n"), HEAD + struct.pack("<i", 7)).count == 7
    with pytest.raises(ValueError, match="nested deeper"):
        damaged.decode(Topic("lab_msgs/Thing itself\n"), HEAD)
    assert one.decode(Topic("float64 x\n"), HEAD + struct.pack("<d", 2.5)).x == 2.5


def test_topics_of_one_recording_have_each_their_own_nested_types():
    """What one topic's definition says of a nested type is not said for the other topics."""
    types, nested = Types(), "=" * 80 + "\nMSG: lab_msgs/Part\n"
    first = Topic(f"lab_msgs/Part part\n{nested}float64 x\n", "lab_msgs/msg/First")
    second = Topic(f"lab_msgs/Part part\n{nested}int32 count\n", "lab_msgs/msg/Second")
    message = types.decode(first, HEAD + struct.pack("<d", 1.5))
    assert message.part.x == 1.5
    assert types.decode(second, HEAD + struct.pack("<i", 7)).part.count == 7
    assert types.encode(first, message) == HEAD + struct.pack("<d", 1.5)
