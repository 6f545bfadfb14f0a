"""driver-lsl: its bytes, and what it refuses."""

import numpy as np
import pytest
from driver_lsl.config import Config, streams_of
from driver_lsl.emulator import Emulator
from driver_lsl.protocol import RATE_HZ, Frame, decode
from sense4hri.errors import FrameError


def test_frames_follow_each_other_without_a_hole():
    """The device time of a frame's last sample grows by what the frame holds."""
    device = Emulator()
    first, second = decode(device.frame()), decode(device.frame())
    assert isinstance(first, Frame)
    assert isinstance(second, Frame)
    assert second.device_ns - first.device_ns == round(len(second.samples) / RATE_HZ * 1e9)
    assert np.all((second.samples > 0) & (second.samples < 100))


@pytest.mark.parametrize("octets", [b"", b"1234", b"1234567"])
def test_what_is_no_frame_is_told(octets):
    """Too little, or half a sample, is an error and not a guess."""
    assert isinstance(decode(octets), FrameError)


def test_what_is_declared_is_what_is_sent():
    """One channel, at the rate of the frames."""
    (stream,) = streams_of(Config(sensor_id="it_1")).values()
    assert (stream.sampling_frequency_hz, len(stream.channel_names)) == (RATE_HZ, 1)
