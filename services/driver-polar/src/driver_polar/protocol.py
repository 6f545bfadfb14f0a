"""Bytes of Polar Measurement Data (PMD) notifications to samples in canonical units; no I/O, no clock.

Wire format and a frame decoded byte by byte: see the service's README.
"""

import struct
from enum import IntEnum
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

from driver_polar.delta import decode_delta, signed_values

HEADER = struct.Struct("<BQB")  # measurement, device time of the last sample [ns since 2000-01-01], frame type
COMPRESSED = 0x80  # bit of the frame type

STANDARD_GRAVITY = 9.80665  # m/s^2 per g
RADIANS = pi / 180
MICROTESLA = 100.0  # per gauss


class Measurement(IntEnum):
    """Measurement types: lower six bits of a frame's first byte, and byte 1 of a control point command."""

    ECG = 0
    PPG = 1
    ACCELERATION = 2
    PP_INTERVAL = 3
    GYROSCOPE = 5
    MAGNETOMETER = 6
    SKIN_TEMPERATURE = 7
    SDK_MODE = 9
    LOCATION = 10
    PRESSURE = 11
    TEMPERATURE = 12
    OFFLINE_RECORDING = 13
    OFFLINE_HEART_RATE = 14


class Notification(NamedTuple):
    """A frame taken apart, its content still bytes. device_ns is None where the device sent no time (zero)."""

    measurement: Measurement
    device_ns: int | None
    frame_type: int
    compressed: bool
    content: bytes


class Status(NamedTuple):
    """What a frame says beside its samples, e.g. a magnetometer's calibration; values int64, one per sample or less."""

    name: str
    values: NDArray[np.int64]


class Frame(NamedTuple):
    """Samples of one frame: float64, shape (n, channels), in `unit`. device_ns is the time of the last one."""

    measurement: Measurement
    device_ns: int | None
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    unit: str
    status: tuple[Status, ...] = ()


class Intervals(NamedTuple):
    """Pulse-to-pulse intervals of one frame, oldest first; device_ns is the end of the last one.

    blocked: the device moved, the interval is invalid. contact: None where the device cannot tell.
    """

    device_ns: int | None
    heart_rate_bpm: tuple[int, ...]
    interval_ms: tuple[int, ...]
    error_ms: tuple[int, ...]
    blocked: tuple[bool, ...]
    contact: tuple[bool | None, ...]


class Layout(NamedTuple):
    """How one frame type lays out a sample: all values of one size, signal channels first, status words last."""

    channels: tuple[str, ...]
    size: int  # bytes of a value; of a value of the reference sample where compressed
    unit: str
    scale: float = 1.0  # unit per count; per count times the device's factor where compressed
    status: tuple[str, ...] = ()
    float32: bool = False


def _ppg(count: int) -> tuple[str, ...]:
    return tuple(f"ppg_{index}" for index in range(count))


XYZ = ("x", "y", "z")
OPTICAL = (*_ppg(3), "ambient")
ECG, PPG, ACC = Measurement.ECG, Measurement.PPG, Measurement.ACCELERATION
GYRO, MAG, TEMP = Measurement.GYROSCOPE, Measurement.MAGNETOMETER, Measurement.SKIN_TEMPERATURE

RAW: dict[tuple[Measurement, int], Layout] = {
    (ECG, 0): Layout(("ecg",), 3, "uV"),
    (ACC, 0): Layout(XYZ, 1, "m/s^2", 1e-3 * STANDARD_GRAVITY),
    (ACC, 1): Layout(XYZ, 2, "m/s^2", 1e-3 * STANDARD_GRAVITY),
    (ACC, 2): Layout(XYZ, 3, "m/s^2", 1e-3 * STANDARD_GRAVITY),
    (PPG, 0): Layout(OPTICAL, 3, "counts"),
    (TEMP, 0): Layout(("temperature",), 4, "degC", float32=True),
}
DELTA: dict[tuple[Measurement, int], Layout] = {
    (ACC, 0): Layout(XYZ, 2, "m/s^2", STANDARD_GRAVITY),
    (ACC, 1): Layout(XYZ, 2, "m/s^2", 1e-3 * STANDARD_GRAVITY),
    (PPG, 0): Layout(OPTICAL, 3, "counts"),
    (PPG, 7): Layout(_ppg(16), 3, "counts", status=("status",)),
    (PPG, 8): Layout(_ppg(24), 3, "counts", status=("status",)),
    (PPG, 10): Layout(_ppg(20), 3, "counts", status=("status",)),  # eight red, six green, six infrared
    (PPG, 13): Layout(_ppg(2), 3, "counts", status=("status",)),
    (GYRO, 0): Layout(XYZ, 2, "rad/s", RADIANS),
    (GYRO, 1): Layout(XYZ, 4, "rad/s", RADIANS, float32=True),
    (MAG, 0): Layout(XYZ, 2, "uT", MICROTESLA),
    (MAG, 1): Layout(XYZ, 2, "uT", 1e-3 * MICROTESLA, status=("calibration",)),
    (TEMP, 0): Layout(("temperature",), 4, "degC", float32=True),
}


def parse(frame: bytes) -> Notification:
    """Take a notification apart. Raises FrameError for a short frame or an unknown measurement."""
    if len(frame) <= HEADER.size:
        raise FrameError(f"PMD frame of {len(frame)} bytes ({frame.hex()}), a header and one sample are more")
    first, device_ns, frame_type = HEADER.unpack_from(frame)
    try:
        measurement = Measurement(first & 0x3F)
    except ValueError as err:
        raise FrameError(f"PMD frame of unknown measurement {first & 0x3F} ({frame[:12].hex()}...)") from err
    compressed, content = bool(frame_type & COMPRESSED), frame[HEADER.size :]
    return Notification(measurement, device_ns or None, frame_type & ~COMPRESSED, compressed, content)


def decode(notification: Notification, factor: float = 1.0) -> Frame | Intervals:
    """Return the samples in canonical units, or the intervals of a PP_INTERVAL frame.

    factor: the scale the device named when the stream was started; it applies to compressed frames only.
    Raises FrameError where the frame type is unknown or the content is not whole.
    """
    key = (notification.measurement, notification.frame_type)
    if notification.compressed:
        if key in DELTA:
            return _delta(notification, DELTA[key], factor)
    elif key in RAW:
        return _raw(notification, RAW[key])
    elif key in PACKED:
        return _packed(notification)
    elif key == (Measurement.PP_INTERVAL, 0):
        return _intervals(notification)
    kind = "compressed" if notification.compressed else "raw"
    raise FrameError(f"{notification.measurement.name} {kind} frame type {notification.frame_type} is not supported")


def _raw(frame: Notification, layout: Layout) -> Frame:
    _whole(frame, len(layout.channels) * layout.size)
    return _frame(frame, layout, signed_values(frame.content, layout.size).reshape(-1, len(layout.channels)), 1.0)


def _delta(frame: Notification, layout: Layout, factor: float) -> Frame:
    values = decode_delta(frame.content, len(layout.channels) + len(layout.status), layout.size)
    return _frame(frame, layout, values.astype(np.int64), factor)


def _frame(frame: Notification, layout: Layout, values: NDArray[np.int64], factor: float) -> Frame:
    """Scale once, to the canonical unit; status words are unsigned and not scaled."""
    signals = values[:, : len(layout.channels)]
    samples = (signals.astype(np.int32).view(np.float32) if layout.float32 else signals).astype(np.float64)
    words = values[:, len(layout.channels) :] & (1 << 8 * layout.size) - 1
    status = tuple(Status(name, words[:, index]) for index, name in enumerate(layout.status))
    return Frame(
        frame.measurement, frame.device_ns, layout.channels, samples * (factor * layout.scale), layout.unit, status
    )


def _whole(frame: Notification, size: int) -> NDArray[np.uint8]:
    """Return the content as rows of one sample of `size` bytes each; raise FrameError where it is not whole."""
    if not frame.content or len(frame.content) % size:
        raise FrameError(
            f"{frame.measurement.name} frame type {frame.frame_type} holds {len(frame.content)} bytes, "
            f"not a whole number of {size}-byte samples"
        )
    return np.frombuffer(frame.content, np.uint8).reshape(-1, size)


def _intervals(frame: Notification) -> Intervals:
    rows = _whole(frame, 6).astype(np.int64)
    flags = rows[:, 5]
    return Intervals(
        frame.device_ns,
        tuple(rows[:, 0].tolist()),
        tuple((rows[:, 1] | rows[:, 2] << 8).tolist()),
        tuple((rows[:, 3] | rows[:, 4] << 8).tolist()),
        tuple((flags & 1 != 0).tolist()),
        tuple(bool(flag & 2) if flag & 4 else None for flag in flags.tolist()),
    )


def _ecg_with_contact(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[Status, ...]]:
    """ECG type 1: 14 bits of signal, then how the electrodes touch."""
    marks = rows[:, 2]
    return (rows[:, 0] | (rows[:, 1] & 0x3F) << 8)[:, None], (
        Status("oversampling", marks & 1),
        Status("skin_contact", marks >> 1 & 3),
        Status("contact_impedance", marks >> 3 & 3),
    )


def _ecg_with_pace(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[Status, ...]]:
    """ECG type 2: 18 bits of signal, then tags of the data and of a pacemaker."""
    signal = rows[:, 0] | rows[:, 1] << 8 | (rows[:, 2] & 3) << 16
    return signal[:, None], (
        Status("ecg_data_tag", rows[:, 2] >> 2 & 7),
        Status("pace_data_tag", rows[:, 2] >> 5 & 7),
    )


def _ecg_two_leads(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[Status, ...]]:
    """ECG type 3: two signals of 24 bits and a status byte."""
    signals = signed_values(np.ascontiguousarray(rows[:, :6], np.uint8).tobytes(), 3).reshape(-1, 2)
    return signals, (Status("status", rows[:, 6]),)


def _ppg_gains(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[Status, ...]]:
    """PPG types 4, 9 (twelve slots) and 14 (one): integration counts, then a pair of gains per slot."""
    slots = rows.shape[1] // 3
    gains = rows[:, slots:] & 7
    return rows[:, :0], (
        Status("integrations", rows[:, :slots].ravel()),
        Status("gain_1", gains[:, 0::2].ravel()),
        Status("gain_2", gains[:, 1::2].ravel()),
    )


def _ppg_operation_mode(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[Status, ...]]:
    return rows[:, :0], (Status("operation_mode", rows @ (1 << 8 * np.arange(4))),)


def _ppg_sport_id(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[Status, ...]]:
    return rows[:, :0], (Status("sport_id", rows @ (1 << 8 * np.arange(8))),)


# Raw frame types whose samples are bit fields or settings: bytes per sample, unit, channels, function.
PACKED = {
    (ECG, 1): (3, "uV", ("ecg",), _ecg_with_contact),
    (ECG, 2): (3, "uV", ("ecg",), _ecg_with_pace),
    (ECG, 3): (7, "uV", ("ecg_0", "ecg_1"), _ecg_two_leads),
    (PPG, 4): (36, "counts", (), _ppg_gains),
    (PPG, 5): (4, "counts", (), _ppg_operation_mode),
    (PPG, 6): (8, "counts", (), _ppg_sport_id),
    (PPG, 9): (36, "counts", (), _ppg_gains),
    (PPG, 14): (3, "counts", (), _ppg_gains),
}


def _packed(frame: Notification) -> Frame:
    size, unit, channels, unpack = PACKED[frame.measurement, frame.frame_type]
    signals, status = unpack(_whole(frame, size).astype(np.int64))
    return Frame(frame.measurement, frame.device_ns, channels, signals.astype(np.float64), unit, status)
