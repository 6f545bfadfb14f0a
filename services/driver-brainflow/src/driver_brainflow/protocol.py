"""From BrainFlow's tables to streams, and from its rows to samples in canonical units. Pure: no board, no library.

BrainFlow describes each preset of a board by rows: `eeg_channels: [1, 2, 3, 4]`, `timestamp_channel: 6` and so on, and
hands out a table of float64, shape (rows, samples).
"""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.device import Item, Marked, Samples, Status, Stream, number_text
from sense4hri.errors import ConfigError
from sense4hri.stamps import SECOND_NS

from driver_brainflow.counts import NUMBERINGS, Missing

STANDARD_GRAVITY, RADIANS = 9.80665, math.pi / 180
EXG = ("eeg", "emg", "ecg", "eog")  # of a channel that may be any of them, the first that BrainFlow names
KINDS = {
    "accelerometer": "accel_channels",
    "gyroscope": "gyro_channels",
    "magnetometer": "magnetometer_channels",
    "ppg": "ppg_channels",
    "eda": "eda_channels",
    "temperature": "temperature_channels",
    "optical": "optical_channels",
    "analog": "analog_channels",
    "rotation": "rotation_channels",
    "resistance": "resistance_channels",
    "other": "other_channels",
}
ASKED_FOR = ("optical", "analog", "rotation", "resistance", "other")  # the contract knows no such type
TYPES = (*EXG, *KINDS)
XYZ = ("x", "y", "z")
LATE_S = 1.0  # before the poll, that the newest stamp may lie where it is this host's


class Scale(NamedTuple):
    """The canonical unit, and what BrainFlow's number is multiplied with to get there."""

    unit: str
    factor: float = 1.0


_G, _DEGREES = Scale("m/s^2", STANDARD_GRAVITY), Scale("rad/s", RADIANS)
_MUSE = {"accelerometer": _G, "gyroscope": _DEGREES, "ppg": Scale("counts")}
_CYTON = {"accelerometer": _G}
_EXPLORE = {  # BrainFlow hands out mg, mdeg/s, mgauss
    "accelerometer": Scale("m/s^2", STANDARD_GRAVITY / 1000),
    "gyroscope": Scale("rad/s", RADIANS / 1000),
    "magnetometer": Scale("uT", 0.1),
    "temperature": Scale("degC"),
}
SCALES: Mapping[str, Mapping[str, Scale]] = {
    "SYNTHETIC": {"accelerometer": _G, "gyroscope": _DEGREES, "temperature": Scale("degC")},
    "CYTON": _CYTON,
    "CYTON_DAISY": _CYTON,
    "CYTON_WIFI": _CYTON,
    "CYTON_DAISY_WIFI": _CYTON,
    "GANGLION": _CYTON,
    "GANGLION_NATIVE": _CYTON,
    "UNICORN": {"accelerometer": _G, "gyroscope": _DEGREES},
    "SHIMMER3": {"eda": Scale("uS")},
    "EMOTIBIT": {
        "accelerometer": _G,
        "gyroscope": _DEGREES,
        "magnetometer": Scale("uT"),
        "eda": Scale("uS"),
        "temperature": Scale("degC"),
    },
    **{f"EXPLORE_{n}_CHAN": _EXPLORE for n in (4, 8)},
    **{f"EXPLORE_PLUS_{n}_CHAN": _EXPLORE for n in (8, 32)},
    **{f"MUSE_{model}": _MUSE for model in ("2", "S", "2016", "2_BLED", "S_BLED", "2016_BLED", "S_ATHENA")},
}
"""What is known of the units of a board's helpers, from BrainFlow's documentation and source; else `counts`."""
RAW_EXG = ("GFORCE_PRO", "GFORCE_DUAL", "SHIMMER3")  # 8 bits, or a converter's, without a scale; all others are uV
PERCENT_UNKNOWN = ("SHIMMER3",)  # its battery row is a converter's count
BY_COMMAND: Mapping[str, Mapping[str, str]] = {
    "MUSE_2": {"ppg": "p50"},
    "MUSE_S": {"ppg": "p61"},
    "MUSE_2_BLED": {"ppg": "p50"},
    "MUSE_S_BLED": {"ppg": "p61"},
}
"""What a board only sends after a command."""


class Source(NamedTuple):
    """Where a stream comes from: preset, rows of its table, factor to the canonical unit, and what is declared."""

    preset: str
    rows: tuple[int, ...]
    factor: float
    stream: Stream


def sources(
    board: str, description: Mapping[str, Mapping[str, Any]], wanted: tuple[str, ...], exg: tuple[str, ...]
) -> dict[str, Source]:
    """Return the streams of a board by sensor type.

    description: BrainFlow's, by preset. wanted: sensor types; empty = all of the contract that the board sends
    unasked. exg: what its electrodes measure: empty = as BrainFlow names them, one for all, or one each in the order of
    the rows (`off` = not used). A type that two presets have is taken from the first. Raises ConfigError that names the
    parameter which cannot be.
    """
    found: dict[str, Source] = {}
    for preset, table in description.items():
        for sensor_type, rows in _rows(preset, table, exg).items():
            if sensor_type not in found:
                found[sensor_type] = _source(board, preset, table, sensor_type, rows)
    asked = wanted or tuple(each for each in found if each not in (*ASKED_FOR, *BY_COMMAND.get(board, ())))
    for sensor_type in asked:
        if sensor_type not in found:
            raise ConfigError(f"streams: board {board} has no {sensor_type}; it has {', '.join(found) or 'none'}")
    return {sensor_type: found[sensor_type] for sensor_type in found if sensor_type in asked}


def _rows(preset: str, table: Mapping[str, Any], exg: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Return the rows of each sensor type in one preset."""
    named = {each: table.get(f"{each}_channels", []) for each in EXG}
    electrodes = sorted({row for rows in named.values() for row in rows})
    if len(exg) > 1 and electrodes and len(exg) != len(electrodes):
        raise ConfigError(f"exg: {len(exg)} entries, the board has {len(electrodes)} electrodes")
    given = exg * len(electrodes) if len(exg) == 1 else exg
    measures = given or [next(each for each in EXG if row in named[each]) for row in electrodes]
    rows: dict[str, list[int]] = {}
    for row, each in zip(electrodes, measures if electrodes else (), strict=True):
        rows.setdefault(each, []).append(row)
    rows.pop("off", None)
    for sensor_type, key in KINDS.items():
        taken = table.get("ppg_channels", []) if sensor_type == "optical" else []
        if left := [row for row in table.get(key, []) if row not in taken]:
            rows[sensor_type] = left
    return {sensor_type: tuple(each) for sensor_type, each in rows.items()}


def _source(board: str, preset: str, table: Mapping[str, Any], sensor_type: str, rows: tuple[int, ...]) -> Source:
    raw = Scale("counts")
    microvolt = raw if board in RAW_EXG else Scale("uV")
    scale = microvolt if sensor_type in EXG else SCALES.get(board, {}).get(sensor_type, raw)
    names = _names(table, sensor_type, rows)
    stream = Stream(float(table["sampling_rate"]), scale.unit, math.nan, math.nan, 0, names)
    return Source(preset, rows, scale.factor, stream)


def _names(table: Mapping[str, Any], sensor_type: str, rows: tuple[int, ...]) -> tuple[str, ...]:
    """Return the channels' names: electrodes by BrainFlow's, axes x, y, z, anything else by type and number."""
    given = [name for name in table.get("eeg_names", "").split(",") if name]
    if sensor_type == "eeg" and len(given) == len(table.get("eeg_channels", ())):
        by_row = dict(zip(table["eeg_channels"], given, strict=True))
        return tuple(by_row.get(row, f"eeg_{row}") for row in rows)
    if sensor_type in ("accelerometer", "gyroscope", "magnetometer") and len(rows) == len(XYZ):
        return XYZ
    if len(rows) == 1 and sensor_type != "ppg":
        return (sensor_type,)
    return tuple(f"{sensor_type}_{index}" for index in range(len(rows)))


class Reader:
    """Turns the rows of one preset into samples, markers and news of the battery; keeps where its counter stood.

    recorded: the stamps are a recording's own and become device times; else the board has no clock.
    """

    def __init__(
        self, board: str, preset: str, table: Mapping[str, Any], streams: Mapping[str, Source], recorded: bool
    ) -> None:
        self._table, self._recorded = table, recorded
        self._streams = {name: source for name, source in streams.items() if source.preset == preset}
        numbering = NUMBERINGS.get(board, {}).get(preset)
        self._missing = Missing(numbering, float(table["sampling_rate"])) if numbering else None
        self._battery = None if board in PERCENT_UNKNOWN else table.get("battery_channel")

    def items(self, rows: NDArray[np.float64], received_ns: int, polled_s: float) -> Iterator[Item]:
        """Yield what the rows hold; received_ns, polled_s: when they were fetched, by wall and monotonic clock."""
        stamps_s = rows[self._table["timestamp_channel"]]
        missing = self._before(rows, stamps_s, float(stamps_s[-1]) if self._recorded else polled_s)
        holes = [int(at) + 1 for at in np.flatnonzero(missing[1:])]
        for first, end in pairwise((0, *holes, len(stamps_s))):
            lost = int(missing[first]) if self._missing else None
            device_ns, stamp_ns = self._stamps(stamps_s, end - 1, received_ns)
            for sensor_type, source in self._streams.items():
                samples = rows[list(source.rows), first:end].T * source.factor
                names = source.stream.channel_names
                yield Samples(sensor_type, Chunk(names, samples, device_ns, stamp_ns), lost=lost)
        yield from self._marked(rows, stamps_s, received_ns)
        if self._battery is not None and 0 < rows[self._battery, -1] <= 100:
            yield Status(battery_percent=float(rows[self._battery, -1]))

    def _before(self, rows: NDArray[np.float64], stamps_s: NDArray[np.float64], polled_s: float) -> NDArray[np.int64]:
        if self._missing is None:
            return np.zeros(len(stamps_s), np.int64)
        return self._missing.before(rows[self._table["package_num_channel"]], stamps_s, polled_s)

    def _marked(self, rows: NDArray[np.float64], stamps_s: NDArray[np.float64], received_ns: int) -> Iterator[Marked]:
        for at in np.flatnonzero(rows[self._table["marker_channel"]]):
            device_ns, stamp_ns = self._stamps(stamps_s, int(at), received_ns)
            yield Marked(stamp_ns, device_ns, "marker", number_text(rows[self._table["marker_channel"], at]))

    def _stamps(self, stamps_s: NDArray[np.float64], at: int, received_ns: int) -> tuple[int | None, int]:
        """Return device time and receipt of a sample.

        BrainFlow stamps on this host when a packet comes, which is nearer to the receipt than the poll; where the
        newest stamp is outside the last second they are not that.
        """
        stamp_ns, newest_ns = (round(float(stamps_s[each]) * 1e6) * 1000 for each in (at, -1))
        if self._recorded:
            return stamp_ns, received_ns
        return None, stamp_ns if 0 <= received_ns - newest_ns <= LATE_S * SECOND_NS else received_ns
