"""Small files of recorded signals in the formats of driver-file, made here, where no real one is at hand."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
import pyedflib

START = datetime(2024, 5, 6, 7, 8, 9)
START_NS = 1_714_979_289_000_000_000
"""The same, taken for UTC."""


def edf(
    path: Path,
    signals: Mapping[str, tuple[float, str, np.ndarray]],
    events: Sequence[tuple[float, str]] = (),
    kind: int = pyedflib.FILETYPE_EDFPLUS,
) -> Path:
    """Write signals by label, each as rate in Hz, unit and whole values, and events as onset in s and text."""
    with pyedflib.EdfWriter(str(path), len(signals), file_type=kind) as file:
        file.setStartdatetime(START)
        for number, (label, (rate_hz, unit, _)) in enumerate(signals.items()):
            header = {"label": label, "dimension": unit, "sample_frequency": rate_hz}
            limits = {"physical_min": -1000, "physical_max": 1000, "digital_min": -1000, "digital_max": 1000}
            file.setSignalHeader(number, header | limits | {"transducer": "", "prefilter": ""})
        file.writeSamples([np.asarray(values, np.float64) for _, _, values in signals.values()])
        for onset_s, text in events:
            file.writeAnnotation(onset_s, 0, text)
    return path


def wfdb(path: Path, signals: Mapping[str, tuple[int, str, np.ndarray]], frames_hz: int = 1) -> Path:
    """Write a record of format 16, gain 10, no date: signals by name, as samples a frame, unit and whole values."""
    frames = len(next(iter(signals.values()))[2]) // next(iter(signals.values()))[0]
    counts = np.hstack(
        [np.asarray(values).reshape(frames, per_frame) * 10 for per_frame, _, values in signals.values()]
    )
    path.with_suffix(".dat").write_bytes(counts.astype("<i2").tobytes())
    lines = [f"{path.stem} {len(signals)} {frames_hz} {frames}"]
    for name, (per_frame, unit, _) in signals.items():
        lines.append(f"{path.stem}.dat 16x{per_frame} 10/{unit} 16 0 0 0 0 {name}")
    path.with_suffix(".hea").write_text("\n".join(lines) + "\n")
    return path.with_suffix(".hea")
