"""The file that describes a board: what it says is checked, and what follows from it."""

import asyncio
import socket
from pathlib import Path

import pytest
from driver_serial.checksums import CHECKSUMS
from driver_serial.config import SerialConfig
from driver_serial.description import Description, load, parse
from driver_serial.device import Board, silence_of
from driver_serial.transport import connected
from sense4hri.errors import ConfigError, DeviceLost
from sensor_bench.board.firmware import FORMATS
from serial_board import FORMS, STREAMS, STUDY, TIME


def test_a_missing_board_file_ends_the_driver() -> None:
    """Waiting does not make one; the path is named."""
    with pytest.raises(ConfigError, match=r"board: /nowhere/board\.yaml cannot be read: No such file"):
        load("/nowhere/board.yaml")


@pytest.mark.parametrize(("eda_hz", "ppg_hz", "limit_s"), [(0, 0, None), (0.1, 50, 5), (0, 0.5, 40), (0.1, 0.1, 200)])
def test_the_fastest_stream_says_when_a_board_is_silent(eda_hz: float, ppg_hz: float, limit_s: float | None) -> None:
    """Irregular streams alone are never silent; a slow one beside a fast one is no reason to wait longer."""
    text = FORMS["json"] + STREAMS.replace("rate_hz: 50", f"rate_hz: {eda_hz}", 1)
    silence = silence_of(parse(text.replace("rate_hz: 50", f"rate_hz: {ppg_hz}")))
    silence._heard_s = {name: heard_s - (limit_s or 1e6) for name, heard_s in silence._heard_s.items()}

    async def watched() -> str:
        return await silence.watch(asyncio.sleep(0.05, "came"))

    if limit_s is None:
        assert asyncio.run(watched()) == "came"
        return
    with pytest.raises(DeviceLost, match=f"no frame for {limit_s} s"):
        asyncio.run(watched())


def test_what_is_written_to_a_board_may_be_any_bytes(tmp_path: Path) -> None:
    """A character up to U+00FF of start and stop is one byte."""
    text = FORMS["csv"] + STREAMS + r'start: "\xa5\x00\xffgo\n"' + "\n" + r'stop: "\x80\r"' + "\n"
    path = str(tmp_path / "board")

    async def written() -> bytes:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path)
            server.listen()
            async with connected(path, parse(text)):
                board, _ = server.accept()
            with board:
                board.settimeout(5)
                return b"".join(iter(lambda: board.recv(100), b""))

    assert asyncio.run(written()) == b"\xa5\x00\xffgo\n\x80\r"


def test_checksums_are_those_everybody_means() -> None:
    """The check values of the catalogues for `123456789`."""
    values = {name: each.of(b"123456789") for name, each in CHECKSUMS.items()}
    assert values == {"none": 0, "sum8": 0xDD, "xor8": 0x31, "nmea": 0x31, "crc8": 0xF4, "crc16": 0x29B1}


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("format: csv", "format: cvs", r"format is \"?'?cvs"),
        ("rate_hz: 50", "rate_hz: fast", "streams.eda.rate_hz is"),
        ("unit: uS", "unit: mV", "streams.eda.unit: unit 'mV' of eda"),
        ("unit: uS", "unti: uS", "unti.* is not a field"),
        (
            "field: gsr",
            "field: grs",
            "streams.eda.channels.eda.field is 'grs', which is not among the fields t",
        ),
        ("range: [0, 100]", "range: [100, 0]", r"streams.eda.range is \[100.0, 0.0\]"),
        ("fields: [t, n", "fields: [t t, n", r"fields\[0\] is 't t'"),
        ("fields: [t, n", "fields: [t, t", r"fields\[1\] is 't', as an earlier one"),
        ("scale: 0.01", "scale: 0,01", "1 is not a field of streams.eda.channels.eda; fields are field, scale, offset"),
        ("fields: [t, n, gsr, belt, ppg]", "", "fields is missing"),
        ("{field: t, unit: ms", "{field: t, unit: min", "time.unit is"),
        ("format: csv", "format: [csv", "no YAML"),
        ("format: csv", "format: cobs\nchecksum: nmea", "checksum is 'nmea', which is of text alone"),
        ("format: csv", "format: csv\nseparator: ''", "separator is empty"),
        ("format: csv", "format: csv\nbegins: a5 5", "begins is 'a5 5', must be bytes in two hexadecimal digits each"),
        (
            "belt, ppg]\ntime: {field: t",
            "_, ppg]\ntime: {field: _",
            "time.field is '_', which is not among the fields t",
        ),
        ("scale: 0.01", "scale: .nan", "streams.eda.channels.eda: scale nan and offset 0 must be finite"),
        ("scale: 0.01", "offset: .inf", "streams.eda.channels.eda: scale 1 and offset inf must be finite"),
        ("range: [0, 100]", "range: [.nan, 100]", r"streams.eda.range is \[nan, 100.0\]"),
        ("range: [0, 100]", "range: [0, .inf]", r"streams.eda.range is \[0.0, inf\]"),
        ("format: csv", "format: csv\nstart: µ=5€", "start is 'µ=5€', must be of characters up to U.00FF"),
    ],
)
def test_a_wrong_description_is_named_with_its_place(tmp_path: Path, right: str, wrong: str, said: str) -> None:
    """What is wrong, where, and what it must be; the driver ends with status 78."""
    text = FORMS["csv"] + TIME + STREAMS
    assert right in text
    (tmp_path / "board.yaml").write_text(text.replace(right, wrong, 1))
    config = SerialConfig(sensor_id="b_1", board=str(tmp_path / "board.yaml"))

    async def drive() -> None:
        await anext(Board(config, {}).stream())

    with pytest.raises(ConfigError, match=said):
        asyncio.run(drive())


@pytest.mark.parametrize("key", ["time", "counter"])
@pytest.mark.parametrize(("kind", "bits", "fits"), [("u16", 32, False), ("u16", 16, True), ("f64", 32, True)])
def test_a_field_that_wraps_earlier_than_is_said_is_a_mistake(key: str, kind: str, bits: int, fits: bool) -> None:
    """A `u16` of ms begins again after 65 s: with the 32 bits of millis() each time would look like a reset."""
    said = f"format: cobs\nfields: [t {kind}, gsr u16, ppg u16]\n{key}: {{field: t, bits: {bits}}}\n"
    if fits:
        assert parse(said + STREAMS).names == ("t", "gsr", "ppg")
        return
    with pytest.raises(ValueError, match=f"{key}.bits is 32, must be at most the 16 of its field t u16"):
        parse(said + STREAMS)


def test_a_time_of_a_type_with_a_sign_is_a_mistake() -> None:
    """From half its round on every time would be below zero, and refused: 35 minutes of micros()."""
    said = "format: cobs\nfields: [t i32, gsr u16, ppg u16]\ntime: {field: t}\n"
    with pytest.raises(ValueError, match=r"time\.field is 't i32', must be of a type without a sign: u32"):
        parse(said + STREAMS)


def test_the_readme_s_sketch_is_one_of_the_forms() -> None:
    """The study's description reads what the emulator's csv sends."""
    assert isinstance(parse(STUDY.read_text()), Description)
    assert set(FORMATS) == set(FORMS)
