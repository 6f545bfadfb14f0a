"""What Pupil Capture publishes, decoded: topic and msgpack in, one reading out; no socket, no clock.

Format: docs.pupil-labs.com, Core, "Network API" and "Data format". Times are Pupil time: seconds of a monotonic clock
whose zero is arbitrary and new with every start of Capture. Eye 0 is the right one, eye 1 the left one.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgpack
from sense4hri.device import Feature
from sense4hri.errors import FrameError
from sense4hri.stamps import LATEST_NS, SECOND_NS

TOPICS = ("gaze.", "pupil.", "fixations", "blinks", "annotation", "notify.annotation", "notify.recording.")
MODELLED = ("pupil.0.3d", "pupil.1.3d")
"""Of what begins with `pupil.`: what the 3d model says, once for each picture of an eye, as the 2d ones are."""
RIGHT, LEFT = 0, 1
LARGEST = 1e12
OURS = "sense4hri"  # key of the annotations that this driver has sent itself
RECORDINGS = {"recording.started": "recording_started", "recording.stopped": "recording_stopped"}


class Gaze(NamedTuple):
    """Where the wearer looks: share of the scene camera's picture, from its lower left corner."""

    time_ns: int
    x: float
    y: float
    confidence: float


class Pupil(NamedTuple):
    """One picture of one eye. diameter: mm of the 3d model, else px of the eye camera's picture."""

    time_ns: int
    eye: int
    diameter: float
    unit: str
    confidence: float


class Event(NamedTuple):
    """A blink's beginning or end, or a fixation, as Capture's own plugins find them."""

    time_ns: int
    features: tuple[Feature, ...]


class Note(NamedTuple):
    """An annotation, or a recording that begins or ends; time_ns is None where the message has none."""

    time_ns: int | None
    name: str
    value: str


Reading = Gaze | Pupil | Event | Note


def decode(topic: str, payload: bytes) -> Reading | None:
    """Return what a message says, None where it concerns nobody here. Raises FrameError that says what came."""
    decoder = _DECODERS.get(topic.partition(".")[0])
    if decoder is None:
        raise FrameError(f"topic {topic[:80]!r} was not asked for")
    return decoder(_content(topic, payload))


def annotation(label: str, value: str, time_ns: int) -> tuple[bytes, bytes]:
    """Return the two parts of a message that Capture's Annotation plugin records as an annotation."""
    content = {
        "topic": "annotation",
        "label": label,
        "timestamp": time_ns / SECOND_NS,
        "duration": 0.0,
        "value": value,
        OURS: True,
    }
    return b"annotation", msgpack.packb(content)


def _content(topic: str, payload: bytes) -> Mapping[str, Any]:
    try:
        content = msgpack.unpackb(payload, strict_map_key=False)
    except (ValueError, TypeError, msgpack.UnpackException) as err:
        raise FrameError(f"{topic[:80]}: {len(payload)} bytes are no msgpack: {payload[:16].hex()}") from err
    if not isinstance(content, dict):
        raise FrameError(f"{topic[:80]}: {type(content).__name__} in place of a map")
    return content


def _gaze(content: Mapping[str, Any]) -> Gaze:
    position = content.get("norm_pos")
    if not isinstance(position, list) or len(position) != 2:
        raise FrameError(f"gaze: norm_pos is {str(position)[:60]}, must be two numbers")
    x, y = [_number_of("gaze: norm_pos", value) for value in position]
    return Gaze(_time_ns(content), x, y, _number(content, "confidence"))


def _pupil(content: Mapping[str, Any]) -> Pupil:
    eye = content.get("id")
    if eye not in (RIGHT, LEFT):
        raise FrameError(f"pupil: id is {str(eye)[:60]}, must be 0 or 1")
    has_model = "diameter_3d" in content
    diameter = _number(content, "diameter_3d" if has_model else "diameter")
    unit = "mm" if has_model else "px"
    return Pupil(_time_ns(content), int(eye), diameter, unit, _number(content, "confidence"))


def _blink(content: Mapping[str, Any]) -> Event | None:
    """A blink by confidence. The kind is told by the feature's name, its value is how sure Capture is."""
    kind = content.get("type")
    if kind not in ("onset", "offset"):
        return None
    return Event(_time_ns(content), (Feature(f"blink_{kind}", "1", (_number(content, "confidence"),)),))


def _fixation(content: Mapping[str, Any]) -> Event:
    """A fixation; one that goes on is told again, longer, under the same id."""
    features = [Feature("fixation_duration", "ms", (_number(content, "duration"),))]
    for key, unit in (("dispersion", "deg"), ("id", "1")):
        if key in content:
            features.append(Feature(f"fixation_{key}", unit, (_number(content, key),)))
    position = content.get("norm_pos")
    if isinstance(position, list) and len(position) == 2:
        x, y = (_number_of("fixations: norm_pos", value) for value in position)
        features += [Feature("fixation_x", "1", (x,)), Feature("fixation_y", "1", (y,))]
    return Event(_time_ns(content), tuple(features))


def _annotation(content: Mapping[str, Any]) -> Note | None:
    if content.get(OURS):
        return None
    return Note(_time_ns(content), str(content.get("label", "annotation"))[:200], str(content.get("value", ""))[:200])


def _notice(content: Mapping[str, Any]) -> Note | None:
    """Annotations of Capture before 1.9 are notices, and so are recordings."""
    subject = str(content.get("subject", ""))
    if subject == "annotation":
        return _annotation(content)
    if subject not in RECORDINGS:
        return None
    time_ns = None if content.get("start_time_synced") is None else _time_ns(content, "start_time_synced")
    return Note(time_ns, RECORDINGS[subject], str(content.get("session_name", ""))[:200])


def _time_ns(content: Mapping[str, Any], key: str = "timestamp") -> int:
    time_ns = round(_number(content, key) * SECOND_NS)
    if abs(time_ns) >= LATEST_NS:
        raise FrameError(f"{key} is {content[key]:g} s, which no clock shows")
    return time_ns


def _number(content: Mapping[str, Any], key: str) -> float:
    return _number_of(key, content.get(key))


def _number_of(what: str, value: Any) -> float:
    if type(value) not in (float, int) or not abs(value) < LARGEST:
        raise FrameError(f"{what} is {str(value)[:60]}, must be a number below {LARGEST:g}")
    return float(value)


_DECODERS: Mapping[str, Callable[[Mapping[str, Any]], Reading | None]] = {
    "gaze": _gaze,
    "pupil": _pupil,
    "fixations": _fixation,
    "blinks": _blink,
    "annotation": _annotation,
    "notify": _notice,
}
