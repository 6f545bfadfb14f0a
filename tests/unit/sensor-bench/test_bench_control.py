"""The control point of the virtual devices answers as the real ones were seen to."""

import pytest
from sensor_bench.polar.control import ControlPoint
from sensor_bench.polar.models import MODELS, MTU
from sensor_bench.polar.pmd import Measurement


def ask(control: ControlPoint, command: str, mtu: int = MTU) -> str:
    """The single response, in hex."""
    (response,) = control.answer(bytes.fromhex(command), mtu).responses
    return response.hex(" ")


@pytest.fixture
def h10():
    return ControlPoint(MODELS["H10"])


@pytest.fixture
def verity():
    return ControlPoint(MODELS["VeritySense"])


@pytest.mark.parametrize(
    ("command", "response"),
    [
        ("01 00", "f0 01 00 00 00 00 01 82 00 01 01 0e 00"),
        ("01 02", "f0 01 02 00 00 00 04 19 00 32 00 64 00 c8 00 01 01 10 00 02 03 02 00 04 00 08 00"),
        ("02 00", "f0 02 00 05 00"),
        ("02 00 00 01 82 00 01 01 0e 00", "f0 02 00 00 00 00"),
        ("02 02 02 01 08 00 00 01 c8 00 01 01 10 00", "f0 02 02 00 00 01"),
        ("02 02 02 01 08 00 00 01 c8 00 01 01 10 00 04 01 03", "f0 02 02 05 00"),
        ("03 02", "f0 03 02 06 00"),
        ("02 00 00 01 83 00 01 01 0e 00", "f0 02 00 08 00"),
        ("02 00 00 01 82 00 01 01 10 00", "f0 02 00 07 00"),
        ("02 02 02 01 10 00 00 01 c8 00 01 01 10 00", "f0 02 02 09 00"),
        ("02 00 00 01 82", "f0 02 00 04 00"),
        ("01 01", "f0 01 01 03 00"),
        ("01 3f", "f0 01 3f 02 00"),
        ("55 00", "f0 55 00 01 00"),
        ("01", "f0 01 00 04 00"),
        ("02 09", "f0 02 09 03 00"),
        ("05", "f0 05 00 00 00 00 02"),
    ],
)
def test_h10_answers(h10, command, response):
    """An H10 in its first state answers each command with these bytes."""
    assert ask(h10, command) == response


def test_a_small_mtu_is_refused_with_the_odd_four_bytes(h10):
    """With the default ATT MTU an H10 answers F0 00 01 0A."""
    assert ask(h10, "01 00", mtu=23) == "f0 00 01 0a"


def test_start_twice_stop_and_start_again(h10):
    """A second start is 'already in state'; after a stop, or a lost link, the stream starts again."""
    start = "02 00 00 01 82 00 01 01 0e 00"
    assert ask(h10, start) == "f0 02 00 00 00 00"
    assert ask(h10, "05") == "f0 05 00 00 00 40 02"
    assert ask(h10, start) == "f0 02 00 06 00"
    assert ask(h10, "03 00") == "f0 03 00 00 00"
    assert ask(h10, start) == "f0 02 00 00 00 00"
    h10.link_lost()
    assert ask(h10, start) == "f0 02 00 00 00 00"
    assert h10.running[Measurement.ECG].rate_hz == 130


def test_verity_settings_factor_and_sdk_mode(verity):
    """SDK mode opens further rates, silences PPI, and is only switched while nothing streams."""
    assert ask(verity, "01 02") == "f0 01 02 00 00 00 01 34 00 01 01 10 00 02 01 08 00 04 01 03"
    start = "02 02 00 01 34 00 01 01 10 00 02 01 08 00 04 01 03"
    assert ask(verity, start) == "f0 02 02 00 00 05 01 40 da 7f 39"
    assert ask(verity, "02 09") == "f0 02 09 0c 00"
    assert ask(verity, "03 02") == "f0 03 02 00 00"
    fast_ppg = "02 01 00 01 87 00 01 01 16 00 04 01 04"
    assert ask(verity, fast_ppg) == "f0 02 01 08 00"
    assert ask(verity, "02 09") == "f0 02 09 00 00"
    assert ask(verity, "06") == "f0 06 00 00 00 01"
    assert ask(verity, "02 09") == "f0 02 09 06 00"
    assert ask(verity, "04 01").startswith("f0 04 01 00 00 00 05 1c 00 2c 00 37 00 87 00 b0 00")
    assert ask(verity, "02 03") == "f0 02 03 0c 00"
    assert ask(verity, fast_ppg) == "f0 02 01 00 00"


def test_settings_that_do_not_fit_one_packet_are_paged():
    """A device with little room sends its settings in several packets, the last without the more-flag."""
    control = ControlPoint(MODELS["VeritySense"], page_bytes=7)
    pages = control.answer(bytes.fromhex("01 02"), MTU).responses
    assert [page[4] for page in pages] == [1, 1, 0]
