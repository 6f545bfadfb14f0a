"""The binary frame that carries lines from the server to the page.

Little endian, every block a multiple of 4 bytes, so that the page reads it with typed arrays and no copy.

    header  (32 bytes)  u32 magic 'S4H1' | u32 view | u32 number | u32 lanes | f64 now_ms | f64 base_ms
    lane    (16 bytes)  u16 index | u8 channels | u8 flags | u32 points | u16 gaps | u16 marks | i32 from_us
            f64 offset[channels]                only with flag OFFSETS: to be added to low and high
            i32 time_us[points]                 relative to base_ms
            f32 low[channels][points]           NaN lifts the pen
            f32 high[channels][points]
            i32 gap_us[gaps][2]                 only with flag MARKS: these replace what was known
            mark[marks] (20 bytes each)         only with flag MARKS: i32 from_us | i32 to_us | u16 kind | i16 channel |
                                                f32 x | f32 y; kind: its place in the stream's `drawn`, channel -1: all

`view` is the number of the client's view that the frame answers, `index` a lane's place in that view, `now_ms` the
right edge and `base_ms` the zero of the frame's times, both in ms since the Unix epoch. A lane's points replace
everything the page knows from `from_us` on; with flag FULL everything it knows.
"""

import struct
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from web_gui.columns import Columns
from web_gui.marks import MARK, Rows

MAGIC = 0x31483453
FULL, MARKS, OFFSETS = 1, 2, 4
_HEADER = struct.Struct("<IIIIdd")
_LANE = struct.Struct("<HBBIHHi")
_WIRE = np.dtype(
    [("from_us", "<i4"), ("to_us", "<i4"), ("kind", "<u2"), ("channel", "<i2"), ("x", "<f4"), ("y", "<f4")]
)
_AS_THEY_ARE = ("kind", "channel", "x", "y")
_NONE = np.empty(0, MARK)
_FURTHEST_US = 2**31 - 1
MOST_MARKS = 65535


@dataclass(frozen=True)
class LanePart:
    """What is new in one lane. Times in ns on the axis; marks None = unchanged."""

    index: int
    full: bool
    from_ns: int
    line: Columns
    gaps_ns: list[tuple[int, int]] | None = None
    marks: Rows | None = None


@dataclass(frozen=True)
class Frame:
    """One message to the page."""

    view: int
    number: int
    now_ns: int
    base_ns: int
    lanes: list[LanePart] = field(default_factory=list)


def encode(frame: Frame) -> bytes:
    """Return a frame as bytes. Times further than 35 min from its base are cut to that."""
    parts = [_HEADER.pack(MAGIC, frame.view, frame.number, len(frame.lanes), frame.now_ns / 1e6, frame.base_ns / 1e6)]
    for lane in frame.lanes:
        parts += _encode_lane(lane, frame.base_ns)
    return b"".join(parts)


def decode(data: bytes) -> Frame:
    """Return the frame that bytes hold; times are whole microseconds. Raises ValueError for anything else."""
    if len(data) < _HEADER.size:
        raise ValueError(f"a frame has at least {_HEADER.size} bytes, not {len(data)}")
    magic, view, number, lanes, now_ms, base_ms = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise ValueError(f"a frame begins with {MAGIC:#x}, not {magic:#x}")
    base_ns, at, found = _micro_ns(base_ms), _HEADER.size, []
    for _ in range(lanes):
        lane, at = _decode_lane(data, at, base_ns)
        found.append(lane)
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes after the last lane")
    return Frame(view, number, _micro_ns(now_ms), base_ns, found)


def _encode_lane(lane: LanePart, base_ns: int) -> list[bytes]:
    gaps = (lane.gaps_ns or [])[-MOST_MARKS:]
    marks = (_NONE if lane.marks is None else lane.marks)[-MOST_MARKS:]
    low, high = lane.line.low, lane.line.high
    offsets: NDArray[np.floating] = _offsets(low) if low.dtype == np.float64 else np.empty(0)
    if len(offsets):
        low, high = low - offsets, high - offsets
    flags = FULL * lane.full + MARKS * (lane.marks is not None) + OFFSETS * bool(len(offsets))
    points, channels = low.shape
    head = _LANE.pack(
        lane.index, channels, flags, points, len(gaps), len(marks), int(_micros([lane.from_ns], base_ns)[0])
    )
    return [
        head,
        offsets.astype("<f8").tobytes(),
        _micros(lane.line.times_ns, base_ns).tobytes(),
        np.ascontiguousarray(low.T, "<f4").tobytes(),
        np.ascontiguousarray(high.T, "<f4").tobytes(),
        _micros(gaps, base_ns).tobytes(),
        _on_wire(marks, base_ns).tobytes(),
    ]


def _decode_lane(data: bytes, at: int, base_ns: int) -> tuple[LanePart, int]:
    try:
        index, channels, flags, points, gaps, marks, from_us = _LANE.unpack_from(data, at)
        at += _LANE.size
        offsets, at = _numbers(data, at, "<f8", channels if flags & OFFSETS else 0)
        times, at = _numbers(data, at, "<i4", points)
        low, at = _numbers(data, at, "<f4", points * channels)
        high, at = _numbers(data, at, "<f4", points * channels)
        gap_us, at = _numbers(data, at, "<i4", 2 * gaps)
        told, at = _numbers(data, at, _WIRE, marks)
    except (struct.error, ValueError) as err:
        raise ValueError(f"a lane is cut off at byte {at}") from err
    low, high = low.reshape(channels, points).T, high.reshape(channels, points).T
    if len(offsets):
        low, high = low + offsets, high + offsets
    line = Columns(_nanos(times, base_ns), low, high)
    part = LanePart(index, bool(flags & FULL), base_ns + from_us * 1000, line)
    if not flags & MARKS:
        return part, at
    pairs = [(int(a), int(b)) for a, b in _nanos(gap_us, base_ns).reshape(-1, 2)]
    return replace(part, gaps_ns=pairs, marks=_from_wire(told, base_ns)), at


def _offsets(low: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return what each channel lies around: single precision is exact for what is left."""
    offsets, told = np.zeros(low.shape[1]), np.isfinite(low).any(axis=0)
    offsets[told] = np.nanmedian(low[:, told], axis=0)
    return offsets


def _on_wire(marks: Rows, base_ns: int) -> Rows:
    wire = np.empty(len(marks), _WIRE)
    wire["from_us"], wire["to_us"] = _micros(marks["from_ns"], base_ns), _micros(marks["to_ns"], base_ns)
    for name in _AS_THEY_ARE:
        wire[name] = marks[name]
    return wire


def _from_wire(wire: Rows, base_ns: int) -> Rows:
    marks = np.zeros(len(wire), MARK)
    marks["from_ns"], marks["to_ns"] = _nanos(wire["from_us"], base_ns), _nanos(wire["to_us"], base_ns)
    for name in _AS_THEY_ARE:
        marks[name] = wire[name]
    return marks


def _numbers(data: bytes, at: int, kind: str | np.dtype, count: int) -> tuple[NDArray, int]:
    return np.frombuffer(data, kind, count, at), at + np.dtype(kind).itemsize * count


def _micros(times_ns: object, base_ns: int) -> NDArray[np.int32]:
    micros = (np.asarray(times_ns, np.int64) - base_ns) // 1000
    return np.clip(micros, -_FURTHEST_US, _FURTHEST_US).astype("<i4")


def _nanos(micros: NDArray, base_ns: int) -> NDArray[np.int64]:
    return base_ns + micros.astype(np.int64) * 1000


def _micro_ns(ms: float) -> int:
    """Return ms as ns, whole microseconds: all that a double holds of a time since 1970."""
    return round(ms * 1000) * 1000
