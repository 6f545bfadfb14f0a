"""Bytes in, fields out, as a description says; finds the next frame after bytes that are none. No port, no clock."""

import json
import struct
from collections.abc import Iterator, Mapping
from typing import Literal

from sense4hri.errors import FrameError

from driver_serial.checksums import CHECKSUMS
from driver_serial.description import Description

LONGEST = 4096  # bytes without an end of a frame
SHOWN = 24
Fields = Mapping[str, float]


class Frames:
    """Takes the frames of one connection out of what comes. running: the board was sending before its `start`."""

    def __init__(self, described: Description, running: bool = False) -> None:
        self._described, self._wanted = described, described.wanted
        self._checksum = CHECKSUMS[described.checksum]
        self._layout = struct.Struct(described.layout) if described.format in ("struct", "cobs") else None
        self._order: Literal["little", "big"] = "little" if described.byte_order == "little" else "big"
        self._of_three_bytes = described.of_three_bytes
        self._joined = False  # a driver that connects in the middle of a frame has seen its end
        rest_may_fit = described.format in ("csv", "pairs") and not self._checksum.size  # `512` cut to `12`
        self._believes_first = not rest_may_fit or (bool(described.start) and not running)
        self._size = len(described.first_octets) + (self._layout.size if self._layout else 0) + self._checksum.size
        self._told = self._size - 1  # bytes to come of a struct that was told of; at first the rest of one

    def take(self, buffer: bytearray) -> Iterator[Fields | FrameError]:
        """Take every whole frame out of the buffer; what is none becomes the error that says what came."""
        if self._described.format == "struct":
            yield from self._structs(buffer)
        else:
            yield from self._delimited(buffer, 0 if self._described.format == "cobs" else 10)

    def _delimited(self, buffer: bytearray, end: int) -> Iterator[Fields | FrameError]:
        while (at := buffer.find(end)) >= 0:
            content = bytes(buffer[:at]).strip() if end else bytes(buffer[:at])
            del buffer[: at + 1]
            if content and not (end and content.startswith(b"#")):
                found = self._content(content)
                if self._joined or (self._believes_first and not isinstance(found, FrameError)):
                    yield found
            self._joined = True
        if len(buffer) > LONGEST:
            yield FrameError(f"{len(buffer)} bytes without an end of a frame ({_shown(buffer)})")
            buffer.clear()
            self._joined = self._believes_first = False  # what comes next is the rest of it

    def _structs(self, buffer: bytearray) -> Iterator[Fields | FrameError]:
        first, size = self._described.first_octets, self._size
        behind = b"" if self._checksum.size else first  # then the next frame's beginning is what shows a whole one
        while (at := buffer.find(first)) >= 0:
            yield from self._passed_over(buffer, at)
            if len(buffer) < size + len(behind):
                return
            found = self._binary(bytes(buffer[len(first) : size]))
            if not buffer.startswith(behind, size):
                found = FrameError(f"no next frame begins behind this one ({_shown(buffer[:size])})")
            if isinstance(found, FrameError):
                if not self._told:
                    self._told = size
                    yield found
                yield from self._passed_over(buffer, 1)  # the next may begin inside what looked like one
                continue
            self._told = 0
            del buffer[:size]
            yield found
        yield from self._passed_over(buffer, max(0, len(buffer) - len(first) + 1))

    def _passed_over(self, buffer: bytearray, count: int) -> Iterator[FrameError]:
        """Take away bytes that belong to no frame; those of a spoilt one were told of with it."""
        if (noise := count - self._told) > 0:
            yield FrameError(f"{noise} bytes that belong to no frame ({_shown(buffer[count - noise : count])})")
        self._told = -noise % self._size if noise > 0 else -noise  # its rest may come with the next read
        del buffer[:count]

    def _content(self, content: bytes) -> Fields | FrameError:
        try:
            if self._described.format == "cobs":
                return self._binary(unstuffed(content))
            text = self._checked(content).decode("ascii")
            return self._text(text)
        except (ValueError, OverflowError, RecursionError, struct.error) as err:
            return FrameError(f"{err} ({_shown(content)})")

    def _checked(self, line: bytes) -> bytes:
        """Return a line without its checksum. Raises ValueError where that is wrong."""
        if not self._checksum.size:
            return line
        content, star, digits = line.rpartition(b"*")
        if not star or int(digits, 16) != self._checksum.of(content):
            raise ValueError("wrong checksum")
        return content

    def _text(self, line: str) -> Fields:
        described = self._described
        if described.format == "json":
            return _numbers(json.loads(line), self._wanted)
        parts = [part.strip() for part in line.split(described.separator)]
        if described.format == "pairs":
            pairs = dict(_pair(part) for part in parts)
            return {name: _number(value) for name, value in pairs.items() if name in self._wanted}
        if len(parts) != len(described.names):
            raise ValueError(f"{len(parts)} values, not {len(described.names)}")
        return {name: _number(value) for name, value in zip(described.names, parts, strict=True) if name != "_"}

    def _binary(self, octets: bytes) -> Fields | FrameError:
        layout, size = self._layout or struct.Struct(""), self._checksum.size
        if len(octets) != layout.size + size:
            return FrameError(f"frame of {len(octets)} bytes, not {layout.size + size} ({_shown(octets)})")
        content = octets[: layout.size]
        if int.from_bytes(octets[layout.size :], self._order) != self._checksum.of(content):
            return FrameError(f"wrong checksum ({_shown(octets)})")
        fields = dict(zip(self._described.names, layout.unpack(content), strict=True))
        for name, signed in self._of_three_bytes.items():
            fields[name] = int.from_bytes(fields[name], self._order, signed=signed)
        return fields


def unstuffed(content: bytes) -> bytes:
    """Return what was sent with consistent overhead byte stuffing, without the zero that ends it. Raises ValueError."""
    found, at = bytearray(), 0
    while at < len(content):
        code = content[at]
        if at + code > len(content):
            raise ValueError("wrong COBS")
        found += content[at + 1 : at + code]
        at += code
        if code < 0xFF and at < len(content):
            found.append(0)
    return bytes(found)


def _pair(part: str) -> tuple[str, str]:
    name, colon, value = part.partition(":")
    if not colon:
        raise ValueError(f"{part[:SHOWN]!r} is no name:value")
    return name.strip(), value.strip()


def _number(text: str) -> float:
    """Return the number that a text is. Raises ValueError where it is none: to Python `1_0` is 10."""
    try:
        return float(text.replace("_", "?"))
    except ValueError as err:
        raise ValueError(f"{text[:SHOWN]!r} is no number") from err


def _numbers(found: object, wanted: set[str]) -> Fields:
    if not isinstance(found, dict):
        raise ValueError("no JSON object")
    for name in wanted:
        if isinstance(found.get(name), str | list | dict | bool):
            raise ValueError(f"{name!r} is no number")
    numbers = {name: value for name, value in found.items() if isinstance(value, int | float)}
    for value in numbers.values():
        float(value)  # OverflowError of an integer of hundreds of digits
    return numbers


def _shown(octets: bytes | bytearray) -> str:
    return repr(bytes(octets[:SHOWN]))[1:]
