"""EEG and EMG of a BIDS folder: EDF+ or BDF+ as `_eeg` or `_emg`, with sidecar, channels and events.

BIDS takes no `_physio` for these. Positions of electrodes are those that somebody measured, so none are written: the
sidecar names the system that the electrodes are named by (docs/decisions/no-template-positions.md). Format:
<https://bids-specification.readthedocs.io> (EEG; EMG since 1.11).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sense4hri_session import edf
from sense4hri_session.bids_files import UNITS, device_of, write_json, write_tsv
from sense4hri_session.constant_rate import whole_rate_hz
from sense4hri_session.placement import placement_scheme
from sense4hri_session.plain_text import cell
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

NOT_TOLD = "n/a"
TYPES = (
    (r"(h|v)?eog.*", "EOG"),
    (r"ecg.*|ekg.*", "ECG"),
    (r"emg.*", "EMG"),
    (r"(aux|right aux|trig|marker).*", "MISC"),
)


def write(
    session: Session, stream: Stream, kind: str, start_ns: int, about: dict[str, Any], stem: Path
) -> Iterator[str]:
    """Write a stream as `stem_<kind>` and what belongs to it; yields sentences on what it does not hold.

    kind: eeg or emg. start_ns: when the file begins, a whole second. about: what every sidecar of the task says.
    """
    yield from edf.write(session, stream, start_ns, stem.with_name(f"{stem.name}_{kind}"))
    written = list(stem.parent.glob(f"{stem.name}_{kind}.?df"))
    if not written:
        return
    write_json(stem.with_name(f"{stem.name}_{kind}.json"), about | _sidecar(stream, kind, edf.seconds_of(written[0])))
    rows = [_channel(stream, name, kind) for name in stream.channels]
    write_tsv(stem.with_name(f"{stem.name}_channels.tsv"), list(rows[0]), rows)


def _sidecar(stream: Stream, kind: str, seconds: float) -> dict[str, Any]:
    rate_hz = whole_rate_hz(stream)
    types = Counter(_type(name, kind) for name in stream.channels)
    said = {
        "SamplingFrequency": float(rate_hz),
        f"{kind.upper()}Reference": NOT_TOLD,
        "PowerLineFrequency": NOT_TOLD,
        "SoftwareFilters": {"Resampling": {"Method": f"cubic spline from {stream.rate_in_words}"}},
        "RecordingType": "continuous",
        "RecordingDuration": seconds,
    }
    counts = {f"{its}ChannelCount": types[its] for its in dict.fromkeys((kind.upper(), *(its for _, its in TYPES)))}
    return said | _placed(stream, kind) | counts | device_of(stream)


def _placed(stream: Stream, kind: str) -> dict[str, str]:
    """What the sidecar says of where electrodes are."""
    if kind == "emg":
        return {"EMGPlacementScheme": "Other", "EMGPlacementSchemeDescription": _place(stream)}
    scheme = placement_scheme(name for name in stream.channels if _type(name, kind) == "EEG")
    return {"EEGPlacementScheme": scheme} if scheme else {}


def _place(stream: Stream) -> str:
    return str(stream.metadata.get("body_location") or "") or "not told; channels are named by the muscle"


def _channel(stream: Stream, name: str, kind: str) -> dict[str, str]:
    said = stream.unit_of(name)
    unit = cell(edf.scaled(stream, UNITS.get(said, said)).strip()) or NOT_TOLD
    return {"name": edf.labels(stream)[name], "type": _type(name, kind), "units": unit, "description": cell(name)}


def _type(name: str, kind: str) -> str:
    return next((its for form, its in TYPES if re.fullmatch(form, name, re.IGNORECASE)), kind.upper())
