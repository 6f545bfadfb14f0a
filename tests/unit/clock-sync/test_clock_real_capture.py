"""A real LSL recording across a reboot of the sender: the recorder's own offset measurements are the truth."""

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from clock_sync.estimator import ClockEstimator

SECOND = 1_000_000_000
HOST_EPOCH_NS = 1_700_000_000 * SECOND
SAMPLES, CLOCK_OFFSET = 3, 4
DELAY_S, JITTER_S = 0.002, 0.005
CHANNEL_FORMAT = "<8f"


class Capture(NamedTuple):
    """Of one stream: stamps of the sender's clock in s, and (sender's time, offset to the recorder's clock) in s."""

    stamps: np.ndarray
    offsets: np.ndarray


def read_xdf(path: Path, stream: int) -> Capture:
    """The time-stamped samples and clock offsets of an 8-channel float stream (XDF 1.0: length, tag, content)."""
    data, at = path.read_bytes(), 4
    stamps, offsets = [], []
    while at < len(data):
        wide = data[at]
        length = int.from_bytes(data[at + 1 : at + 1 + wide], "little")
        begin = at + 1 + wide
        tag, content = struct.unpack_from("<H", data, begin)[0], data[begin + 2 : begin + length]
        at = begin + length
        if tag in (SAMPLES, CLOCK_OFFSET) and struct.unpack_from("<I", content)[0] == stream:
            if tag == CLOCK_OFFSET:
                offsets.append(struct.unpack_from("<dd", content, 4))
                continue
            wide = content[4]
            position = 5 + wide
            while position < len(content):
                if content[position] == 8:
                    stamps.append(struct.unpack_from("<d", content, position + 1)[0])
                position += 1 + content[position] + struct.calcsize(CHANNEL_FORMAT)
    return Capture(np.array(stamps), np.array(offsets))


def biosemi(path: Path) -> Capture:
    for stream in range(1, 10):
        try:
            capture = read_xdf(path, stream)
        except (struct.error, IndexError):
            continue
        if len(capture.stamps) > 10_000:
            return capture
    raise AssertionError("no BioSemi stream in the file")


def test_the_reboot_of_a_real_sender_is_a_new_segment(shared_data):
    """The offset leaps from -652340 s to +1121 s; on both sides the model stays within 1 ms of the measurements."""
    capture = biosemi(shared_data / "xdf" / "clock_resets.xdf")
    reboot = int(np.argmin(np.diff(capture.stamps))) + 1
    turn = int(np.argmin(np.diff(capture.offsets[:, 0]))) + 1
    random = np.random.default_rng(1)
    estimator, errors, segments = ClockEstimator(), [], []
    for part, offsets in (
        (capture.stamps[:reboot], capture.offsets[:turn]),
        (capture.stamps[reboot:], capture.offsets[turn:]),
    ):
        truth = part + np.interp(part, offsets[:, 0], offsets[:, 1])
        received = np.maximum.accumulate(truth + DELAY_S + random.exponential(JITTER_S, len(part)))
        for i in range(0, len(part), 4):
            device_ns, received_ns = round(part[i] * 1e9), HOST_EPOCH_NS + round(received[i] * 1e9)
            estimator.packet("eeg", device_ns, received_ns)
            model = estimator.model()
            if i > len(part) // 3:
                errors.append((model.ros_ns(device_ns) - HOST_EPOCH_NS) / 1e9 - truth[i] - DELAY_S)
                segments.append(model.segment)
    assert set(segments) == {1, 2}
    assert estimator.segment == 2
    assert np.percentile(np.abs(errors), 95) < 1e-3
