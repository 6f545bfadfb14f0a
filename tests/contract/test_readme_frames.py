"""Each driver's README prints a frame and, in a table `bytes | value | meaning`, what stands in it: decoded here.

The values are what the driver's own code makes of the bytes in the table; of what comes as text the table is
`text | value | meaning`, and before it stands the text as a block. A driver that `make new-driver` has just written is
let be: its own tests read its frame.
"""

import re
import struct
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import pytest
from cyton import Cyton, cyton
from sense4hri.errors import ConfigError, DeviceLost, FrameError

SERVICES = Path(__file__).resolve().parents[2] / "services"
DRIVERS = sorted(path.name for path in SERVICES.glob("driver-*"))
AS_WRITTEN = "Written by `make new-driver`"
HEADER = re.compile(r"\| (bytes|text) \| value \| meaning \|\n\|---\|---\|---\|\n")
REFUSALS = (FrameError, DeviceLost, ConfigError, ValueError, LookupError, AttributeError, StopIteration)
"""What a codec, or what is done here with its answer, raises of a frame that is none."""
NUMBER = r"(-?\d+(?:\.\d+)?)"
OCTETS = re.compile(r"`((?:[0-9A-Fa-f]{2}|\s|\|)+)`")
TEXT, BLOCK = re.compile(r"`([^`]+)`"), re.compile(r"```\w*\n(.*?)```", re.S)
UNREAD = ("not read", "told twice")
"""Values of text that may be another without anything meaning another."""


class Table(NamedTuple):
    """A frame as it is printed, and the bytes and values of its parts, row by row."""

    printed: bytes
    rows: list[tuple[bytes, str]]
    is_text: bool

    @property
    def values(self) -> list[str]:
        return [value for _, value in self.rows]


def octets_of(text: str) -> bytes:
    return b"".join(bytes.fromhex(each.replace("|", "")) for each in OCTETS.findall(text))


def text_of(text: str) -> bytes:
    return b"".join("".join(each.split()).encode() for each in TEXT.findall(text))


def tables(driver: str) -> list[Table]:
    """The tables of a README; a frame is the last code of nothing but bytes, or the last block, before its table."""
    found = []
    before, *parts = HEADER.split((SERVICES / driver / "README.md").read_text())
    for kind, part in zip(parts[::2], parts[1::2], strict=True):
        table, _, after = part.partition("\n\n")
        cells = [re.split(r"(?<!\\)\|", line)[1:3] for line in table.splitlines()]
        read = text_of if kind == "text" else octets_of
        printed = (
            BLOCK.findall(before)[-1].encode()
            if kind == "text"
            else octets_of(list(OCTETS.finditer(before))[-1].group())
        )
        found.append(Table(printed, [(read(octets), value.strip()) for octets, value in cells], kind == "text"))
        before = after
    return found


def bioharness(octets: bytes) -> list[str]:
    from driver_bioharness import protocol

    (found,) = protocol.take(bytearray(octets))
    head = protocol.decode_head(found.content)
    day, of_day_ns = divmod(head.first_ns, 86_400 * 10**9)
    date = datetime.fromtimestamp(day * 86_400, UTC)
    values = protocol.decode_samples(protocol.Kind(found.kind), head.octets)[:, 0]
    return [
        "STX",
        protocol.Kind(found.kind).name.lower(),
        str(len(found.content)),
        str(head.sequence),
        f"{date.year}, {date.month}, {date.day}",
        str(of_day_ns // 10**6),
        ", ".join(f"{value:g}" for value in values),
        str(protocol.crc8(found.content)),
        "ETX" if octets[-1] == 0x03 else "?",
    ]


def bitalino(octets: bytes) -> list[str]:
    from driver_bitalino import protocol

    def numbered(number: int) -> bytes:
        candidates = [octets[:-1] + bytes([number << 4 | crc]) for crc in range(16)]
        return next(each for each in candidates if protocol.crc_fits(np.frombuffer(each, np.uint8)[None])[0])

    number = octets[-1] >> 4
    (run,) = protocol.Frames(2).take(bytearray(octets + numbered(number + 1) + numbered(number + 2)))
    counts, digital = run.counts[0].tolist(), run.digital[0].tolist()
    ports = ", ".join(f"{name} {bit}" for name, bit in zip(("I1", "I2", "O1", "O2"), digital, strict=True))
    return [f"A2 {counts[1]}, A1 {counts[0]}, {ports}", f"{number}, {octets[-1] & 15}"]


def heart_rate(octets: bytes) -> list[str]:
    from sense4hri.gatt import decode_heart_rate

    measured = decode_heart_rate(octets)
    return [
        f"{octets[0] >> 4:04b} {octets[0] & 15:04b}, {'worn' if measured.contact else '?'}",
        f"{measured.bpm} 1/min",
        ", ".join(f"{each:g} ms" for each in measured.rr_ms),
    ]


def oximeter(octets: bytes) -> list[str]:
    from driver_ble_heart_rate.protocol import decode_continuous

    told = {each.name: each.values[0] for each in decode_continuous(octets).features}
    fast, slow = (f"{told['spo2' + which]:g}, {told['heart_rate' + which]:g}" for which in ("_fast", "_slow"))
    is_device = [name for name in told if name in ("low_perfusion", "sensor_not_on_user")]
    return [
        f"{octets[0] >> 4:04b} {octets[0] & 15:04b}",
        f"{told['spo2']:g} %",
        f"{told['heart_rate']:g} 1/min",
        f"{fast}; {slow}",
        "measurement ongoing" if told["measurement_status"] == 32 and told["measurement_ongoing"] else "?",
        f"{', '.join(is_device)}".replace("_", " ") if told["device_status"] == 1 << 5 | 1 << 11 else "?",
        f"{told['pulse_amplitude_index']:g} %",
    ]


def polar_ecg(octets: bytes) -> list[str]:
    from driver_polar import protocol

    taken = protocol.parse(octets)
    frame = protocol.decode(taken)
    return [
        f"{octets[0]}, {taken.measurement.name}",
        str(frame.device_ns),
        f"{'compressed' if taken.compressed else 'raw'}, type {taken.frame_type}",
        *(f"{value:g} {frame.unit}" for value in frame.samples[:, 0]),
    ]


def polar_acceleration(octets: bytes) -> list[str]:
    from driver_polar import protocol

    taken = protocol.parse(octets)
    samples = protocol.decode(taken).samples / 9.80665e-3
    first, second = (", ".join(f"{value:.0f}" for value in row) for row in samples)
    return [
        f"{octets[0]}, {taken.measurement.name}",
        f"{taken.device_ns} ns",
        f"{'compressed' if taken.compressed else 'raw'}, type {taken.frame_type}",
        first,
        f"{octets[16]} bits, {octets[17]} sample",
        f"{second}; rest {octets[20] >> 2:06b}",
    ]


def pupil_core(octets: bytes) -> list[str]:
    from driver_pupil_labs.protocol import decode

    topic, payload = octets[:11].decode(), octets[11:]
    gaze = decode(topic, payload)
    names = [each.decode() for each in re.findall(rb"[a-z_]{5,}", payload)]
    return [
        topic,
        str(payload[0] & 15),
        names[0],
        f"{gaze.x!r}, {gaze.y!r}",
        names[1],
        f"{gaze.confidence!r}",
        names[2],
        f"{struct.unpack('>d', payload[-19:-11])[0]!r} s: {gaze.time_ns} ns",
        names[3],
        "empty" if payload[-1] == 0x90 else "?",
    ]


def pupil_neon(octets: bytes) -> list[str]:
    from driver_pupil_labs.companion import decode_gaze

    look = decode_gaze(octets)
    unread = ("{} " * 6).strip()
    left, right = (unread.format(*(f"{each:g}" for each in struct.unpack_from("!6f", octets, at))) for at in (13, 41))
    sizes = [f"{each:.9g} mm" for each in look.sizes_mm or ()]
    worn = "worn" if look.worn else "not worn"
    return [f"{look.x:.9g}, {look.y:.9g} px", worn, sizes[0], left, sizes[1], right]


def serial(octets: bytes) -> list[str]:
    from driver_serial.description import parse
    from driver_serial.protocol import Frames

    described = parse(
        '{format: struct, begins: "a5 5a", fields: [t u32, n u8, gsr u16, belt u16, ppg u16], checksum: sum8,'
        " time: {field: t, unit: ms}, counter: {field: n, bits: 8}, streams: {"
        "eda: {rate_hz: 50, unit: uS, range: [0, 20], bits: 10, channels: {eda: {field: gsr}}},"
        "respiration: {rate_hz: 50, unit: a.u., range: [0, 9], bits: 10, channels: {respiration: {field: belt}}},"
        "ppg: {rate_hz: 50, unit: counts, range: [0, 9], bits: 10, channels: {ppg_0: {field: ppg}}}}}"
    )
    (fields,) = Frames(described).take(bytearray(octets))
    return ["begin", *(f"{fields[name]:g}" for name in ("t", "n", "gsr", "belt", "ppg")), str(octets[-1])]


def shimmer(octets: bytes) -> list[str]:
    from driver_shimmer import calibration
    from driver_shimmer.protocol import Layout

    layout = Layout((0x00, 0x01, 0x02, 0x12, 0x1C))
    counts = layout.counts([octets], ("accelerometer", "ppg", "eda"))
    axes, _ = calibration.kinematic("accelerometer", bytes(21), calibration.LN_PER_MS2)
    moved = ", ".join(f"{value:.1f}" for value in axes.apply(counts["accelerometer"])[0])
    skin = int(counts["eda"].item())
    conductance_us = calibration.conductance_us(counts["eda"]).item()
    range_of = int(calibration.gsr_ranges(counts["eda"]).item())
    return [
        "data" if octets[0] == 0 else "?",
        str(int.from_bytes(octets[1:4], "little")),
        f"{', '.join(map(str, counts['accelerometer'][0].tolist()))}: {moved} m/s^2",
        str(counts["ppg"].item()),
        f"0x{skin:04x}: range {range_of}, {skin & 0x0FFF}: {conductance_us:.2f} uS",
    ]


def vernier(octets: bytes) -> list[str]:
    from driver_vernier.protocol import Frames, checksum, decode

    (frame,) = Frames().take(octets)
    measured = decode(frame)
    force, rate = (measured.values[channel] for channel in (1, 2))
    first, second = (f"{force[at]:.3f} N, {rate[at]:g}".replace("nan", "NaN") for at in (0, 1))
    return [
        "measurement",
        str(len(frame)),
        str(measured.counter),
        str(checksum(frame)),
        "32-bit floats",
        ", ".join(map(str, measured.values)),
        str(len(force)),
        "?",
        first,
        second,
    ]


def brainflow(board: Cyton, octets: bytes) -> list[str]:
    from driver_brainflow.config import BrainflowConfig, sources_of
    from driver_brainflow.protocol import Reader
    from driver_brainflow.transport import description

    rows = board.rows(octets, 199)
    config = BrainflowConfig(sensor_id="eeg_1", board="CYTON", streams=("eeg", "accelerometer", "other"))
    reader = Reader("CYTON", "default", description("CYTON")["default"], sources_of(config), False)
    told = {item.sensor_type: item for item in reader.items(rows, 0, 0.0) if item.lost}
    eeg, moved, other = (told[name].chunk for name in config.streams)
    electrodes = [f"{name} {value:.3f} uV" for name, value in zip(eeg.channels, eeg.samples[0], strict=True)]
    axes = [f"{name} {value:.4f} m/s^2" for name, value in zip(moved.channels, moved.samples[0], strict=True)]
    number = f"{rows[0, -1]:g}, {told['eeg'].lost} missing"
    return ["begin", number, *electrodes, *axes, f"{other.samples[0, 0]:g}"]


def played(name: str, octets: bytes, *streams: str) -> tuple[dict[str, Any], Any]:
    """The streams of a file of these bytes by sensor type, and all that is in it."""
    from driver_file.config import FileConfig
    from driver_file.transport import read

    with TemporaryDirectory() as folder:
        (Path(folder) / name).write_bytes(octets)
        recorded, content = read(FileConfig(sensor_id="file_1", file=f"{folder}/{name}", streams=streams))
    return {each.sensor_type: each for each in recorded}, content


def seconds(time_ns: int) -> str:
    return f"{time_ns / 1e9:.3f} s"


def eyelink(octets: bytes) -> list[str]:
    left, content = played("a.asc", octets)
    right = played("a.asc", octets, "eye_tracking: gaze_x_right, gaze_y_right")[0]["eye_tracking"]
    gaze, pupils, (event,) = left["eye_tracking"], left["pupillometry"], content.events
    values = [gaze.stream.unit, ", ".join(pupils.stream.channel_names), "not read"]
    values += [seconds(event.time_ns), event.name, event.value]
    for time_ns, seen, (of_left, of_right), also in zip(
        gaze.times_ns, gaze.values, pupils.values, right.values, strict=True
    ):
        row = [", ".join(f"{each:g}" for each in seen), f"{of_left:g}", ", ".join(f"{each:g}" for each in also)]
        values += [seconds(time_ns), *row, f"{of_right:g}", "not read"]
    return ["told twice", *(value.replace("nan", "NaN") for value in values)]


def edf(octets: bytes) -> list[str]:
    channels = (("EEG Fpz-Cz", "uV", -250, 250, -2048, 2047, 2), ("EDA", "kOhm", 0, 4095, 0, 4095, 1))
    columns = list(zip(*[(each[0], "", *each[1:6], "", each[6], "") for each in channels], strict=True))
    head = [("0", 8), ("X X X X", 80), ("Startdate X X X X", 80), ("06.05.2407.08.09", 16), (256 * 3, 8), ("", 44)]
    head += [(1, 8), (1, 8), (len(channels), 4)]
    widths = (16, 80, 8, 8, 8, 8, 8, 80, 8, 32)
    head += [(cell, width) for column, width in zip(columns, widths, strict=True) for cell in column]
    recorded, _ = played("a.edf", "".join(f"{cell:<{width}}" for cell, width in head).encode() + octets)
    counts = struct.unpack("<3h", octets)
    volts = [f"{count}: {value:.3f} uV" for count, value in zip(counts, recorded["eeg"].values[:, 0], strict=False)]
    return [*volts, f"{counts[2]}: {recorded['eda'].values[0, 0]:.4f} {recorded['eda'].stream.unit}"]


def lsl_description(octets: bytes) -> list[str]:
    from driver_lsl.protocol import parse, pick

    outlet = parse(octets.decode())
    volts, skin = pick([outlet], ())
    identity = outlet.identity
    return [
        str(identity.model),
        volts.sensor_type,
        str(len(outlet.channels)),
        f"{volts.stream.resolution_bits} bits",
        str(identity.serial_number),
        f"{volts.stream.sampling_frequency_hz:g} Hz",
        outlet.host,
        str(identity.vendor),
        *volts.stream.channel_names,
        volts.stream.unit,
        f"{outlet.channels[1]}: {skin.stream.channel_names[0]}",
        skin.stream.unit,
        skin.sensor_type,
    ]


def lsl_sample(octets: bytes) -> list[str]:
    """What the inlet makes of liblsl's answers, and the driver of that."""
    from driver_lsl.config import LslConfig
    from driver_lsl.device import Tuned
    from driver_lsl.transport import Pulled
    from sense4hri import lsl, lsl_inlets
    from sense4hri.arrivals import Arrival

    frame = rf"\[{NUMBER}, {NUMBER}\] at {NUMBER} s\ntime_correction {NUMBER} s at {NUMBER} s, within {NUMBER} s\n"
    found = re.fullmatch(rf"{frame}wall clock - LSL clock {NUMBER} s\n", octets.decode())
    first, second, stamp_s, correction_s, remote_s, trip_s, apart_s = map(float, found.groups() if found else ())

    def answer(inlet: object, remote: Any, width: Any, wait_s: object, error: object) -> float:
        remote._obj.value, width._obj.value = remote_s, trip_s
        return correction_s

    clocks = lsl.Wall(round(apart_s * 1e9), 0.0)
    with patch.object(lsl_inlets.lib, "lsl_time_correction_ex", answer), patch.object(lsl, "wall", lambda _: clocks):
        measured = lsl_inlets._Clock(SimpleNamespace(obj=None)).measured()
    device = Tuned.to((tables("driver-lsl")[0].printed.decode(),), LslConfig(sensor_id="x", outlets=("type='EEG'",)))
    pulled = Pulled(0, np.array([[first, second]]), np.array([stamp_s]))
    samples = [*device.items(Arrival(0, pulled))]
    (told,) = device.items(Arrival(0, measured))
    (of,) = {each.chunk.device_ns for each in samples}
    units = {each.sensor_type: each.stream.unit for each in device._picked}
    shown = [f"{each.sensor_type} {each.chunk.channels[0]} {each.chunk.samples[0, 0]:g}" for each in samples]
    return [
        *(f"{text} {units[each.sensor_type]}" for text, each in zip(shown, samples, strict=True)),
        exactly(of),
        exactly(told.offset_ns),
        exactly(told.device_ns),
        f"{told.uncertainty_s:.6f} s",
        exactly(clocks.offset_ns),
    ]


def exactly(time_ns: int) -> str:
    return f"{time_ns // 10**9}.{time_ns % 10**9:09d} s"


DECODED: dict[str, tuple[Callable[..., list[str]], ...]] = {
    "driver-bioharness": (bioharness,),
    "driver-bitalino": (bitalino,),
    "driver-brainflow": (brainflow,),
    "driver-ble-heart-rate": (heart_rate, oximeter),
    "driver-file": (eyelink, edf),
    "driver-lsl": (lsl_description, lsl_sample),
    "driver-polar": (polar_ecg, polar_acceleration),
    "driver-pupil-labs": (pupil_core, pupil_neon),
    "driver-serial": (serial,),
    "driver-shimmer": (shimmer,),
    "driver-vernier": (vernier,),
}


@pytest.fixture
def decode(driver: str, number: int) -> Iterator[Callable[[bytes], list[str]]]:
    """What decodes the frame; a Cyton's with BrainFlow before the driver."""
    if driver != "driver-brainflow":
        yield DECODED[driver][number]
    else:
        with cyton() as board:
            yield partial(DECODED[driver][number], board)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_driver_shows_a_frame(driver):
    """So many tables as are decoded here."""
    if driver in DECODED:
        assert len(tables(driver)) == len(DECODED[driver])
    else:
        readme = (SERVICES / driver / "README.md").read_text()
        assert AS_WRITTEN in readme, f"{driver}: enter in DECODED what its codec makes of the frame in its README"


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_bytes_of_the_table_are_those_of_the_frame_above_it(driver):
    """The last code of nothing but bytes before a table is the whole frame; of text the last block, but for spaces."""
    for table in tables(driver):
        octets = b"".join(octets for octets, _ in table.rows)
        printed = b"".join(table.printed.split()) if table.is_text else table.printed
        assert printed.hex(" ") == octets.hex(" ")


FRAMES = [(driver, number) for driver, decoders in DECODED.items() for number in range(len(decoders))]


@pytest.mark.parametrize(("driver", "number"), FRAMES)
def test_a_frame_means_what_the_readme_says(driver, number, decode):
    """Value by value, as the driver's codec reads the bytes of the table."""
    table = tables(driver)[number]
    assert table.values == decode(table.printed)


@pytest.mark.parametrize(("driver", "number"), FRAMES)
def test_no_bit_of_a_frame_is_left_unread_here(driver, number, decode):
    """Another frame in the README, by one bit, is refused or means something else, but for text that is not read.

    Of text one bit of each sign is another: upper and lower case may mean the same.
    """
    table = tables(driver)[number]
    for bit, is_read in bits_of(table):
        flipped = (int.from_bytes(table.printed, "little") ^ 1 << bit).to_bytes(len(table.printed), "little")
        try:
            decoded = decode(flipped)
        except REFUSALS:
            decoded = []
        assert (decoded != table.values) is is_read, f"byte {bit // 8}, bit {bit % 8}: {flipped!r}"


def bits_of(table: Table) -> Iterator[tuple[int, bool]]:
    """Each bit of a frame of bytes, the lowest of each sign of a text, and whether it is read."""
    if not table.is_text:
        yield from ((bit, True) for bit in range(8 * len(table.printed)))
        return
    signs = (at for at, sign in enumerate(table.printed.decode("ascii")) if not sign.isspace())
    for octets, value in table.rows:
        for _ in octets:
            yield 8 * next(signs), value not in UNREAD
