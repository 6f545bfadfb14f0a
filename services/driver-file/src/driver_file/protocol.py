"""From what is in a file to the streams of a sensor: which columns, in which unit. Pure."""

import math
from typing import NamedTuple

import numpy as np
from sense4hri.device import Stream
from sense4hri.errors import ConfigError
from sense4hri.signal_files.choice import CONFIDENCE, Wanted, place, told, unique, unit_of
from sense4hri.signal_files.content import FURTHEST_NS, FloatArray, IntArray, Signal, SignalFile
from sense4hri.signal_files.units import Scale, scaled


class Recorded(NamedTuple):
    """A stream of the file: its declaration, the file's own times, shape (n,), and values, shape (n, channels)."""

    sensor_type: str
    stream: Stream
    times_ns: IntArray
    values: FloatArray


def choose(path: object, content: SignalFile, wanted: tuple[Wanted, ...]) -> list[Recorded]:
    """Read the wanted streams, or those that the names in the file tell. Raises ConfigError: what is missing."""
    if not content.signals:
        held = f"{len(content.events)} markers and no signal" if content.events else "neither signals nor markers"
        raise ConfigError(f"file: {path} holds {held}: give the file that was recorded beside it")
    signals = tuple(signal._replace(channels=unique(signal.channels)) for signal in content.signals)
    streams = wanted or told(signals)
    if not streams:
        names = ", ".join(name for signal in signals for name in signal.channels)
        raise ConfigError(f"streams: {path} does not tell what its columns are, say it: {names}")
    return [_recorded(path, signals, each) for each in streams]


def _recorded(path: object, signals: tuple[Signal, ...], wanted: Wanted) -> Recorded:
    number, columns, names = place(path, signals, wanted)
    signal = signals[number]
    fs_hz, times_ns, values = signal.read(columns)
    if len(times_ns) == 0:
        raise ConfigError(f"streams {wanted.sensor_type}: {path} holds no samples of it")
    if times_ns.min() <= -FURTHEST_NS or times_ns.max() >= FURTHEST_NS:
        raise ConfigError(f"streams {wanted.sensor_type}: {path} has times further than 146 years from 0")
    plain = np.array([name != CONFIDENCE for name in names])
    said = [signal.units[column] for column, is_plain in zip(columns, plain, strict=True) if is_plain]
    unit, scales = unit_of(path, wanted, said) or _unscaled(said, values[:, plain])
    values[:, plain] = scaled(values[:, plain], [scale.after(wanted.factor) for scale in scales])
    return Recorded(wanted.sensor_type, Stream(fs_hz, unit, math.nan, math.nan, signal.bits, names), times_ns, values)


def _unscaled(said: list[str], values: FloatArray) -> tuple[str, list[Scale]]:
    """Return the unit of an unknown scale: counts, or a.u. where there are fractions or another unit is told."""
    whole = np.array_equal(values, np.rint(values), equal_nan=True)
    return "counts" if whole and not any(said) else "a.u.", [Scale()] * len(said)
