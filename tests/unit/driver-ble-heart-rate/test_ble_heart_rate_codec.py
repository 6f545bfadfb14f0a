"""Bytes of pulse oximeters and straps to numbers, against vectors and against the bench's own writing of them."""

import math
import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from driver_ble_heart_rate.protocol import Oximetry, decode_continuous, decode_sfloat, decode_spot_check
from sense4hri.errors import FrameError
from sense4hri.gatt import decode_heart_rate
from sensor_bench.ble.values import heart_rate_measurement, sfloat


def values(measured: Oximetry) -> dict[str, float]:
    return {feature.name: feature.values[0] for feature in measured.features}


@pytest.mark.parametrize(
    ("word", "number"),
    [
        (0x0062, 98.0),
        (0xF3CE, 97.4),
        (0x0FFF, -1.0),
        (0x1002, 20.0),
        (0x8001, 1e-8),
        (0x07FD, 2045.0),
        (0x0803, -2045.0),
    ],
)
def test_numbers_of_sixteen_bits(word, number):
    """Mantissa and exponent are both signed, and the base is ten."""
    assert decode_sfloat(word) == (number, "")


@pytest.mark.parametrize(
    ("word", "why"),
    [
        (0x07FF, "not_a_number"),
        (0x0800, "not_at_this_resolution"),
        (0x07FE, "positive_infinity"),
        (0x0802, "negative_infinity"),
        (0x0801, "reserved"),
    ],
)
def test_what_is_no_number_is_nan_with_its_reason(word, why):
    """Each special value is NaN and a feature whose name says which it was."""
    number, told = decode_sfloat(word)
    assert math.isnan(number)
    assert told == why
    measured = values(decode_continuous(b"\x00" + struct.pack("<HH", word, 64)))
    assert math.isnan(measured["spo2"])
    assert (measured[f"spo2_{why}"], measured["heart_rate"]) == (1.0, 64.0)


@pytest.mark.parametrize("zero", [0x0000, 0xF000])
def test_a_zero_is_no_measurement(zero):
    """A finger clip that has lost the pulse sends zeros: neither saturation nor rate can be 0; the amplitude can."""
    measured = values(decode_continuous(b"\x10" + struct.pack("<HHH", zero, zero, zero)))
    assert math.isnan(measured["spo2"])
    assert math.isnan(measured["heart_rate"])
    assert (measured["spo2_zero"], measured["heart_rate_zero"], measured["pulse_amplitude_index"]) == (1.0, 1.0, 0.0)


def test_every_tenth_that_a_device_can_send_comes_back():
    """Written by the bench, read here: 0 to 204.7 in tenths."""
    for tenths in range(2048 - 3):
        assert decode_sfloat(int.from_bytes(sfloat(tenths / 10), "little")) == (tenths / 10, "")


def test_a_continuous_measurement_with_everything():
    """The frame of the README: three pairs, both status words, the amplitude."""
    measured = decode_continuous(bytes.fromhex("1f cef3 4000 cef3 4100 cdf3 3f00 2000 200800 2300".replace(" ", "")))
    assert (measured.device_ns, measured.contact) == (None, False)
    assert values(measured) == {
        "spo2": 97.4, "heart_rate": 64.0, "spo2_fast": 97.4, "heart_rate_fast": 65.0, "spo2_slow": 97.3,
        "heart_rate_slow": 63.0, "measurement_status": 32.0, "measurement_ongoing": 1.0, "device_status": 2080.0,
        "low_perfusion": 1.0, "sensor_not_on_user": 1.0, "pulse_amplitude_index": 35.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("flags", "date", "expected"),
    [
        (0x01, (2024, 2, 29, 23, 59, 58), datetime(2024, 2, 29, 23, 59, 58, tzinfo=UTC)),
        (0x11, (2024, 2, 29, 23, 59, 58), None),
        (0x01, (0, 0, 0, 0, 0, 0), None),
        (0x01, (2023, 2, 29, 1, 1, 1), None),
    ],
)
def test_a_spot_check_says_when_it_was_made(flags, date, expected):
    """A date that cannot be, or a clock that was never set, is no time."""
    measured = decode_spot_check(bytes([flags]) + struct.pack("<HHHBBBBB", 97, 64, *date))
    assert measured.device_ns == (None if expected is None else round(expected.timestamp()) * 1_000_000_000)
    assert ("clock_not_set" in values(measured)) == bool(flags & 0x10)


@pytest.mark.parametrize("decode", [decode_continuous, decode_spot_check, decode_heart_rate])
def test_whatever_comes_is_decoded_or_refused(decode):
    """Ten thousand random values of every length up to 30: a number or a FrameError, nothing else."""
    rng = np.random.default_rng(12)
    read = 0
    for _ in range(10_000):
        value = rng.integers(0, 256, rng.integers(0, 31), dtype=np.uint8).tobytes()
        try:
            decode(value)
            read += 1
        except FrameError as err:
            assert value.hex() in str(err)  # noqa: PT017
    assert read > 0


def test_a_measurement_cut_anywhere_is_refused():
    """No prefix of a whole value is taken for one, and nothing may follow it."""
    whole = bytes.fromhex("1fcef34000cef34100cdf33f0020002008002300")
    for at in range(len(whole)):
        with pytest.raises(FrameError):
            decode_continuous(whole[:at])
    with pytest.raises(FrameError):
        decode_continuous(whole + b"\0")


def test_intervals_of_any_heart_come_back_exactly():
    """What the bench writes of random hearts is read with every interval, none rounded, none lost."""
    rng = np.random.default_rng(7)
    for _ in range(500):
        counts = rng.integers(0, 0x10000, rng.integers(0, 9)).tolist()
        contact, energy = [None, False, True][rng.integers(3)], [None, 0, 0xFFFF][rng.integers(3)]
        bpm = int(rng.integers(0, 400))
        measured = decode_heart_rate(heart_rate_measurement(bpm, counts, contact, energy))
        assert (measured.bpm, measured.contact, measured.energy_kj) == (bpm, contact, energy)
        assert [ms * 1.024 for ms in measured.rr_ms] == counts
