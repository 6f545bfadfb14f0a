"""What the Companion app of a Neon or Invisible sends, decoded: octets in, readings out; no socket, no clock.

Facts from pupil-labs-realtime-api 1.9 (its source, MIT) and docs.pupil-labs.com, "Real-time API". All big endian.
"""

import json
import re
import struct
from typing import Any, NamedTuple

from sense4hri.device import Feature
from sense4hri.errors import FrameError
from sense4hri.stamps import SECOND_NS

GAZE_FORMATS = {9: "!ffB", 17: "!ffBff", 65: "!ffB14f", 89: "!ffB20f"}
"""By length: gaze and worn; gaze of each eye; gaze with the state of both eyes; that with eyelids."""
LEFT_SIZE, RIGHT_SIZE = 3, 10  # places of the pupils' diameters in a datagram with the state of the eyes
LEFT_LID, RIGHT_LID = 19, 22  # places of the lids' apertures in one with eyelids, each behind two angles
SACCADE, FIXATION, SACCADE_ONSET, FIXATION_ONSET, BLINK, KEEP_ALIVE = range(6)
EVENTS = {SACCADE: "saccade", FIXATION: "fixation", BLINK: "blink"}
HOST = re.compile(r"[A-Za-z0-9_:%-]{1,63}(\.[A-Za-z0-9_:%-]{1,63})*")


class Look(NamedTuple):
    """One datagram of gaze: px of the scene camera from its upper left corner.

    sizes_mm, apertures_mm: of pupils and between eyelids, left and right; None where the app does not compute them.
    """

    x: float
    y: float
    worn: bool
    sizes_mm: tuple[float, float] | None
    apertures_mm: tuple[float, float] | None = None


class Happening(NamedTuple):
    """A blink, fixation or saccade that has ended; begin_ns on the device's clock."""

    begin_ns: int
    features: tuple[Feature, ...]


class Sensor(NamedTuple):
    """Where one kind of data is streamed."""

    kind: str
    host: str
    port: int
    path: str


class Status(NamedTuple):
    """What the app says of itself. echo_port is None before the version that has the clock's echo."""

    battery_percent: float | None
    phone: str
    serial_number: str
    echo_port: int | None
    sensors: dict[str, Sensor]


def decode_gaze(octets: bytes) -> Look:
    """Return what a datagram of gaze says. Raises FrameError for a length nobody knows."""
    if len(octets) not in GAZE_FORMATS:
        raise FrameError(
            f"gaze of {len(octets)} bytes, must be {', '.join(map(str, GAZE_FORMATS))}: {octets[:9].hex()}"
        )
    values = struct.unpack(GAZE_FORMATS[len(octets)], octets)
    x, y, worn = values[0], values[1], values[2] == 255
    if len(values) == 5:
        x, y = (values[0] + values[3]) / 2, (values[1] + values[4]) / 2
    sizes_mm = (values[LEFT_SIZE], values[RIGHT_SIZE]) if len(values) > RIGHT_SIZE else None
    apertures_mm = (values[LEFT_LID], values[RIGHT_LID]) if len(values) > RIGHT_LID else None
    return Look(x, y, worn, sizes_mm, apertures_mm)


def decode_event(octets: bytes) -> Happening | None:
    """Return what an eye event says, None for one that has only begun and for what keeps the link alive."""
    kind = struct.unpack_from("!i", octets)[0] if len(octets) >= 4 else -1
    if kind in (SACCADE_ONSET, FIXATION_ONSET, KEEP_ALIVE):
        return None
    sizes = {BLINK: 20, FIXATION: 60, SACCADE: 60}
    if sizes.get(kind) != len(octets):
        raise FrameError(f"eye event {kind} of {len(octets)} bytes: {octets[:16].hex()}")
    begin_ns, end_ns = struct.unpack_from("!qq", octets, 4)
    features = [Feature(f"{EVENTS[kind]}_duration", "ms", ((end_ns - begin_ns) * 1e-6,))]
    if kind != BLINK:
        x, y, _, degrees = struct.unpack_from("!4f", octets, 36)
        features += [Feature(f"{EVENTS[kind]}_{name}", "px", (value,)) for name, value in (("x", x), ("y", y))]
        features.append(Feature(f"{EVENTS[kind]}_amplitude", "deg", (degrees,)))
    return Happening(begin_ns, tuple(features))


def decode_echo(sent: bytes, octets: bytes) -> int:
    """Return the device's clock in ns from the answer to an echo of `sent`. Raises FrameError for another's answer."""
    if len(octets) != 16 or octets[:8] != sent:
        raise FrameError(f"an echo of {sent.hex()} came back as {octets.hex()}")
    return int.from_bytes(octets[8:], "big") * 1_000_000


def decode_status(body: bytes) -> Status:
    """Return what `/api/status` says. Raises FrameError where it cannot be read."""
    try:
        parts = [(each["model"], each["data"]) for each in json.loads(body)["result"]]
        phone = next(data for model, data in parts if model == "Phone")
        hardware: dict[str, Any] = next((data for model, data in parts if model == "Hardware"), {})
        sensors = {data["sensor"]: _sensor(data) for model, data in parts if model == "Sensor" and _is_direct(data)}
        serial = _text(hardware.get("module_serial") or hardware.get("glasses_serial") or "")
        battery, echo_port = phone.get("battery_level"), phone.get("time_echo_port")
        percent = float(battery) if isinstance(battery, int | float) else None
        name = _text(phone.get("device_name", ""))
        return Status(percent, name, serial, _port(echo_port) if echo_port else None, sensors)
    except (ValueError, KeyError, TypeError, AttributeError, StopIteration, OverflowError, RecursionError) as err:
        raise FrameError(f"no status of a Companion app: {body[:80]!r}") from err


def _is_direct(data: dict[str, Any]) -> bool:
    return bool(data.get("connected")) and data.get("conn_type") == "DIRECT"


def _sensor(data: dict[str, Any]) -> Sensor:
    host, path = str(data["ip"]), f"/?{data.get('params', '')}"
    if not HOST.fullmatch(host) or not (path.isascii() and path.isprintable()):
        raise ValueError(f"nobody can be reached at {host!r}, {path!r}")
    return Sensor(str(data["sensor"]), host, _port(data["port"]), path)


def _port(said: Any) -> int:
    if not 0 < int(said) < 1 << 16:
        raise ValueError(f"port {said}")
    return int(said)


def _text(said: Any) -> str:
    """Return a text; half of a surrogate pair, which JSON may hold and nobody can pass on, raises ValueError."""
    return str(said).encode().decode()


def seconds_ns(whole: int, fraction: int) -> int:
    """Return UNIX time in ns of NTP time, s since 1900 and their 2**32nd parts."""
    return (whole - 2_208_988_800) * SECOND_NS + (fraction * SECOND_NS >> 32)
