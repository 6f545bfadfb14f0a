"""From what is in a file to the streams of a sensor: which columns, in which unit. Pure."""

import math
import re
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from sense4hri.device import Stream
from sense4hri.errors import ConfigError
from sense4hri.modalities import modality
from sense4hri.names import is_sensor_id
from sense4hri.signal_files.content import FURTHEST_NS, FloatArray, IntArray, Signal, SignalFile
from sense4hri.signal_files.units import canonical

from driver_file.guess import types_of

ENTRY = re.compile(
    r"\s*(?P<type>\w+)\s*(:\s*(?P<columns>[^\[\]]*?))?\s*(\[(?P<unit>[^\[\]]*)\])?\s*(\*\s*(?P<factor>[-+.\deE]+))?\s*"
)
CONFIDENCE = "confidence"


class Column(NamedTuple):
    """A column by name, number from 0 or pattern (`EEG *`); name: what its channel is called, empty = as the column."""

    pattern: str
    name: str


class Wanted(NamedTuple):
    """One stream that is asked for; no columns = all that the file has of this type; no unit = the file's."""

    sensor_type: str
    columns: tuple[Column, ...] = ()
    unit: str = ""
    factor: float = 1.0


class Recorded(NamedTuple):
    """A stream of the file: its declaration, the file's own times, shape (n,), and values, shape (n, channels)."""

    sensor_type: str
    stream: Stream
    times_ns: IntArray
    values: FloatArray


def parse(entry: str) -> Wanted:
    """Read `ecg: MLII`, `accelerometer: ACC_X as x, ACC_Y as y, ACC_Z as z [g]`, `eda: 0 [uS] * 0.01`, `eeg: EEG *`.

    Raises ValueError.
    """
    found = ENTRY.fullmatch(entry)
    if not found or not is_sensor_id(found["type"]):
        raise ValueError(f"streams {entry!r}: must be as in 'ecg: MLII [mV]', 'eda: 2 [uS] * 0.01' or 'eeg: *'")
    columns = [part.strip() for part in (found["columns"] or "").split(",") if part.strip()]
    pairs = (column.partition(" as ") for column in columns)
    try:
        factor = float(found["factor"] or 1)
    except ValueError as err:
        raise ValueError(f"streams {entry!r}: {found['factor']!r} is no number") from err
    named = tuple(Column(column.strip(), name.strip()) for column, _, name in pairs)
    return Wanted(found["type"], named, found["unit"] or "", factor)


def choose(path: object, content: SignalFile, wanted: tuple[Wanted, ...]) -> list[Recorded]:
    """Read the wanted streams, or those that the names in the file tell. Raises ConfigError: what is missing."""
    streams = wanted or _told(content)
    if not streams:
        names = ", ".join(name for signal in content.signals for name in signal.channels)
        raise ConfigError(f"streams: {path} does not tell what its columns are, say it: {names}")
    return [_recorded(path, content, each) for each in streams]


def _told(content: SignalFile) -> tuple[Wanted, ...]:
    """Return the first signal of each type that the file, or the names of its channels, tell."""
    found: dict[str, Wanted] = {}
    for signal in content.signals:
        kinds = types_of(signal.channels, signal.units, signal.sensor_type)
        for kind in dict.fromkeys(kinds):
            if kind and kind not in found:
                names = [name for name, its in zip(signal.channels, kinds, strict=True) if its == kind]
                found[kind] = Wanted(kind, tuple(Column(name, "") for name in names))
    return tuple(found.values())


def _recorded(path: object, content: SignalFile, wanted: Wanted) -> Recorded:
    signal, numbers, names = _place(path, content, wanted)
    fs_hz, times_ns, values = signal.read(numbers)
    if len(times_ns) == 0:
        raise ConfigError(f"streams {wanted.sensor_type}: {path} holds no samples of it")
    if times_ns.min() <= -FURTHEST_NS or times_ns.max() >= FURTHEST_NS:
        raise ConfigError(f"streams {wanted.sensor_type}: {path} has times further than 146 years from 0")
    plain = np.array([name != CONFIDENCE for name in names])
    said = [wanted.unit or signal.units[number] for number, is_plain in zip(numbers, plain, strict=True) if is_plain]
    unit, factors = _unit(path, wanted, said, values[:, plain])
    values[:, plain] *= np.array(factors) * wanted.factor
    return Recorded(wanted.sensor_type, Stream(fs_hz, unit, math.nan, math.nan, signal.bits, names), times_ns, values)


def _place(path: object, content: SignalFile, wanted: Wanted) -> tuple[Signal, tuple[int, ...], tuple[str, ...]]:
    """Return the one signal that has every wanted column, their numbers, and the names of their channels."""
    first_of_its_type = sorted(content.signals, key=lambda signal: signal.sensor_type != wanted.sensor_type)
    missing = ""
    for signal in first_of_its_type:
        chosen, lacking = _columns(signal, wanted)
        if chosen:
            names = _names(wanted.sensor_type, [name or signal.channels[number] for number, name in chosen.items()])
            return signal, tuple(chosen), names
        missing = missing or lacking
    there = "; ".join(", ".join(signal.channels) for signal in content.signals)
    raise ConfigError(f"streams {wanted.sensor_type}: {path} has no {missing or 'such signal'}; there are {there}")


def _columns(signal: Signal, wanted: Wanted) -> tuple[dict[int, str], str]:
    """Return the numbers of the wanted columns with their new names; where one is lacking, none, and what lacks."""
    if not wanted.columns:
        kinds = types_of(signal.channels, signal.units, signal.sensor_type)
        mine = [number for number, kind in enumerate(kinds) if kind == wanted.sensor_type]
        return dict.fromkeys(mine, ""), wanted.sensor_type
    chosen: dict[int, str] = {}
    for pattern, name in wanted.columns:
        numbers = _matching(signal.channels, pattern)
        if not numbers:
            return {}, f"column {pattern!r}"
        chosen |= {number: name for number in numbers if number not in chosen}
    return chosen, ""


def _matching(names: tuple[str, ...], pattern: str) -> list[int]:
    if pattern in names:
        return [names.index(pattern)]
    if pattern.isdecimal() and int(pattern) < len(names):
        return [int(pattern)]
    return [number for number, name in enumerate(names) if fnmatchcase(name, pattern)]


def _names(sensor_type: str, names: list[str]) -> tuple[str, ...]:
    """Return channel names as the contract has them where it names all of them, else as they are."""
    if sensor_type == "ppg":
        return tuple(name if name == "ambient" else f"ppg_{number}" for number, name in enumerate(names))
    usual = modality(sensor_type).channels
    without_confidence = tuple(name for name in usual if name != CONFIDENCE)
    as_contract = [channels for channels in (usual, without_confidence) if len(channels) == len(names)]
    return as_contract[0] if as_contract and not set(names) <= set(usual) else tuple(names)


def _unit(path: object, wanted: Wanted, said: list[str], values: FloatArray) -> tuple[str, list[float]]:
    """Return the canonical unit and every column's factor to it; of an unknown scale counts, a.u. with fractions.

    said: what is told of each column. Raises ConfigError where they do not become one unit.
    """
    known = [canonical(wanted.sensor_type, each) if each else None for each in said]
    if len({each and each[0] for each in known}) > 1:
        units = ", ".join(each or "none" for each in dict.fromkeys(said))
        raise ConfigError(f"streams {wanted.sensor_type}: {path} has units that do not become one: {units}; say it")
    if reached := [each for each in known if each]:
        return reached[0][0], [factor for _, factor in reached]
    if wanted.unit:
        raise ConfigError(
            f"streams {wanted.sensor_type}: unit {wanted.unit!r} cannot become one of "
            f"{', '.join(modality(wanted.sensor_type).units)} ({path})"
        )
    whole = np.array_equal(values, np.rint(values), equal_nan=True)
    return "counts" if whole and not any(said) else "a.u.", [1.0] * len(said)
