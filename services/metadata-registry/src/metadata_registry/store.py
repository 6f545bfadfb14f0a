"""The SQLite file: sensors ever seen, who wears what, and what was; survives kill -9 at any moment."""

import json
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from sense4hri.errors import ConfigError
from sense4hri.set_aside import set_aside
from sense4hri.shapes import read
from sense4hri.strict_json import parse

from metadata_registry.past import NEWEST_ORDERS, NEWEST_SHOWN, WEARERS_SCHEMA, Past
from metadata_registry.past import SCHEMA as PAST_SCHEMA
from metadata_registry.sensors import LONGEST_PARAMETERS, NAN, Sensor

_FIRST_SCHEMA = """
CREATE TABLE sensors (
    sensor_id TEXT NOT NULL, sensor_type TEXT NOT NULL, human_id TEXT NOT NULL, node TEXT NOT NULL, host TEXT NOT NULL,
    vendor TEXT NOT NULL, model TEXT NOT NULL, serial_number TEXT NOT NULL, firmware_version TEXT NOT NULL,
    body_location TEXT NOT NULL, unit TEXT NOT NULL, sampling_frequency_hz REAL, range_min REAL, range_max REAL,
    resolution_bits INTEGER NOT NULL, transport_delay_s REAL, channel_names TEXT NOT NULL,
    parameters_json TEXT NOT NULL,
    PRIMARY KEY (sensor_id, sensor_type));
CREATE TABLE assignments (
    number INTEGER PRIMARY KEY AUTOINCREMENT, sensor_id TEXT NOT NULL, human_id TEXT NOT NULL, person_id TEXT NOT NULL,
    since_ns INTEGER NOT NULL, source TEXT NOT NULL CHECK (source IN ('config', 'operator', 'association')),
    confidence REAL NOT NULL);
CREATE INDEX assignments_of_sensor ON assignments (sensor_id, number);
"""
_SCHEMAS = (_FIRST_SCHEMA, PAST_SCHEMA, WEARERS_SCHEMA)
"""What each version has added; a file of an older one gets what it lacks."""
_SENSOR_COLUMNS = tuple(f.name for f in fields(Sensor) if f.name != "online")
_ASSIGNMENT_COLUMNS = "sensor_id, human_id, person_id, since_ns, source, confidence"
_DAMAGE = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, None)  # None: a text that is no UTF-8
_NUMBERS = frozenset(f.name for f in fields(Sensor) if f.type is float)


@dataclass(frozen=True)
class Assignment:
    """Who wears a sensor, since when (ROS time, ns), and who said so: `config`, `operator` or `association`.

    confidence 0: an operator's order, which the graph has not shown to be carried out; 1: its topics bear this name.
    """

    sensor_id: str
    human_id: str
    person_id: str
    since_ns: int
    source: str
    confidence: float = 1.0


class Damaged(Exception):
    """The file is broken, or holds what no registry has written."""


class Store:
    """Each write is on the disk when the call returns; raises `sqlite3.Error` where it could not be written."""

    def __init__(self, path: str | Path) -> None:
        """Raises ConfigError where the file is somebody else's or cannot be opened, Damaged where it is broken."""
        try:
            self._db = sqlite3.connect(path, isolation_level=None, timeout=2.0)
            self._open(str(path))
            self.past = Past(self._db)
            self.past.fold()
            self._read_whole()
        except sqlite3.Error as err:
            if getattr(err, "sqlite_errorcode", None) in _DAMAGE:
                raise self._damaged(path, err) from err
            raise ConfigError(f"parameter 'database': cannot use {path}: {err}") from err
        except ValueError as err:
            raise self._damaged(path, err) from err

    def _read_whole(self) -> None:
        """Find out now what is broken, not when somebody asks for it."""
        self.sensors()
        self._history("", ())
        self.past.worn()
        for reading in self.past.readings():
            parse(reading.parameters_json, "parameters_json", LONGEST_PARAMETERS)
        self.past.sessions()

    def _damaged(self, path: str | Path, why: Exception) -> Damaged:
        self._db.close()
        return Damaged(f"{path} is damaged: {why}")

    def _open(self, path: str) -> None:
        version = self._version(path)
        self._db.execute("PRAGMA journal_mode=WAL")
        self._db.execute("PRAGMA synchronous=FULL")
        self._db.execute("PRAGMA secure_delete=ON")
        for number, schema in enumerate(_SCHEMAS[version:], version + 1):
            self._db.executescript(f"BEGIN;{schema}PRAGMA user_version={number};COMMIT;")
        (found,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if found != "ok":
            raise ValueError(" ".join(found.split()))

    def _version(self, path: str) -> int:
        """Return the schema's version, 0 of a new file. Raises ConfigError of a file that is not to be written to."""
        (version,) = self._db.execute("PRAGMA user_version").fetchone()
        tables = {name for (name,) in self._db.execute("SELECT name FROM sqlite_master")}
        if tables and not (version and {"sensors", "assignments"} <= tables):  # many programs count their versions here
            raise ConfigError(f"parameter 'database': {path} is somebody else's SQLite file")
        if version > len(_SCHEMAS):
            known = len(_SCHEMAS)
            raise ConfigError(f"parameter 'database': {path} has schema version {version}, this registry knows {known}")
        return int(version)

    def close(self) -> None:
        """Fold the write-ahead log into the file and let go of it."""
        self._db.close()

    def save(self, sensor: Sensor) -> None:
        """Keep what is known about a sensor, in place of what was known; `online` is never kept."""
        values = [_stored(name, getattr(sensor, name)) for name in _SENSOR_COLUMNS]
        marks = ", ".join("?" * len(values))
        self._db.execute(f"INSERT OR REPLACE INTO sensors ({', '.join(_SENSOR_COLUMNS)}) VALUES ({marks})", values)

    def sensors(self) -> list[Sensor]:
        """Every sensor ever seen, offline until its driver is found again."""
        rows = self._db.execute(f"SELECT {', '.join(_SENSOR_COLUMNS)} FROM sensors ORDER BY sensor_id, sensor_type")
        return [_sensor(dict(zip(_SENSOR_COLUMNS, row, strict=True))) for row in rows]

    def assign(self, assignment: Assignment) -> None:
        """Add to the history, which is rewritten only where a participant is taken out."""
        a = assignment
        self.past.trim_assignments()  # first: one that is written has been written for good
        self._db.execute(
            f"INSERT INTO assignments ({_ASSIGNMENT_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?)",
            (a.sensor_id, a.human_id, a.person_id, a.since_ns, a.source, a.confidence),
        )

    def assignments(self) -> dict[str, Assignment]:
        """What was true of each sensor last: the newest that its topics have shown."""
        return {a.sensor_id: a for a in self._history(f"WHERE number IN ({NEWEST_SHOWN})", ())}

    def orders(self) -> dict[str, Assignment]:
        """What an operator said last of each sensor, carried out or not."""
        return {a.sensor_id: a for a in self._history(f"WHERE number IN ({NEWEST_ORDERS})", ())}

    def orders_for(self, human_id: str) -> list[Assignment]:
        """Every order of an operator that had to be carried out for one participant, oldest first."""
        return self._history("WHERE source = 'operator' AND confidence = 0 AND human_id = ?", (human_id,))

    def history(self, sensor_id: str) -> list[Assignment]:
        """Everything ever said about who wears this sensor, oldest first."""
        return self._history("WHERE sensor_id = ?", (sensor_id,))

    def _history(self, where: str, values: tuple[str, ...]) -> list[Assignment]:
        rows = self._db.execute(
            f"SELECT {_ASSIGNMENT_COLUMNS} FROM assignments {where} ORDER BY number",
            values,
        )
        names = _ASSIGNMENT_COLUMNS.split(", ")
        return [read(Assignment, dict(zip(names, row, strict=True)), "assignments") for row in rows]


def _stored(name: str, value: object) -> object:
    """SQLite keeps NaN as NULL; channel names are a JSON list."""
    return json.dumps(value) if name == "channel_names" else value


def _sensor(row: dict[str, Any]) -> Sensor:
    """Return a row as a sensor. Raises ValueError where no registry has written it."""
    row |= {name: NAN for name in _NUMBERS if row[name] is None}
    row["channel_names"] = parse(row["channel_names"], "channel_names")
    parse(row["parameters_json"], "parameters_json", LONGEST_PARAMETERS)
    sensor: Sensor = read(Sensor, row, "sensors")
    return sensor


def opened(path: str, say: Callable[[str], object]) -> Store:
    """Return the store in a file; one that is damaged is set aside, which is said, and another one begun."""
    try:
        return Store(path)
    except Damaged as err:
        try:
            aside = set_aside(Path(path))
            for rest in (Path(f"{path}-wal"), Path(f"{path}-shm")):
                if rest.exists():
                    set_aside(rest)
        except OSError as trouble:
            raise ConfigError(f"parameter 'database': {trouble}") from trouble
        say(f"{err}; set aside as {aside}: who wears what begins anew with what the drivers say")
        return Store(path)
