"""Which channels of what is described become which stream, in which unit, as a study's `streams` ask for it. Pure.

The same few words for a file's columns and for the channels of an LSL stream: `ecg: MLII [mV]`,
`accelerometer: ACC_X as x, ACC_Y as y, ACC_Z as z [g]`, `eda: 0 [uS] * 0.01`, `eeg: EEG *`.
"""

import re
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple, Protocol

from sense4hri.errors import ConfigError
from sense4hri.modalities import modality
from sense4hri.names import is_sensor_id
from sense4hri.signal_files.units import Scale, canonical

ENTRY = re.compile(
    r"\s*(?P<type>\w+)\s*(:\s*(?P<columns>[^\[\]]*?))?\s*(\[(?P<unit>[^\[\]]*)\])?\s*(\*\s*(?P<factor>[-+.\deE]+))?\s*"
)
WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
SENSED = "(a|acc|accel|g|gyr|gyro|m|mag|gaze|pupil|diameter)"  # as in `accx`
CONFIDENCE = "confidence"


class Described(Protocol):
    """Channels that are sampled together: names, units (empty = not told), sensor type of each (empty = not told)."""

    @property
    def channels(self) -> tuple[str, ...]: ...
    @property
    def units(self) -> tuple[str, ...]: ...
    @property
    def types(self) -> Sequence[str]: ...


class Column(NamedTuple):
    """A channel by name, number from 0 or pattern (`EEG *`); name: what it will be called, empty = as it is."""

    pattern: str
    name: str


class Wanted(NamedTuple):
    """One stream that is asked for; no columns = all that are of this type; no unit = what is told."""

    sensor_type: str
    columns: tuple[Column, ...] = ()
    unit: str = ""
    factor: float = 1.0


class Chosen(NamedTuple):
    """Where a stream is: which of what is described, numbers of its channels there, and their new names."""

    place: int
    numbers: tuple[int, ...]
    names: tuple[str, ...]


def parse(entry: str) -> Wanted:
    """Read one entry of `streams`. Raises ValueError that quotes it."""
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


def parse_all(entries: Sequence[str]) -> tuple[Wanted, ...]:
    """Read the entries of `streams`. Raises ValueError, also where a sensor type comes twice."""
    wanted = tuple(parse(entry) for entry in entries)
    if len({each.sensor_type for each in wanted}) < len(wanted):
        raise ValueError(f"streams {list(entries)}: each sensor type at most once")
    return wanted


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names, a further one of the same name with its number."""
    return tuple(_numbered(names))


def _numbered(names: Sequence[str]) -> Iterator[str]:
    seen: set[str] = set()
    for number, name in enumerate(names):
        fresh = name
        while fresh in seen:
            fresh = f"{fresh}_{number}"
        seen.add(fresh)
        yield fresh


def told(described: Sequence[Described]) -> tuple[Wanted, ...]:
    """Return the first stream of each type that types or names of the channels tell."""
    found: dict[str, Wanted] = {}
    for each in described:
        for kind in dict.fromkeys(each.types):
            if kind and kind not in found:
                names = [name for name, its in zip(each.channels, each.types, strict=True) if its == kind]
                found[kind] = Wanted(kind, tuple(Column(name, "") for name in names))
    return tuple(found.values())


def place(where: object, described: Sequence[Described], wanted: Wanted) -> Chosen:
    """Return the first that has every wanted channel, one of the wanted type before others. Raises ConfigError."""
    order = sorted(range(len(described)), key=lambda number: wanted.sensor_type not in described[number].types)
    missing = ""
    for number in order:
        chosen, lacking = _columns(described[number], wanted)
        if chosen:
            names = [name or described[number].channels[column] for column, name in chosen.items()]
            return Chosen(number, tuple(chosen), _names(wanted.sensor_type, names))
        missing = missing or lacking
    there = "; ".join(", ".join(each.channels) for each in described)
    raise ConfigError(f"streams {wanted.sensor_type}: {where} has no {missing or 'such signal'}; there are {there}")


def unit_of(where: object, wanted: Wanted, said: Sequence[str]) -> tuple[str, list[Scale]] | None:
    """Return the canonical unit and every channel's scale to it; None where nobody knows the scale.

    said: the unit told of each channel, empty where none is; `wanted.unit` wins. Raises ConfigError where they do not
    become one unit.
    """
    units = [wanted.unit or each for each in said]
    known = [canonical(wanted.sensor_type, each) if each else None for each in units]
    if len({each and each[0] for each in known}) > 1:
        names = ", ".join(each or "none" for each in dict.fromkeys(units))
        raise ConfigError(f"streams {wanted.sensor_type}: {where} has units that do not become one: {names}; say it")
    if reached := [each for each in known if each]:
        return reached[0][0], [scale for _, scale in reached]
    if wanted.unit:
        raise ConfigError(
            f"streams {wanted.sensor_type}: unit {wanted.unit!r} cannot become one of "
            f"{', '.join(modality(wanted.sensor_type).units)} ({where})"
        )
    return None


def _columns(described: Described, wanted: Wanted) -> tuple[dict[int, str], str]:
    """Return the numbers of the wanted channels with their new names; where one is lacking, none, and what lacks."""
    if not wanted.columns:
        mine = [number for number, kind in enumerate(described.types) if kind == wanted.sensor_type]
        return dict.fromkeys(mine, ""), wanted.sensor_type
    chosen: dict[int, str] = {}
    for pattern, name in wanted.columns:
        numbers = _matching(described.channels, pattern)
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
    channels = usual if CONFIDENCE in names or len(names) == len(usual) else without_confidence
    if len(channels) != len(names) or set(names) <= set(usual):
        return tuple(names)
    return _as_labels_tell(names, channels)


def _as_labels_tell(names: Sequence[str], channels: tuple[str, ...]) -> tuple[str, ...]:
    """Return of each name the channel that it tells; those that none tells in order, all where two tell the same."""
    told = [[channel for channel in channels if _tells(name, channel)] for name in names]
    known = [each[0] for each in told if len(each) == 1]
    if len(set(known)) < len(known):
        return channels
    rest = (channel for channel in channels if channel not in known)
    return tuple(each[0] if len(each) == 1 else next(rest) for each in told)


def _tells(name: str, channel: str) -> bool:
    """Return whether a name has the word that tells a channel from its like, or its initial: `x`, `left`."""
    word = channel.rpartition("_")[2]
    return any(
        each.lower() in (word, word[0]) or re.fullmatch(f"{SENSED}{word}", each.lower()) for each in WORD.findall(name)
    )
