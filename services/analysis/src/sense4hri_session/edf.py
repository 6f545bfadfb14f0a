"""EDF+ and BDF+: one file per stream, constant rate, markers and gaps as annotations.

Every file of a session begins at the same whole second, so that files lie beside each other as they are.
Format: Kemp & Olivan 2003 (EDF+); 24 bits as BDF+ where a sensor's resolution is above 16 bits or not known.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyedflib
from numpy.typing import NDArray

from sense4hri_session.constant_rate import SECOND_NS, ConstantRate, whole_rate_hz
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

GAP = "BAD_gap"
CLOCK = "BAD_clock"
LARGEST_LIMIT = 9_000_000
SWING = 0.1  # of the range
LABEL = 16  # characters; an annotation of one channel ends with @@ and its label (EDFbrowser, MNE)
_UNITS = {"1": "", "a.u.": "au"}


def write(session: Session, stream: Stream, start_ns: int, stem: Path) -> Path | None:
    """Write one stream; returns the file, `stem` and its ending, or None where it is irregular or empty."""
    rate = whole_rate_hz(stream)
    if rate == 0 or not stream.seen.samples:
        return None
    bits = int(stream.metadata.get("resolution_bits") or 0)
    wide = bits == 0 or bits > 16
    path = stem.with_name(stem.name + (".bdf" if wide else ".edf"))
    kind = pyedflib.FILETYPE_BDFPLUS if wide else pyedflib.FILETYPE_EDFPLUS
    grid, scale = ConstantRate(stream, start_ns, float(rate)), _scale(stream)
    writer = pyedflib.EdfWriter(str(path), len(stream.channels), kind)
    try:
        limits = _header(writer, session, stream, start_ns, rate, wide, scale)
        _samples(writer, grid, limits, rate, scale)
        _annotations(writer, session, stream, grid)
    finally:
        writer.close()
    return path


def _header(
    writer: pyedflib.EdfWriter, session: Session, stream: Stream, start_ns: int, rate: int, wide: bool, scale: int
) -> NDArray[np.float64]:
    """Returns the physical limits, shape (channels, 2)."""
    lowest, highest = (-(1 << 23), (1 << 23) - 1) if wide else (-(1 << 15), (1 << 15) - 1)
    bounds = [stream.seen.channels[name] for name in stream.channels]
    limits = [_limits(low / scale, high / scale) for low, high in map(_roomy, bounds)]
    how = f"resampled to {rate} Hz (cubic spline) from {stream.measured_rate_hz:.3f} Hz; {GAP}: missing"
    unit = f"{scale} " * (scale > 1) + _ascii(_UNITS.get(stream.unit, stream.unit))
    writer.setSignalHeaders(
        [
            {
                "label": name[:LABEL],
                "dimension": unit[:8],
                "sample_frequency": rate,
                "physical_min": low,
                "physical_max": high,
                "digital_min": lowest,
                "digital_max": highest,
                "transducer": _ascii(f"{stream.metadata.get('vendor', '')} {stream.metadata.get('model', '')}".strip()),
                "prefilter": how,
            }
            for name, (low, high) in zip(stream.channels, limits, strict=True)
        ]
    )
    seconds = max((session.end_ns - start_ns) / SECOND_NS, 1.0)
    writer.set_number_of_annotation_signals(min(64, 2 + math.ceil(2 * len(session.timeline) / seconds)))
    writer.setStartdatetime(datetime.fromtimestamp(start_ns // SECOND_NS, UTC).replace(tzinfo=None))
    writer.setPatientCode(stream.name.human_id[:30])
    writer.setEquipment(stream.name.sensor_id[:20])
    writer.setRecordingAdditional(f"cubic_spline_to_{rate}_Hz_{GAP}=missing")
    return np.array(limits)


def _samples(
    writer: pyedflib.EdfWriter, grid: ConstantRate, limits: NDArray[np.float64], rate: int, scale: int
) -> None:
    """One second at a time; what is missing holds the last value."""
    waiting = np.empty((0, len(limits)))
    held = np.clip(0.0, limits[:, 0], limits[:, 1])
    for piece in grid.pieces():
        waiting = np.concatenate([waiting, np.clip(piece / scale, *limits.T)])
        while len(waiting) >= rate:
            held = _write_second(writer, waiting[:rate], held)
            waiting = waiting[rate:]
    if len(waiting):
        rest = np.full((rate - len(waiting), len(limits)), np.nan)
        grid.gaps.append((grid.samples / rate, len(rest) / rate))
        _write_second(writer, np.concatenate([waiting, rest]), held)


def _write_second(writer: pyedflib.EdfWriter, second: NDArray[np.float64], held: NDArray[np.float64]) -> NDArray:
    filled = second
    if np.isnan(second).any():
        filled = pd.DataFrame(second).ffill().fillna(pd.Series(held)).to_numpy()
    writer.blockWritePhysicalSamples(np.ascontiguousarray(filled.T).ravel())
    return np.asarray(filled[-1])


def _annotations(writer: pyedflib.EdfWriter, session: Session, stream: Stream, grid: ConstantRate) -> None:
    notes = [(onset, duration, GAP) for onset, duration in grid.gaps]
    notes += [(onset, duration, f"{GAP}@@{name[:LABEL]}") for onset, duration, name in grid.absent]
    if grid.backwards:
        notes.append((0.0, -1.0, f"{CLOCK}: {grid.backwards} samples left out, the host's clock went back"))
    for marker in markers_of(session, stream.name.human_id).to_dict("records"):
        onset = (marker["time_ns"] - grid.start_ns) * 1e-9
        if 0 <= onset <= grid.samples / grid.rate_hz:
            notes.append((onset, -1.0, marker_text(marker)))
    for onset, duration, text in sorted(notes):
        writer.writeAnnotation(onset, duration, text)


def markers_of(session: Session, human_id: str) -> pd.DataFrame:
    """Begin and end of the session and the markers that concern one participant, those for all among them."""
    markers = session.timeline
    return markers[markers["human_id"].isin(["", human_id])] if len(markers) else markers


def marker_text(marker: dict[Any, Any]) -> str:
    """`stimulus: image 7`."""
    return f"{marker['name']}: {marker['value']}" if marker["value"] else str(marker["name"])


def _roomy(bounds: tuple[float, float]) -> tuple[float, float]:
    """Room for a curve that swings over its samples."""
    low, high = bounds
    room = SWING * (high - low) if math.isfinite(high - low) else 0.0
    return low - room, high + room


def _limits(low: float, high: float) -> tuple[float, float]:
    """Limits round the data whose text fits the header's eight characters."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1, 1
    if low == high:
        low, high = low - 1.0, high + 1.0
    digits = min(max(0, 4 - math.ceil(math.log10(max(abs(low), abs(high), 1e-3)))), 5)
    if digits == 0:
        return math.floor(low), math.ceil(high)
    unit = 10.0**-digits
    return round(math.floor(low / unit) * unit, digits), round(math.ceil(high / unit) * unit, digits)


def _scale(stream: Stream) -> int:
    """Thousands by which samples are divided so that their limits fit into eight characters."""
    bounds = map(_roomy, stream.seen.channels.values())
    finite = [abs(limit) for limits in bounds for limit in limits if math.isfinite(limit)]
    scale = 1
    while max(finite, default=0) / scale > LARGEST_LIMIT:
        scale *= 1000
    return scale


def _ascii(text: str) -> str:
    return text.replace("µ", "u").encode("ascii", "replace").decode()
