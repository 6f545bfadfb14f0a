"""A raw message written as bytes is the message that rclpy's own classes would have made."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sense4hri import wire
from sense4hri.cdr import RawMessage, read_raw, write_raw
from sense4hri.chunk import Chunk
from sense4hri.stamps import LATEST_NS, from_ns
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
STAMPS = st.integers(0, LATEST_NS - 1)


def filled(frame_id, raw):
    """The same as a message of rclpy's, field by field."""
    message = PhysioRaw()
    message.header.frame_id = frame_id
    message.header.stamp, message.device_timestamp = from_ns(raw.received_ns), from_ns(raw.device_ns)
    for name, column in zip(raw.channels, raw.samples.T, strict=True):
        message.channels.append(PhysioRawChannel(channel_name=name, samples=column.tolist()))
    return message


@given(
    frame_id=TEXTS,
    names=st.lists(TEXTS, max_size=5),
    samples=st.integers(1, 12),
    received_ns=STAMPS,
    device_ns=STAMPS,
    seed=st.integers(0, 99),
)
def test_its_bytes_are_those_of_the_middleware(frame_id, names, samples, received_ns, device_ns, seed):
    """Whatever its names, their lengths and the number of samples: as long, and the same message once it is read."""
    values = np.random.default_rng(seed).normal(size=(samples, len(names)))
    raw = RawMessage(received_ns, device_ns, tuple(names), values)
    octets, message = write_raw(frame_id, raw), filled(frame_id, raw)
    assert deserialize_message(octets, PhysioRaw) == message
    assert len(octets) == len(serialize_message(message))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, ">f8"])
def test_a_chunk_comes_back_as_it_went(order, kind):
    """However its samples lie in memory; NaN and infinity too, and no device time stays none."""
    values = np.arange(12).reshape(4, 3).astype(kind, order=order)
    if values.dtype.kind == "f":
        values[1, 2], values[3, 0] = np.nan, np.inf
    told = read_raw(wire.octets_of(Chunk(("x", "y", "z"), values, None, 7), "imu_1"))
    np.testing.assert_array_equal(told.samples, values)
    assert told[:3] == (7, 0, ("x", "y", "z"))


def test_what_a_message_cannot_hold_is_told():
    """A stamp beyond 2038 or before 1970, names without a column, and no sample at all."""
    with pytest.raises(ValueError, match="a Time holds no such"):
        write_raw("a", RawMessage(LATEST_NS, 0, ("x",), np.zeros((1, 1))))
    with pytest.raises(ValueError, match="a Time holds no such"):
        write_raw("a", RawMessage(5, -(1 << 62), ("x",), np.zeros((1, 1))))
    with pytest.raises(ValueError, match="argument"):
        write_raw("a", RawMessage(5, 0, ("x", "y"), np.zeros((1, 1))))
    with pytest.raises(ValueError, match="without samples"):
        write_raw("a", RawMessage(5, 0, ("x",), np.zeros((0, 1))))


@pytest.mark.parametrize(
    ("sent", "read"),
    [
        (("x", "y", "x"), ("x", "y", "x_2")),
        (("x", "x_2", "x", "x"), ("x", "x_2", "x_3", "x_4")),
        (("x", "x", "x_2"), ("x", "x_2", "x_2_2")),
        (("x",) * 10_000, ("x", *(f"x_{n}" for n in range(2, 10_001)))),
    ],
)
def test_channels_of_one_name_are_told_apart(sent, read):
    """No driver may name two alike; where one does, neither hides the other."""
    values = np.arange(len(sent), dtype=float)[None]
    told = read_raw(write_raw("imu_1", RawMessage(7, 0, sent, values)))
    assert told.channels == read
    np.testing.assert_array_equal(told.samples, values)
