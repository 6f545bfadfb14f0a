"""EDF, EDF+ and BDF, by pyedflib where they are whole and have no gaps.

Channels of one rate are one signal, annotations are events. So are the triggers of a BioSemi: each new code in the
lower 16 bits of its BDF's channel `Status`, but for 0.
"""

from collections.abc import Iterator
from datetime import UTC
from pathlib import Path

import numpy as np
import pyedflib
from sense4hri.signal_files.content import Event, Sampled, Signal, SignalFile, UnreadableFileError, evenly
from sense4hri.stamps import SECOND_NS

from driver_file.edf_gaps import STATUS, codes, has_gaps, is_cut, open_gaps

SUBSECOND_NS = 100  # in which edflib counts the fraction of the second at which an EDF+ begins


def open_edf(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError."""
    try:
        if has_gaps(path):
            return open_gaps(path)
        with pyedflib.EdfReader(str(path)) as file:
            second = file.getStartdatetime().replace(microsecond=0, tzinfo=UTC)  # it takes the fraction for a tenth
            start_ns = round(second.timestamp()) * SECOND_NS + int(file.starttime_subsecond) * SUBSECOND_NS
            rates = [float(file.getSampleFrequency(number)) for number in range(file.signals_in_file)]
            signals = tuple(_signal(path, file, rates, rate, start_ns) for rate in dict.fromkeys(rates))
            onsets_s, _, words = file.readAnnotations()
            triggers = tuple(_codes(file, rates, start_ns)) if path.suffix.lower() == ".bdf" else ()
    except (OSError, ValueError) as err:
        if is_cut(path):
            return open_gaps(path)
        raise UnreadableFileError(f"{path}: {err}") from err
    events = tuple(Event(start_ns + round(at * SECOND_NS), word) for at, word in zip(onsets_s, words, strict=True))
    return SignalFile(signals, events + triggers)


def _codes(file: pyedflib.EdfReader, rates: list[float], start_ns: int) -> Iterator[Event]:
    """Yield the triggers of every channel that has them."""
    for number, rate_hz in enumerate(rates):
        if file.getLabel(number).strip() == STATUS:
            counts = file.readSignal(number, digital=True)
            yield from codes(counts, evenly(rate_hz, counts, start_ns).times_ns)


def _signal(path: Path, file: pyedflib.EdfReader, rates: list[float], rate: float, start_ns: int) -> Signal:
    numbers = [number for number, its in enumerate(rates) if its == rate]

    def read(wanted: tuple[int, ...]) -> Sampled:
        with pyedflib.EdfReader(str(path)) as again:
            values = np.column_stack([again.readSignal(numbers[each]) for each in wanted])
        return evenly(rate, values, start_ns)

    names = tuple(file.getLabel(number).strip() for number in numbers)
    units = tuple(file.getPhysicalDimension(number).strip() for number in numbers)
    return Signal(names, units, read, bits=24 if path.suffix.lower() == ".bdf" else 16)
