"""Each driver's README prints a frame and, in a table `bytes | value | meaning`, what stands in it: decoded here.

The values are what the driver's own codec makes of the bytes in the table. A driver that `make new-driver` has just
written is let be: its own tests read its frame. Where a driver's bytes are another's affair it is named below.
"""

import re
import struct
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from sense4hri.errors import FrameError

SERVICES = Path(__file__).resolve().parents[2] / "services"
DRIVERS = sorted(path.name for path in SERVICES.glob("driver-*"))
AS_WRITTEN = "Written by `make new-driver`"
HEADER = "| bytes | value | meaning |\n|---|---|---|\n"
REFUSALS = (FrameError, ValueError, LookupError, AttributeError, StopIteration)
"""What a codec, or what is done here with its answer, raises of a frame that is none."""
OCTETS = re.compile(r"`((?:[0-9A-Fa-f]{2}|\s|\|)+)`")
WITHOUT_FRAME = {
    "driver-brainflow": "BrainFlow reads its boards' bytes and hands out a table of numbers",
    "driver-file": "reads files; the lines of one that the README prints are read in tests/unit/driver-file",
    "driver-lsl": "liblsl reads the bytes; the description that the README prints is XML",
}


def octets_of(text: str) -> bytes:
    return b"".join(bytes.fromhex(each.replace("|", "")) for each in OCTETS.findall(text))


def tables(readme: str) -> list[tuple[str, list[tuple[bytes, str]]]]:
    """What stands before each table of bytes, and the table's bytes and values row by row."""
    found = []
    before, *parts = readme.split(HEADER)
    for part in parts:
        table, _, after = part.partition("\n\n")
        cells = [re.split(r"(?<!\\)\|", line)[1:3] for line in table.splitlines()]
        found.append((before, [(octets_of(octets), value.strip()) for octets, value in cells]))
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


DECODED: dict[str, tuple[Callable[[bytes], list[str]], ...]] = {
    "driver-bioharness": (bioharness,),
    "driver-bitalino": (bitalino,),
    "driver-ble-heart-rate": (heart_rate, oximeter),
    "driver-polar": (polar_ecg, polar_acceleration),
    "driver-pupil-labs": (pupil_core, pupil_neon),
    "driver-serial": (serial,),
    "driver-shimmer": (shimmer,),
    "driver-vernier": (vernier,),
}


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_driver_shows_a_frame_or_is_said_to_have_none(driver):
    """So many tables as are decoded here; none where the bytes are another's."""
    readme = (SERVICES / driver / "README.md").read_text()
    shown = len(tables(readme))
    if driver in DECODED:
        assert shown == len(DECODED[driver])
    elif driver in WITHOUT_FRAME:
        assert not shown, f"{driver} {WITHOUT_FRAME[driver]}"
    else:
        assert AS_WRITTEN in readme, f"{driver}: enter in DECODED what its codec makes of the frame in its README"


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_bytes_of_the_table_are_those_of_the_frame_above_it(driver):
    """The last code of nothing but bytes before a table is the whole frame."""
    for before, rows in tables((SERVICES / driver / "README.md").read_text()):
        printed = [octets_of(each.group()) for each in OCTETS.finditer(before)]
        assert printed[-1].hex(" ") == b"".join(octets for octets, _ in rows).hex(" ")


FRAMES = [(driver, number) for driver, decoders in DECODED.items() for number in range(len(decoders))]


@pytest.mark.parametrize(("driver", "number"), FRAMES)
def test_a_frame_means_what_the_readme_says(driver, number):
    """Value by value, as the driver's codec reads the bytes of the table."""
    _, rows = tables((SERVICES / driver / "README.md").read_text())[number]
    decoded = DECODED[driver][number](b"".join(octets for octets, _ in rows))
    assert [value for _, value in rows] == decoded


@pytest.mark.parametrize(("driver", "number"), FRAMES)
def test_no_bit_of_a_frame_is_left_unread_here(driver, number):
    """Another frame in the README, by one bit, is refused or means something else."""
    _, rows = tables((SERVICES / driver / "README.md").read_text())[number]
    octets, values = b"".join(octets for octets, _ in rows), [value for _, value in rows]
    for bit in range(8 * len(octets)):
        flipped = (int.from_bytes(octets, "little") ^ 1 << bit).to_bytes(len(octets), "little")
        try:
            decoded = DECODED[driver][number](flipped)
        except REFUSALS:
            continue
        assert decoded != values, f"byte {bit // 8}, bit {bit % 8}"
