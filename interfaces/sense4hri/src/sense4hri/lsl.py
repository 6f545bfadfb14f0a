"""What driver-lsl, bridge-lsl and the bench must agree on about the Lab Streaming Layer. Imports no LSL library.

Content types against sensor types, units as the XML spells them, how liblsl is told where to look, and what its clock
is: `local_clock()` counts seconds since the machine started (CLOCK_MONOTONIC on Linux), not since 1970.
"""

import os
import re
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.device import MESSAGE_S, DriverConfig
from sense4hri.names import is_sensor_id
from sense4hri.schema import parameter
from sense4hri.stamps import SECOND_NS

CONTENT_TYPES = {
    "ecg": "ECG",
    "ppg": "PPG",
    "eda": "EDA",
    "emg": "EMG",
    "eeg": "EEG",
    "eog": "EOG",
    "eye_tracking": "Gaze",
    "pupillometry": "Pupil",
    "respiration": "Respiration",
    "accelerometer": "Accelerometer",
    "gyroscope": "Gyroscope",
    "magnetometer": "Magnetometer",
    "temperature": "Temperature",
}
"""LSL's content type of each sensor type, as XDF's conventions and the usual apps write it."""
MARKERS = "markers"
"""Stands where a sensor type would: a stream of events."""
_ALSO = {
    "ecg": "ekg electrocardiogram",
    "ppg": "bvp pleth pulse photoplethysmogram",
    "eda": "gsr sc scl scr electrodermal skinconductance",
    "eye_tracking": "eyetracking eyetracker eye",
    "pupillometry": "pupilsize pupildiameter pupillometry",
    "respiration": "resp rsp breath breathing",
    "accelerometer": "acc acceleration accel",
    "gyroscope": "gyro gyr angularvelocity",
    "magnetometer": "mag magnetic",
    "temperature": "temp skintemperature",
    MARKERS: "markers marker events event stim stimulus trigger triggers annotation annotations",
}
_TYPES = {word: kind for kind, words in _ALSO.items() for word in words.split()}
_TYPES |= {name.lower(): kind for kind, name in CONTENT_TYPES.items()}
OURS = "sense4hri-"
"""How the source_id of every outlet of bridge-lsl begins: driver-lsl takes none of them for a device."""
CLOCK_TRIES = 5  # of reading two clocks at once; the quickest counts


@dataclass(frozen=True, kw_only=True)
class InletConfig(DriverConfig):
    """Parameters of every driver over LSL: where its outlets are looked for."""

    known_peers: tuple[str, ...] = parameter(
        (),
        help="machines to ask for streams where multicast does not reach, as names or addresses",
        matches=r"[A-Za-z0-9_.:%-]+",
        form="names or addresses",
    )
    session: str = parameter(
        "",
        help="LSL's SessionID; empty = that of lsl_api.cfg; `{domain}` in it is the ROS domain",
        matches=r"[\w{}-]*",
        form="letters, digits, '_', '-' and {domain}",
    )
    frame_s: float = parameter(MESSAGE_S, help="how much of a signal a message holds", unit="s", low=0.002, high=1)


class Wall(NamedTuple):
    """The wall clock against LSL's on this machine: wall = local_clock + offset_ns, within uncertainty_s."""

    offset_ns: int
    uncertainty_s: float


def sensor_type(content_type: str) -> str:
    """Return the sensor type, or MARKERS, of a content type; another one becomes a type of its own, none becomes ''."""
    words = re.sub(r"[^a-z0-9]+", "_", content_type.strip().lower()).strip("_")
    known = _TYPES.get(words.replace("_", ""))
    return known or (words[:63].rstrip("_") if is_sensor_id(words) else "")


def domain() -> str:
    """Return the ROS domain, by which two studies on one network are told apart."""
    return os.environ.get("ROS_DOMAIN_ID", "0")


def settings(known_peers: tuple[str, ...], session: str) -> str:
    """Return the text of an lsl_api.cfg; empty where nothing is asked for and liblsl finds its own.

    known_peers: machines to ask beside those that multicast reaches, which does not cross a container's bridge.
    session: streams of other sessions are neither heard nor shown; `{domain}` in it stands for the ROS domain, so that
    two studies on one machine do not hear each other.
    """
    session = session.replace("{domain}", domain())
    lines = []
    if known_peers or session:
        lines += ["[lab]"]
    if known_peers:
        lines += [f"KnownPeers = {{{', '.join(known_peers)}}}"]
    if session:
        lines += [f"SessionID = {session}"]
    return "\n".join([*lines, ""]) if lines else ""


def meant(predicate: str) -> str:
    """Return the predicate without what bridge-lsl offers, unless it names that itself.

    It would be our own echo, of this driver's stream or of the study's markers.
    """
    return predicate if OURS in predicate else f"({predicate}) and not(starts-with(source_id,'{OURS}'))"


def shown(xml: str) -> str:
    """Return what tells a stream from others, as in `'BioSemi' (EEG, 8 channels, 100 Hz, source_id 'x', on lab-2)`."""
    try:
        info = ElementTree.fromstring(xml)
        rate_hz = float(text_of(info, "nominal_srate") or 0)
    except (ElementTree.ParseError, ValueError):
        return "a stream whose description cannot be read"
    return (
        f"{text_of(info, 'name')!r} ({text_of(info, 'type')}, {text_of(info, 'channel_count')} channels, "
        f"{f'{rate_hz:g} Hz' if rate_hz else 'irregular'}, source_id {text_of(info, 'source_id')!r}, "
        f"on {text_of(info, 'hostname')})"
    )


def text_of(element: ElementTree.Element, path: str) -> str:
    """Return what a stream's XML says at a path, empty where it says nothing."""
    return (element.findtext(path) or "").strip()


def nanoseconds(stamps_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return LSL's stamps in ns; one that is no number, or too large for any clock, is 0 = no time."""
    fits = np.isfinite(stamps_s) & (np.abs(stamps_s) < 9e9)
    return np.where(fits, np.rint(np.where(fits, stamps_s, 0.0) * SECOND_NS), 0).astype(np.int64)


def wall(local_clock: Callable[[], float]) -> Wall:
    """Read LSL's clock and the wall clock together; of a few tries the one that took the shortest."""
    tries = []
    for _ in range(CLOCK_TRIES):
        before_ns = round(local_clock() * SECOND_NS)
        now_ns = time.time_ns()
        after_ns = round(local_clock() * SECOND_NS)
        tries.append((after_ns - before_ns, now_ns - (before_ns + after_ns) // 2))
    took_ns, offset_ns = min(tries)
    return Wall(offset_ns, took_ns / 2 / SECOND_NS)
