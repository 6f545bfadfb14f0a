"""What kind of signal a channel of an LSL stream is, live or in an XDF file."""

import re

from sense4hri import lsl
from sense4hri.signal_files.choice import CONFIDENCE
from sense4hri.signal_files.guess import type_of
from sense4hri.signal_files.units import KNOWN, VOLTS, canonical, spelt

_OTHER = re.compile(
    r"([hv]?eog|emg|ecg|ekg|ppg|pleth|bvp|resp|rsp|breath|eda|gsr|pupil|gaze|acc|gyr|mag|temp).*", re.IGNORECASE
)
"""Labels that among electrodes are none, by their first letters."""
_TRIGGER = re.compile(r"(trig|trg|stim?\W?\d*$|marker|event|status).*", re.IGNORECASE)
_HOUSEKEEPING = re.compile(
    r"(count|cntr|sample|packe?t?|package|seq|index|interpolated|validation|time|lsl.?time|batt|quality|(raw.?)?cq).*",
    re.IGNORECASE,
)


def channel_type(kind: str, own: str, label: str, unit: str) -> str:
    """Return a channel's sensor type: as it says itself, as its stream says, as its label tells; empty: left out.

    kind: the stream's sensor type; own: the channel's content type, empty where it says none.

    A gaze stream carries pupils under their labels, an EEG stream what the amplifier has besides electrodes.
    """
    own = lsl.sensor_type(own)
    named = type_of(label, "", unit)
    if named == "pupillometry" and kind in ("", "eye_tracking"):
        return named
    known = (*lsl.CONTENT_TYPES, lsl.MARKERS)
    said = own if own in known else kind if kind in lsl.CONTENT_TYPES else ""
    if said and not _fits(said, label, unit):
        return _besides(label, unit)
    return said or named or own or kind


def _fits(said: str, label: str, unit: str) -> bool:
    """Return whether a channel can be what it or its stream is said to be: its unit, of an EEG also its label.

    Volts may be of anything: an amplifier gives a belt's or a light sensor's so, without their scale. A confidence is a
    share beside samples of any unit.
    """
    if label == CONFIDENCE:
        return True
    if spelt(unit) in KNOWN and canonical(said, unit) is None:
        return said not in lsl.CONTENT_TYPES or spelt(unit) in VOLTS
    return said != "eeg" or not any(form.fullmatch(label.strip()) for form in (_OTHER, _TRIGGER, _HOUSEKEEPING))


def _besides(label: str, unit: str) -> str:
    """Return the type of a channel that is not what its stream is; empty where only its label could tell and does not.

    What says voltage by its unit and acceleration by its label is neither.
    """
    name = label.strip()
    if _TRIGGER.fullmatch(name):
        return lsl.MARKERS
    named = type_of(name) if _OTHER.fullmatch(name) else ""
    return "" if named and spelt(unit) in VOLTS and canonical(named, unit) is None else named
