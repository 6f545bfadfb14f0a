"""Go Direct frames: two captured ones, and a belt's bytes cut, bent and lost."""

import numpy as np
import pytest
from driver_vernier import protocol
from driver_vernier.config import Config, streams_of
from driver_vernier.protocol import FORCE, RESPIRATION_RATE, Frames, Losses, Measured, Response, decode
from sense4hri.errors import FrameError
from sensor_bench.vernier.firmware import Commands, measurement, sealed

CAPTURED = bytes([32, 25, 207, 216, 6, 6, 0, 2, 252, 128, 138, 7, 191, 0, 0, 192, 127, 128, 49, 8, 191, 0, 0, 192, 127])
"""Of a real belt, as Espruino's program for it quotes it."""
CAPTURED_ANSWER = bytes([152, 10, 1, 39, 81, 253, 54, 0, 0, 0])
"""To command 51: the channels that there are."""


def test_a_captured_frame():
    """Two samples of force, and a respiration rate that the belt does not know yet."""
    (frame,) = Frames().take(CAPTURED)
    measured = decode(frame)
    assert isinstance(measured, Measured)
    assert measured.counter == 207
    assert measured.values[FORCE] == pytest.approx([-0.5294571, -0.5320053], abs=1e-6)
    assert np.isnan(measured.values[RESPIRATION_RATE]).all()


def test_what_a_real_belt_sent_is_not_outside_the_range_that_is_declared():
    """It sends less than 0 N; a belt at an end of its range is taken for a saturated one, which tells of no breath."""
    (frame,) = Frames().take(CAPTURED)
    declared = streams_of(Config(sensor_id="belt_1", name="GDX-RB 0K1002A1"))["respiration"]
    force = decode(frame).values[FORCE]
    assert not ((force <= declared.range_min) | (force >= declared.range_max)).any()


def test_a_captured_answer():
    """Channels 1, 2, 4 and 5."""
    (frame,) = Frames().take(CAPTURED_ANSWER)
    assert decode(frame) == Response(0x51, 253, bytes([54, 0, 0, 0]))


def test_commands_are_what_the_vendors_code_writes():
    """Length, counter and checksum of the first command; period and mask little endian."""
    init = protocol.command(protocol.INIT, 0xFE)
    assert init[:5].hex() == "5819fe3f1a"
    assert protocol.set_period(100_000).hex() == "1bff00a086010000000000"
    assert protocol.start(1, 2).hex() == "18ff01060000000000000000000000"


def test_a_belt_understands_them_in_any_chunks():
    """What the driver writes is answered by the bench's own reading of it, and the answer comes back."""
    for size in (1, 7, 20, 64):
        belt, counter = Commands("0K1002A1", lambda: 81), 0xFF
        said = []
        for payload in (protocol.INIT, protocol.STATUS, protocol.DEVICE_INFO, protocol.SENSOR_INFO + b"\x01"):
            counter -= 1
            whole = protocol.command(payload, counter)
            for at in range(0, len(whole), size):
                said += [decode(sealed(0x98, 0, answer)) for answer in belt.receive(whole[at : at + size])]
        assert [(each.command, each.counter) for each in said] == [(0x1A, 254), (0x10, 253), (0x55, 252), (0x50, 251)]
        assert protocol.decode_status(said[1].content) == ("1.7", 81.0)
        assert protocol.decode_info(said[2].content) == ("GDX-RB", "0K1002A1")
        assert protocol.decode_channel(said[3].content) == ("N", 10_000)


def test_ten_minutes_with_loss_flipped_bits_and_any_cuts():
    """Of whole frames every sample comes once; of the others the exact number is missing; nothing is raised."""
    rng = np.random.default_rng(5)
    frames, losses = Frames(), Losses()
    came, lost, stream, kept = [], 0, [], []
    for number in range(6000):
        frame = measurement(number, 6, [[float(2 * number), 15.0], [float(2 * number + 1), 15.0]])
        fate = 1.0 if number in (0, 1, 5999) else rng.random()
        if fate < 0.01:
            continue
        if fate < 0.02:
            at = int(rng.integers(4, len(frame)))
            frame = frame[:at] + bytes([frame[at] ^ 1 << rng.integers(8)]) + frame[at + 1 :]
        else:
            kept.append(number)
        stream.append(frame)
    octets, at, errors = b"".join(stream), 0, 0
    while at < len(octets):
        size = int(rng.integers(1, 40))
        for frame in frames.take(octets[at : at + size]):
            if isinstance(frame, FrameError):
                errors += 1
                continue
            measured = decode(frame)
            lost += losses.before(measured.counter) * measured.values[FORCE].size
            came += measured.values[FORCE].tolist()
        at += size
    assert came == [float(2 * number + half) for number in kept for half in (0, 1)]
    assert lost == 2 * (6000 - len(kept)) > 0
    assert errors > 0


def test_what_looks_like_a_frame_among_odd_bytes_must_make_sense():
    """A right checksum alone is no frame while one is searched: of 256 bytes one has it by chance."""
    nonsense = sealed(0x20, 0, bytes([0x42, 0, 0, 0, 0]))
    error, frame = Frames().take(b"\x07\x01" + nonsense + CAPTURED)
    assert frame == CAPTURED
    assert str(error) == f"{2 + len(nonsense)} bytes that are in no frame (0701{nonsense.hex()})"


def test_a_notification_that_is_missing_makes_no_frame_of_its_neighbours():
    """The end of one frame is lost, and the sum fits by chance with the next one's beginning: only the next is one."""
    beginnings = [measurement(0, 6, [[0.0, 15.0], [1.0, rate]])[:20] for rate in np.arange(256) / 7]
    whole = measurement(1, 6, [[2.0, 15.0], [3.0, 15.0]])
    chance = [each for each in beginnings if protocol.checksum(each + whole[:5]) == each[3]]
    for beginning in chance:
        frames = Frames()
        assert list(frames.take(beginning)) == []
        found = [frame for part in (whole[:20], whole[20:]) for frame in frames.take(part)]
        assert [frame for frame in found if not isinstance(frame, FrameError)] == [whole]
        assert len(found) == 2
    assert chance


@pytest.mark.parametrize("step", [1, -1])
def test_the_counter_may_go_up_or_down(step):
    """The first step of one says which; a hole of any size below 128 is counted, over the wrap too."""
    losses, counter = Losses(), 250
    assert (losses.before(counter), losses.before(counter + step & 0xFF)) == (0, 0)
    counter += step
    for hole in (0, 1, 7, 127, 3):
        counter += step * (hole + 1)
        assert losses.before(counter & 0xFF) == hole


@pytest.mark.parametrize("step", [1, -1])
def test_a_counter_that_stays_or_goes_back_is_no_loss(step):
    """The same frame twice, one late by a step, one restarted: no frame is missing, and counting goes on from there."""
    losses = Losses()
    counters = [10, 11, 11, 10, 11, 14, 200, 201, 203]
    assert [losses.before(step * each & 0xFF) for each in counters] == [0, 0, 0, 0, 0, 2, 0, 0, 1]


@pytest.mark.parametrize(
    "content",
    [b"", b"\x06", bytes([6, 6, 0, 2, 0, 1, 2]), bytes([6, 0, 0, 0, 0]), bytes([9, 0, 1]), bytes([0x42, 0, 0, 0])],
)
def test_a_measurement_that_makes_no_sense_is_refused(content):
    """Too short, too few values, no channel, an unknown kind: a sentence with its bytes, not a guess."""
    with pytest.raises(FrameError):
        decode(sealed(0x20, 0, content or b"\x06"))


def test_single_channels_and_wide_masks():
    """Whole numbers of one channel, and a mask of 32 bits."""
    one = decode(sealed(0x20, 1, bytes([9, 0, 4, 2]) + (7).to_bytes(4, "little") + (9).to_bytes(4, "little")))
    assert one.values[4].tolist() == [7.0, 9.0]
    wide = decode(
        sealed(0x20, 1, bytes([7]) + (1 << 17).to_bytes(4, "little") + bytes([1, 0]) + bytes.fromhex("0000803f"))
    )
    assert wide.values[17].tolist() == [1.0]
    assert decode(sealed(0x20, 9, bytes([0x0D, 1, 2, 3]))) == Measured(9, {})
