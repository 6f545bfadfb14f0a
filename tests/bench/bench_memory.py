"""Memory of every interpreter over a day of signal, as fast as this machine can: does it hold more at the end?

    .venv/bin/python tests/bench/bench_memory.py                      all, 24 h each (about an hour of a core)
    .venv/bin/python tests/bench/bench_memory.py --hours 6 emg eeg    only these, only so long

The minute of the study nine-modalities, over and over on a device's clock that goes on, with the accelerometer beside
those that look at it. After the first hour and at the end, each at the same place of the minute: memory of the process,
and what the step holds, counted object by object (which no allocator blurs). Each in a process of its own. What was
measured is kept for `tests/bench/run.py memory`, which runs the others for two hours: a day can be run in parts. A flat
run of less than a day is neither met nor missed.
"""

import argparse
import gc
import importlib
import json
import subprocess
import sys
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from costs import memory_mib
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.signal_files.wfdb import open_wfdb
from sense4hri.stream_info import StreamInfo

Floats = NDArray[np.float64]
Row = dict[str, Any]

ROOT = Path(__file__).resolve().parents[2]
FILES = ROOT / "compose" / "studies" / "nine-modalities"
KEPT = ROOT / "build" / "bench" / "memory"
HOURS, PART_HOURS = 24.0, 2.0
MINUTE_NS, SECOND_NS, T0_NS = 60 * 10**9, 10**9, 10**18
GROWTH_MIB, GROWTH_SHARE = 2.0, 0.02
NO_STATE = (type, types.ModuleType, types.FunctionType, types.BuiltinFunctionType, types.MethodType)


class Played(NamedTuple):
    """One interpreter and its stream. columns: of the file, by the names that its channels have."""

    package: str
    step: str
    sensor_type: str
    unit: str
    columns: dict[str, str]
    with_motion: bool = False


GAZE = {name: name for name in ("gaze_x", "gaze_y", "confidence")}
PUPIL = {name: name for name in ("diameter_left", "diameter_right", "confidence")}
PPG = {name: name for name in ("ppg_0", "ppg_1", "ppg_2", "ambient")}
EEG = {name: name for name in ("Fp1", "Fp2", "F3", "F4", "Cz", "Pz", "O1", "O2")}
CHEST = {"acc_x": "x", "acc_y": "y", "acc_z": "z"}
INTERPRETERS = {
    "ecg": Played("interpreter_ecg", "stream.EcgStream", "ecg", "uV", {"ecg": "ecg"}, True),
    "ppg": Played("interpreter_ppg", "stream.PpgStream", "ppg", "counts", PPG, True),
    "eda": Played("interpreter_eda", "stream.EdaStream", "eda", "uS", {"eda": "eda"}, True),
    "respiration": Played(
        "interpreter_respiration",
        "stream.RespirationStream",
        "respiration",
        "a.u.",
        {"respiration": "respiration"},
        True,
    ),
    "respiration_ecg": Played("interpreter_respiration", "heart.HeartStream", "ecg", "uV", {"ecg": "ecg"}, True),
    "respiration_accelerometer": Played(
        "interpreter_respiration", "stream.RespirationStream", "accelerometer", "m/s^2", CHEST
    ),
    "emg": Played("interpreter_emg", "stream.EmgStream", "emg", "uV", {"biceps": "biceps"}),
    "eeg": Played("interpreter_eeg", "stream.EegStream", "eeg", "uV", EEG, True),
    "eog": Played("interpreter_eog", "stream.EogStream", "eog", "uV", {"heog": "heog", "veog": "veog"}, True),
    "eye_tracking": Played("interpreter_eye_tracking", "stream.EyeStream", "eye_tracking", "deg", GAZE),
    "pupillometry": Played("interpreter_pupillometry", "stream.PupilStream", "pupillometry", "mm", PUPIL),
    "motion": Played("interpreter_motion", "stream.MotionStream", "accelerometer", "m/s^2", CHEST),
}


class Minute:
    """A minute of one stream that never ends."""

    def __init__(self, sensor_type: str, unit: str, columns: dict[str, str]) -> None:
        samples, self.fs_hz = minute(list(columns))
        self.info = StreamInfo(StreamName("p1", sensor_type, "s1"), self.fs_hz, unit, tuple(columns.values()))
        self._seconds = np.array_split(samples, 60)
        self._clock = SampleClock(self.fs_hz)

    def second(self, number: int) -> Any:
        """Return the samples of this second since the beginning, on the clock."""
        part = self._seconds[number % 60]
        done = number // 60 * sum(map(len, self._seconds)) + sum(map(len, self._seconds[: number % 60 + 1]))
        stamp_ns = T0_NS + round((done - 1) / self.fs_hz * SECOND_NS)
        return self._clock.place(Chunk(self.info.channel_names, part, stamp_ns, stamp_ns))


def minute(columns: list[str]) -> tuple[Floats, float]:
    """Return the columns of the study's files, shape (n, columns), and their rate in Hz."""
    for signal in open_wfdb(FILES / "body"):
        if columns[0] in signal.channels:
            found = signal.read(tuple(signal.channels.index(name) for name in columns))
            return found.values, found.fs_hz
    table = np.genfromtxt(FILES / "gaze.csv", delimiter=",", names=True)
    return np.column_stack([table[name] for name in columns]), round(1 / float(np.diff(table["time_s"]).mean()), 3)


def played(one: Played, seconds: int) -> Iterator[tuple[int, Any]]:
    """Play so many seconds; yields how many are over, and the step. Updates are let go."""
    own = Minute(one.sensor_type, one.unit, one.columns)
    beside = Minute("accelerometer", "m/s^2", CHEST) if one.with_motion else None
    module, _, step_name = one.step.partition(".")
    config = importlib.import_module(f"{one.package}.config").Config()
    step = getattr(importlib.import_module(f"{one.package}.{module}"), step_name)(config, own.info)
    for number in range(seconds):
        if beside is not None:
            step.evidence(beside.info, beside.second(number))
        if not step.push(own.second(number)) and number > 120:
            raise RuntimeError(f"{one.package}: no update in second {number}")
        yield number + 1, step


def held_bytes(step: Any) -> int:
    """Return what everything that a step holds takes; arrays that only look into another count with it, once."""
    seen: dict[int, Any] = {}
    waiting = [step]
    while waiting:
        found = waiting.pop()
        if id(found) not in seen and not isinstance(found, NO_STATE):
            seen[id(found)] = found
            waiting += [found.base] if isinstance(found, np.ndarray) and found.base is not None else []
            waiting += gc.get_referents(found)
    return sum(sys.getsizeof(each) for each in seen.values())


def measured(name: str, hours: float) -> Row:
    """Play one interpreter for so many hours, at least two; return its row."""
    end_s, first, begun_s = round(3600 * hours), (0.0, 0), time.process_time()
    for at_s, step in played(INTERPRETERS[name], end_s):
        if at_s in (3600, end_s):
            gc.collect()
            now = memory_mib(), held_bytes(step)
            first = now if at_s == 3600 else first
    grown_mib, grown = now[0] - first[0], now[1] / first[1] - 1
    flat = grown_mib <= GROWTH_MIB and abs(grown) <= GROWTH_SHARE
    times = end_s / (time.process_time() - begun_s)
    return {
        "what": f"memory of {name} over {hours:g} h of signal, after the first hour and at the end",
        "target": f"24 h, <= {GROWTH_MIB:g} MiB more, step's own within {GROWTH_SHARE:.0%}",
        "measured": f"{first[0]:.1f} and {now[0]:.1f} MiB; the step's own {first[1] / 1024:.0f} and "
        f"{now[1] / 1024:.0f} KiB; {times:.0f} x real time on a core",
        "ok": flat if hours >= HOURS or not flat else None,
    }


def kept(name: str, hours: float) -> Row:
    """Measure in a process of its own and keep the row."""
    command = [sys.executable, __file__, "--inside", "--hours", str(hours), name]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    KEPT.mkdir(parents=True, exist_ok=True)
    (KEPT / f"{name}.json").write_text(done.stdout)
    return dict(json.loads(done.stdout))


def rows() -> list[Row]:
    """What is kept, else two hours now."""
    files = {name: KEPT / f"{name}.json" for name in INTERPRETERS}
    return [json.loads(file.read_text()) if file.exists() else kept(name, PART_HOURS) for name, file in files.items()]


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("only", nargs="*", choices=[[], *INTERPRETERS], help="all where none is given")
    parser.add_argument("--hours", type=float, default=HOURS, help="of signal, at least 2 (24)")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    for name in options.only or INTERPRETERS:
        row = measured(name, options.hours) if options.inside else kept(name, options.hours)
        print(json.dumps(row) if options.inside else f"| {row['what']} | {row['measured']} | {row['ok']} |", flush=True)


if __name__ == "__main__":
    main()
