"""RTP in RTSP's own connection (RFC 2326, 3550): answers and packets cut out of octets, and their times. Pure."""

import re
from collections.abc import Iterator
from typing import NamedTuple

from sense4hri.errors import FrameError
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs.companion import seconds_ns

DOLLAR, VERSION = 0x24, 2
SENDER_REPORT = 200
LONGEST_HEAD = 8192
CLOCK = re.compile(rb"^a=rtpmap:\d+ [^/\r\n]+/(\d{1,9})(?!\d)", re.M)
NUMBER = re.compile(r"[0-9]{1,5}")  # of a status, of bytes of a body


class Answer(NamedTuple):
    """RTSP's answer to a request. headers: names in small letters."""

    status: int
    headers: dict[str, str]
    body: bytes


class Packet(NamedTuple):
    """An RTP packet."""

    sequence: int
    ticks: int
    payload: bytes


class Report(NamedTuple):
    """An RTCP sender report: at that UNIX time the RTP clock showed these ticks."""

    unix_ns: int
    ticks: int


def take(buffer: bytearray) -> Iterator[Answer | tuple[int, bytes]]:
    """Cut what is whole out of the buffer: answers, and channel and octets of interleaved packets.

    What is given is out of the buffer already: whoever stops after it begins with the next.
    Raises FrameError where it is neither; nothing can be read any more from there on.
    """
    while buffer:
        if buffer[0] == DOLLAR:
            if len(buffer) < 4 or len(buffer) < 4 + int.from_bytes(buffer[2:4], "big"):
                return
            end = 4 + int.from_bytes(buffer[2:4], "big")
            channel, octets = buffer[1], bytes(buffer[4:end])
            del buffer[:end]
            yield channel, octets
        else:
            end = buffer.find(b"\r\n\r\n") + 4
            if not buffer.startswith(b"RTSP/1.0 "[: len(buffer)]) or (end < 4 and len(buffer) > LONGEST_HEAD):
                raise FrameError(f"neither RTSP nor a packet: {bytes(buffer[:24])!r}")
            if end < 4:
                return
            answer, end = _answer(buffer, end)
            if end > len(buffer):
                return
            del buffer[:end]
            yield answer


def _answer(buffer: bytearray, end: int) -> tuple[Answer, int]:
    """Return the answer whose head is whole, and where it ends."""
    first, *lines = bytes(buffer[: end - 4]).decode("latin-1").split("\r\n")
    headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    length, status = headers.get("content-length", "0"), "".join(first.split()[1:2])
    if not (NUMBER.fullmatch(length) and NUMBER.fullmatch(status)):
        raise FrameError(f"an RTSP answer begins {first[:60]!r}, with a body of {length[:20]!r} bytes")
    whole = end + int(length)
    return Answer(int(status), headers, bytes(buffer[end:whole])), whole


def clock_hz(description: bytes) -> int:
    """Return the rate of the RTP clock from a session's description (SDP). Raises FrameError where it has none."""
    found = CLOCK.search(description)
    if found is None or not int(found[1]):
        raise FrameError(f"a description without the clock of its packets: {description[:80]!r}")
    return int(found[1])


def packet(octets: bytes) -> Packet:
    """Take an RTP packet apart. Raises FrameError for anything that is none."""
    if len(octets) < 12 or octets[0] >> 6 != VERSION:
        raise FrameError(f"no RTP packet: {octets[:12].hex()}")
    begin, end = 12 + 4 * (octets[0] & 0x0F), len(octets)
    if octets[0] & 0x10:
        begin += 4 + 4 * int.from_bytes(octets[begin + 2 : begin + 4], "big")
    if octets[0] & 0x20:
        end -= octets[-1]
    if begin > end:
        raise FrameError(f"an RTP packet whose header is longer than it: {octets[:16].hex()}")
    return Packet(int.from_bytes(octets[2:4], "big"), int.from_bytes(octets[4:8], "big"), octets[begin:end])


def report(octets: bytes) -> Report | None:
    """Return the sender report of an RTCP packet, None where it begins with another kind."""
    if len(octets) < 28 or octets[1] != SENDER_REPORT:
        return None
    words = [int.from_bytes(octets[at : at + 4], "big") for at in (8, 12, 16)]
    return Report(seconds_ns(words[0], words[1]), words[2])


class Timeline:
    """UNIX time of RTP's 32-bit ticks by the newest sender report, and packets missing by their 16-bit numbers."""

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._report: Report | None = None
        self._sequence: int | None = None
        self.lost_total = 0

    def reported(self, newest: Report) -> None:
        """Take a sender report."""
        self._report = newest

    def time_ns(self, ticks: int) -> int | None:
        """Return the UNIX time of a packet, None before the first report."""
        if self._report is None:
            return None
        since = (ticks - self._report.ticks + (1 << 31)) % (1 << 32) - (1 << 31)
        return self._report.unix_ns + since * SECOND_NS // self._rate_hz

    def count(self, sequence: int) -> int:
        """Return how many packets are missing before this one; a number that goes back is none."""
        ahead = 0 if self._sequence is None else (sequence - self._sequence - 1) % (1 << 16)
        self._sequence = sequence
        missing = ahead if ahead < 1 << 15 else 0
        self.lost_total += missing
        return missing
