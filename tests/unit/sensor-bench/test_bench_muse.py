"""What a virtual Muse puts on the air: packets by hand, the counter's wrap, commands."""

import json

import numpy as np
import pytest
from sensor_bench.muse.packets import EEG, MOTION, PPG, SHAPES, Band, answer, command_of
from sensor_bench.signals.hearts import Heart


@pytest.fixture(scope="module")
def band():
    return Band(Heart(1), 7, 0.28)


def twelve(packet: bytes) -> list[int]:
    """The twelve values of an EEG packet, read by hand: three hexadecimal digits each."""
    digits = packet[2:].hex()
    return [int(digits[at : at + 3], 16) for at in range(0, len(digits), 3)]


def test_an_eeg_packet_is_a_counter_and_twelve_values_of_twelve_bits(band):
    """Each of four electrodes has a packet of 20 bytes with one counter; 2048 is 0 uV, one is 0.48828125 uV."""
    packets = band.packets(EEG, 65535 + 3, 1200)
    assert [(len(packet), packet[:2]) for packet in packets] == [(20, b"\x00\x02")] * 4
    microvolts = band.microvolts(1200, 12)
    assert np.array_equal(np.array([twelve(packet) for packet in packets]).T * 0.48828125 - 1000, microvolts)
    assert np.ptp(band.microvolts(0, 256)[:, 0]) > 40  # alpha waves at TP9


def test_motion_and_light_packets_by_hand(band):
    """Three samples of three axes of 16 bits, gravity upwards; six of 24 bits."""
    acceleration, rotation = band.packets(MOTION, 1, 0)
    z_g = int.from_bytes(acceleration[6:8], "big", signed=True) / 16384
    assert z_g == pytest.approx(0.99, abs=0.05)
    assert (len(acceleration), len(rotation)) == (20, 20)
    for packet in band.packets(PPG, 1, 0):
        assert len(packet) == 20
        assert 200_000 < int.from_bytes(packet[2:5], "big") < 400_000


def test_the_same_instant_has_the_same_signal_in_any_packet(band):
    """Values are a function of the sample's number, however they are cut."""
    whole = band.microvolts(240, 24)
    parts = np.concatenate([band.microvolts(240, 12), band.microvolts(252, 12)])
    assert np.array_equal(whole, parts)
    assert SHAPES[EEG].samples == 12


def test_commands_are_letters_with_their_length_before_and_a_line_feed_behind():
    """`d` is 02 64 0A; what has another length is none."""
    assert command_of(b"\x02d\n") == "d"
    assert command_of(b"\x04p21\n") == "p21"
    for wrong in (b"", b"d", b"\x03d\n", b"\x02dx"):
        with pytest.raises(ValueError, match="no command"):
            command_of(wrong)


def test_an_answer_is_json_in_packets_of_at_most_nineteen_letters():
    """Put together by the lengths, the packets are the JSON again."""
    packets = list(answer(rc=0, fw="1.2.13", bp=90))
    assert all(len(packet) == 20 for packet in packets)
    text = b"".join(packet[1 : 1 + packet[0]] for packet in packets)
    assert json.loads(text) == {"rc": 0, "fw": "1.2.13", "bp": 90}
