"""Pulses of interpreter-ppg against ECG, a second site and a sensor's own intervals; cost per participant.

    .venv/bin/python tests/bench/bench_ppg.py

Plays the real recordings of ../shared/data through the kit's SampleClock and the service's step, as the service does.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStep, PpgUpdate
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.sample_clock import SampleClock

Floats = NDArray[np.float64]
Row = dict[str, Any]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
MATCH_S = 0.15


class Info(NamedTuple):
    """What the step asks of a StreamInfo."""

    sampling_frequency_hz: float
    unit: str = "counts"
    range_min: float = np.nan
    range_max: float = np.nan


def play(
    samples: Floats,
    device_ns: NDArray[np.int64],
    nominal_hz: float,
    frame: int = 10,
    config: Config | None = None,
    names: tuple[str, ...] = (),
) -> list[PpgUpdate]:
    """Return every update of one recording. samples: shape (n, channels); device_ns: shape (n,)."""
    clock, step = SampleClock(nominal_hz), PpgStep(config or Config(), Info(nominal_hz))  # type: ignore[arg-type]
    names = names or tuple(f"ppg_{i}" for i in range(samples.shape[1]))
    updates = []
    for start in range(0, len(samples) - frame + 1, frame):
        stop = start + frame
        stamp_ns = int(device_ns[stop - 1])
        updates += step.push(clock.place(Chunk(names, samples[start:stop], stamp_ns, stamp_ns)))
    return updates


def pulses_s(updates: list[PpgUpdate], first_ns: int = 0) -> Floats:
    """Return the times of all published pulses in s after first_ns."""
    return np.array([(t - first_ns) / 1e9 for update in updates for t in update.peak_times_ns])


def evenly(n: int, fs_hz: float) -> NDArray[np.int64]:
    """Return device stamps of n samples at fs_hz, beginning at 1000 s."""
    return 1_000_000_000_000 + np.rint(np.arange(n) * (1e9 / fs_hz)).astype(np.int64)


def matched(
    reference_s: Floats, found_s: Floats, longest_lag_s: float = 1.0
) -> tuple[NDArray[np.bool_], float, Floats]:
    """Match one to one within MATCH_S after the best constant lag.

    Returns which reference events were found, the lag in s and the remaining differences of the matched in s.
    """

    def nearest(lag_s: float) -> tuple[NDArray[np.intp], Floats]:
        at = np.clip(np.searchsorted(found_s, reference_s + lag_s), 1, len(found_s) - 1)
        at = np.where(found_s[at] + found_s[at - 1] > 2 * (reference_s + lag_s), at - 1, at)
        return at, found_s[at] - reference_s - lag_s

    lags = np.arange(-longest_lag_s, longest_lag_s, 0.02)
    lag_s = float(lags[np.argmax([np.count_nonzero(np.abs(nearest(lag)[1]) < 0.1) for lag in lags])])
    for _ in range(3):
        at, difference = nearest(lag_s)
        lag_s += float(np.median(difference[np.abs(difference) < MATCH_S]))
    at, difference = nearest(lag_s)
    hit = np.abs(difference) < MATCH_S
    _, first = np.unique(at[hit], return_index=True)
    once = np.zeros(len(hit), bool)
    once[np.flatnonzero(hit)[first]] = True
    return once, lag_s, difference[once]


def verity() -> tuple[NDArray[np.int64], Floats, Floats, NDArray[np.bool_]]:
    """Return device stamps (n,), samples (n, 4), the device's own intervals in ms (m,) and which are valid (m,)."""
    folder = DATA / "polar" / "verity_sense"
    lines = [line.split(";") for line in (folder / "Polar_Sense_PPG.txt").read_text().splitlines()[1:]]
    stamps_ns = np.array([int(line[1]) for line in lines])
    samples = np.array([[float(value) for value in line[2:6]] for line in lines])
    intervals = np.array(
        [line.split(";")[1:4] for line in (folder / "Polar_Sense_PPI.txt").read_text().splitlines()[1:]]
    )
    ppi_ms, error_ms, blocked = intervals.astype(float).T
    return stamps_ns, samples, ppi_ms, (blocked == 0) & (error_ms < 30)


def physiokit(participant: str) -> tuple[NDArray[np.int64], Floats]:
    """Return device stamps (n,) and PPG of finger and ear (n, 2)."""
    (file,) = (DATA / "multimodal" / "physiokit").glob(f"{participant}_baseline_*.csv")
    table = np.genfromtxt(file, delimiter=",", skip_header=1, usecols=(2, 3, 4))
    return np.rint(table[:, 2] * 1e6).astype(np.int64), table[:, :2]
