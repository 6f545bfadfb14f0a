"""driver-shimmer: its bytes. What the virtual Shimmer sends is written by other code than what reads it here."""

import numpy as np
import pytest
from driver_shimmer import calibration, protocol
from driver_shimmer.packets import Answer, Packet, Packets
from driver_shimmer.protocol import Command, Layout
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sense4hri.errors import FrameError
from sensor_bench.shimmer.body import FEEDBACK_KOHM, GYRO_PER_DPS, LN_ACCELEROMETER, MAGNETOMETER, gsr_counts, gyroscope

CHANNELS = (0x00, 0x01, 0x02, 0x12, 0x1C)  # accelerometer, pulse, skin
PERIOD = 256  # ticks: 128 Hz
README = bytes.fromhex("00009c01f507a407c904e6085248")


def packet(number: int, first: int = 0) -> bytes:
    """A packet whose pulse channel says its number."""
    ticks = (first + number * PERIOD) % (1 << 24)
    channels = np.array([2047, 1211, 2047, number % 4096, 0x4000 | 2500], "<u2")
    return b"\0" + ticks.to_bytes(3, "little") + channels.tobytes()


def test_the_packet_of_the_readme_says_what_the_readme_says():
    """Time, three axes, pulse and skin stand where the table puts them."""
    layout = Layout(CHANNELS)
    counts = layout.counts([README], ("accelerometer", "ppg", "eda"))
    assert layout.length == len(README)
    assert counts["accelerometer"].tolist() == [[2037, 1956, 1225]]
    assert (counts["ppg"].item(), counts["eda"].item()) == (2278, 0x4852)
    assert calibration.conductance_us(counts["eda"]).item() == pytest.approx(7.39, abs=0.01)


def test_numbers_of_every_width_and_order_are_read():
    """Big-endian 16 and 24 bits with sign, and a magnetometer of the newer part the other way round."""
    octets, channels = b"\0abc" + b"\xff\xfe" * 3 + b"\xff\x7f" * 3, (0x0A, 0x0B, 0x0C, 0x07, 0x08, 0x09)
    old, new = (Layout(channels, little).counts([octets], ("gyroscope", "magnetometer")) for little in (False, True))
    assert old["gyroscope"].tolist() == [[-2, -2, -2]]
    assert (old["magnetometer"][0, 0], new["magnetometer"][0, 0]) == (-129, 32767)
    extremes = Layout((0x1E, 0x1F)).counts([b"\0abc\x80\0\x01\x7f\xff\xff"], ("emg",))["emg"]
    assert extremes.tolist() == [[-(2**23) + 1, 2**23 - 1]]


def test_a_channel_of_unknown_width_is_refused():
    """Nothing behind it could be found, so nothing is guessed."""
    with pytest.raises(FrameError, match="channel 77"):
        Layout((0x1C, 0x77))


@pytest.mark.parametrize("conductance_us", [0.3, 2.0, 9.0, 40.0])
def test_the_same_skin_has_the_same_conductance_in_every_range(conductance_us):
    """A change of range makes no step beyond the converter's own."""
    for resistor in range(4):
        counts = gsr_counts(conductance_us, resistor)
        if 0 < counts < 4095:
            seen = calibration.conductance_us(np.array([resistor << 14 | counts])).item()
            step_us = 1e3 / FEEDBACK_KOHM[resistor] * 6 / 4095
            assert seen == pytest.approx(conductance_us, abs=0.51 * step_us)


def test_constants_that_the_device_keeps_make_units_of_its_counts():
    """Offset, sensitivity and alignment of three sensors, from the 84 bytes of the answer."""
    said = LN_ACCELEROMETER.stored() + gyroscope(1).stored(100) + MAGNETOMETER.stored() + b"\xff" * 21
    measured = np.array([[1.0, -2.0, 9.8], [0.1, 0.2, -0.3]])
    for sensor_type, constants, usual, unit in (
        ("accelerometer", LN_ACCELEROMETER, calibration.LN_PER_MS2, 1.0),
        ("gyroscope", gyroscope(1), calibration.GYRO_PER_DPS[500], np.pi / 180),
        ("magnetometer", MAGNETOMETER, calibration.DLHC_PER_GAUSS, 100.0),
    ):
        kept, doubt = calibration.kinematic(sensor_type, said, usual)
        assert kept.apply(constants.counts(measured)) == pytest.approx(measured * unit, abs=1e-9)
        assert not doubt


def test_constants_of_another_range_are_not_taken_and_that_is_said():
    """Kept for 500 dps while 2000 are set: 100 dps stay 100 and do not become 25."""
    said = LN_ACCELEROMETER.stored() + gyroscope(1).stored(100) + MAGNETOMETER.stored() + b"\xff" * 21
    kept, doubt = calibration.kinematic("gyroscope", said, calibration.GYRO_PER_DPS[2000])
    assert kept.apply(np.array([[0, 1640, 0]])) == pytest.approx(np.array([[-100 * np.pi / 180, 0, 0]]))
    assert "65.5, 65.5, 65.5, usual in its range is 16.4" in doubt


@pytest.mark.parametrize("octet", [0x00, 0xFF])
def test_a_device_that_keeps_no_constants_has_the_usual_ones(octet):
    """2047 counts are 0, 83 more are 1 m/s^2 along the axis as the part is mounted."""
    usual, doubt = calibration.kinematic("accelerometer", bytes([octet]) * 84, calibration.LN_PER_MS2)
    assert not doubt
    assert usual.apply(np.array([[2047 + 83, 2047, 2047]])) == pytest.approx(np.array([[0.0, -1.0, 0.0]]))


def test_the_usual_magnetometer_counts_less_along_z():
    """An LSM303DLHC at 1.3 gauss has 1100 counts along x and y, 980 along z (its data sheet): a gauss is 100 uT."""
    usual, _ = calibration.kinematic("magnetometer", b"\xff" * 84, calibration.DLHC_PER_GAUSS)
    assert usual.apply(np.array([[1100, 1100, 980]])) == pytest.approx(np.array([[-100.0, 100.0, -100.0]]))


def test_microvolts_follow_the_gain_that_the_converter_says():
    """Gain 4 and 12 at a reference of 2.42 V; the converter's rate is not below that of the sampling."""
    ecg, emg = calibration.EXG_ECG[0], calibration.EXG_EMG[0]
    assert calibration.exg_uv_per_count(ecg) == pytest.approx((2.42e6 / 4 / 8388607,) * 2)
    assert calibration.exg_uv_per_count(emg) == pytest.approx((2.42e6 / 12 / 8388607,) * 2)
    rates = {hz: calibration.exg_registers(ecg, hz)[0] & 7 for hz in (51.2, 125, 256, 512, 1024)}
    assert rates == {51.2: 0, 125: 0, 256: 2, 512: 3, 1024: 4}


def test_answers_are_taken_whole_and_nothing_else():
    """An answer in two pieces waits; a status that nobody asked for is passed over; FE is a refusal."""
    buffer = bytearray(b"\xff\x8a\x71\x01\xff\x2f\x03\x00\x00")
    assert protocol.take_answer(buffer, Command.GET_FIRMWARE) is None
    buffer += b"\x00\x10\x09rest"
    content = protocol.take_answer(buffer, Command.GET_FIRMWARE)
    assert protocol.decode_firmware(content or b"").text == "LogAndStream 0.16.9"
    assert buffer == b"rest"
    assert protocol.take_answer(bytearray(b"\xff"), Command.START) == b""
    with pytest.raises(protocol.Refused, match="05"):
        protocol.take_answer(bytearray(b"\xfe"), Command.SET_RATE)


def test_answers_between_packets_are_no_samples_and_cost_none():
    """The battery's answer is taken out, also where it comes in pieces."""
    octets = packet(0) + b"\xff\x8a\x94\x65\x0a\x80" + packet(1) + b"\x8a\x71\x12" + packet(2) + packet(3)
    packets, found = Packets(len(packet(0)), PERIOD), []
    for octet in octets:
        found += packets.feed(bytes([octet]), 7)
    assert [type(each) for each in found] == [Packet, Answer, Packet, Answer, Packet]
    assert calibration.battery_percent(found[1].content) == pytest.approx(61.3, abs=0.5)


def test_a_packet_is_stamped_when_its_last_byte_came():
    """Not when the next ones showed that it was one."""
    packets = Packets(len(packet(0)), PERIOD)
    assert not list(packets.feed(packet(0)[:5], 100))
    assert not list(packets.feed(packet(0)[5:], 200))
    assert [each.received_ns for each in packets.feed(packet(1) + packet(2), 300)] == [200, 300]


def test_garbage_before_within_and_after_costs_what_it_hit():
    """Bytes cut out of one packet take that packet; the times of the others are right."""
    cut = packet(5)[:8]
    octets = b"\0\0\0garbage" + b"".join(map(packet, range(5))) + cut + b"".join(map(packet, range(6, 12)))
    found = list(Packets(len(packet(0)), PERIOD).feed(octets, 0))
    numbers = [each.ticks // PERIOD for each in found if isinstance(each, Packet)]
    assert numbers == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]
    assert sum(isinstance(each, FrameError) for each in found) == 2


def packets_of(stream: bytes, random: np.random.Generator) -> list[Packet]:
    """What is found in bytes that come in any pieces."""
    packets, found = Packets(len(packet(0)), PERIOD), []
    while stream:
        size = int(random.integers(1, 200))
        found += packets.feed(stream[:size], 0)
        stream = stream[size:]
    return [each for each in found if isinstance(each, Packet)]


@pytest.mark.parametrize("bit", range(32))
@pytest.mark.parametrize("first", [0, 0x00FF_F000, 0x00AB_CD37])
def test_a_flipped_bit_of_a_head_costs_its_packet_and_no_time_goes_back(bit, first):
    """Also a bit that makes whole periods: a time of before is none within a row, so that no clock seems to restart."""
    octets = [bytearray(packet(number, first)) for number in range(40)]
    octets[20][bit // 8] ^= 1 << bit % 8
    found = packets_of(b"".join(octets), np.random.default_rng(bit))
    numbers = [round((each.ticks - first) % (1 << 24) / PERIOD) for each in found]
    assert numbers[:20] == list(range(20))
    assert [number for number in numbers[20:] if number != 20] == list(range(21, 39))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), first=st.integers(0, 2**24 - 1))
@example(seed=1787140354, first=76732).via("a packet cut to its head and one byte, its neighbour at a time that fits")
@example(seed=1787140354, first=11196).via("the same at the right time")
def test_whatever_the_link_does_no_sample_is_wrong_and_none_comes_twice(seed, first):
    """Cuts, insertions apart from them, lost packets, any pieces: what comes out is what was sent, in order."""
    random = np.random.default_rng(seed)
    stream, whole = b"", []
    for number in range(300):
        octets, fate = packet(number, first), random.random()
        if fate < 0.01:
            continue  # lost as a whole
        if fate < 0.03 and whole[-1:] == [number - 1]:
            octets = octets[: random.integers(1, len(octets))]
        else:
            whole.append(number)
        apart = whole[-3:] == [number - 2, number - 1, number]
        stream += octets + (random.bytes(int(random.integers(1, 20))) if fate > 0.99 and apart else b"")
    got = packets_of(stream, random)
    numbers = [(each.ticks - first) % (1 << 24) // PERIOD for each in got]
    assert numbers == sorted(set(numbers))
    assert set(numbers) <= set(whole)
    assert len(whole) - len(numbers) <= 25  # the neighbours of what was hit, and the last
    assert all(each.octets == packet(number, first) for each, number in zip(got, numbers, strict=True))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), first=st.integers(0, 2**24 - 1))
def test_bytes_that_take_the_place_of_lost_ones_change_nothing_but_these(seed, first):
    """Cuts and insertions anywhere: every packet was sent, once, in order; a cut one is right as far as it came."""
    random = np.random.default_rng(seed)
    stream, arrived, hits = b"", {}, 0
    for number in range(300):
        octets, (fate, noise) = packet(number, first), random.random(2)
        hits += int(fate < 0.03) + int(noise > 0.99)
        if fate < 0.01:
            continue  # lost as a whole
        arrived[number] = octets[: random.integers(1, len(octets))] if fate < 0.03 else octets
        stream += arrived[number] + (random.bytes(int(random.integers(1, 20))) if noise > 0.99 else b"")
    found = packets_of(stream, random)
    got = {(each.ticks - first) % (1 << 24) / PERIOD: each.octets for each in found}
    assert list(got) == sorted(got)
    assert len(got) == len(found)
    assert all(octets.startswith(arrived[number]) for number, octets in got.items())
    whole = {number for number, octets in arrived.items() if len(octets) == len(packet(0))}
    assert len(whole - got.keys()) <= 2 * hits + 2


def test_the_gyroscopes_of_all_ranges_have_their_usual_sensitivity():
    """The table of the driver and that of the virtual device were written apart."""
    assert tuple(calibration.GYRO_PER_DPS.values()) == GYRO_PER_DPS
