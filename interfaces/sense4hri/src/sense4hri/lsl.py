"""What driver-lsl, bridge-lsl and the bench must agree on about the Lab Streaming Layer. Imports no LSL library.

Content types against sensor types, units as the XML spells them, how liblsl is told where to look, and what its clock
is: `local_clock()` counts seconds since the machine started (CLOCK_MONOTONIC on Linux), not since 1970.
"""

import os
import re
import time
from collections.abc import Callable
from typing import NamedTuple

from sense4hri.names import is_sensor_id
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


class Wall(NamedTuple):
    """The wall clock against LSL's on this machine: wall = local_clock + offset_ns, within uncertainty_s."""

    offset_ns: int
    uncertainty_s: float


def sensor_type(content_type: str) -> str:
    """Return the sensor type, or MARKERS, of a content type; another one becomes a type of its own, none becomes ''."""
    words = re.sub(r"[^a-z0-9]+", "_", content_type.strip().lower()).strip("_")
    known = _TYPES.get(words.replace("_", ""))
    return known or (words[:63].rstrip("_") if is_sensor_id(words) else "")


def settings(known_peers: tuple[str, ...], session: str) -> str:
    """Return the text of an lsl_api.cfg; empty where nothing is asked for and liblsl finds its own.

    known_peers: machines to ask beside those that multicast reaches, which does not cross a container's bridge.
    session: streams of other sessions are neither heard nor shown; `{domain}` in it stands for the ROS domain, so that
    two studies on one machine do not hear each other.
    """
    session = session.replace("{domain}", os.environ.get("ROS_DOMAIN_ID", "0"))
    lines = []
    if known_peers or session:
        lines += ["[lab]"]
    if known_peers:
        lines += [f"KnownPeers = {{{', '.join(known_peers)}}}"]
    if session:
        lines += [f"SessionID = {session}"]
    return "\n".join([*lines, ""]) if lines else ""


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
