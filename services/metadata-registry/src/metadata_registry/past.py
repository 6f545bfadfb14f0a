"""What was: who wore what from when to when, parameters as read at the time, sessions; and one participant taken out.

Each kind is bounded, for a stranger may publish without end: the oldest goes first, never what holds now.
"""

import json
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

from sense4hri.names import UNASSIGNED
from sense4hri.pseudonym import Pseudonym
from sense4hri.strict_json import parse

MOST_ASSIGNMENTS, MOST_SESSIONS = 20_000, 5_000
MOST_READINGS, MOST_READINGS_OF_SENSOR = 2_000, 50
SCHEMA = """
CREATE TABLE readings (
    number INTEGER PRIMARY KEY AUTOINCREMENT, sensor_id TEXT NOT NULL, node TEXT NOT NULL, read_ns INTEGER NOT NULL,
    parameters_json TEXT NOT NULL);
CREATE INDEX readings_of_sensor ON readings (sensor_id, number);
CREATE TABLE sessions (
    session_id TEXT NOT NULL, start_ns INTEGER NOT NULL, stop_ns INTEGER NOT NULL, state TEXT NOT NULL,
    study TEXT NOT NULL, task TEXT NOT NULL, human_ids TEXT NOT NULL, directory TEXT NOT NULL,
    metadata_json TEXT NOT NULL, PRIMARY KEY (session_id, start_ns));
"""
WEARERS_SCHEMA = """
ALTER TABLE readings ADD COLUMN human_id TEXT NOT NULL DEFAULT '';
UPDATE readings SET human_id = coalesce(
    (SELECT human_id FROM assignments
     WHERE human_id = json_extract(iif(json_valid(parameters_json), parameters_json, '{}'), '$.human_id')),
    (SELECT human_id FROM assignments AS worn
     WHERE worn.sensor_id = readings.sensor_id AND confidence > 0 AND since_ns <= read_ns ORDER BY worn.number DESC),
    '');
"""
TEXTS_OF_SENSORS = (
    *("node", "host", "vendor", "model", "serial_number", "firmware_version", "body_location", "unit"),
    "channel_names",  # as JSON: as many as before
)
"""Columns that hold whatever a driver is called or told to say."""
_WORN = """
SELECT sensor_id, human_id, person_id, since_ns,
    coalesce(max(since_ns, lead(since_ns) OVER (PARTITION BY sensor_id ORDER BY number)), 0), source, confidence
FROM assignments WHERE confidence > 0 ORDER BY sensor_id, number
"""
_READ = """
SELECT sensor_id, node, read_ns, coalesce(max(read_ns, lead(read_ns) OVER (PARTITION BY sensor_id ORDER BY number)), 0),
    parameters_json, human_id
FROM readings ORDER BY sensor_id, number
"""
_FIRST = """
SELECT human_id, min(at_ns) FROM (
    SELECT human_id, since_ns AS at_ns FROM assignments WHERE confidence > 0 OR source = 'operator'
    UNION ALL SELECT value, start_ns FROM sessions, json_each(human_ids))
GROUP BY human_id
"""
_IN_SESSION = "EXISTS (SELECT 1 FROM json_each(human_ids) WHERE value = ?)"
NEWEST_SHOWN = "SELECT max(number) FROM assignments WHERE confidence > 0 GROUP BY sensor_id"
NEWEST_ORDERS = "SELECT max(number) FROM assignments WHERE source = 'operator' GROUP BY sensor_id"


@dataclass(frozen=True)
class Worn:
    """Who wore a sensor from when to when (ROS time, ns; until 0: still), and who said so.

    Where the clock was set back meanwhile nobody knows until when: it ends where it began.
    source: `config` (the driver's own configuration), `operator` or `association`.
    """

    sensor_id: str
    human_id: str
    person_id: str
    since_ns: int
    until_ns: int
    source: str
    confidence: float


@dataclass(frozen=True)
class Reading:
    """All parameters of a sensor's driver, as it answered from read_ns to until_ns (ROS time; 0: still)."""

    sensor_id: str
    node: str
    read_ns: int
    until_ns: int
    parameters_json: str


@dataclass(frozen=True)
class Session:
    """One session that has begun. start_ns, stop_ns: ROS time, 0: not set; state: running, ended or failed."""

    session_id: str
    start_ns: int
    stop_ns: int
    state: str
    study: str
    task: str
    directory: str
    metadata_json: str
    human_ids: tuple[str, ...]


@dataclass(frozen=True)
class Removed:
    """How many entries were taken out or changed, and what stays because only its name holds the pseudonym.

    in_log: somebody who reads the database, or a disk that takes no more, keeps its write-ahead log, which holds what
    was there before until the registry is started anew.
    """

    assignments: int
    sensors: int
    readings: int
    sessions: int
    left: tuple[str, ...]
    in_log: bool = False


class Past:
    """The part of the database that grows. Every method raises sqlite3.Error where it could not be read or written."""

    def __init__(self, db: sqlite3.Connection) -> None:
        self._db = db

    def worn(self, human_id: str = "") -> list[Worn]:
        """Every time somebody, or this one, wore a sensor, as its topics have shown it; by sensor, the oldest first."""
        return [Worn(*row) for row in self._db.execute(_WORN) if human_id in ("", row[1])]

    def first_ns(self) -> dict[str, int]:
        """Everybody who wore a sensor, was to wear one or was in a session, with the ROS time of the first of it."""
        return dict(self._db.execute(_FIRST))

    def session_counts(self) -> dict[str, int]:
        """In how many sessions each participant was."""
        return dict(self._db.execute("SELECT value, count(*) FROM sessions, json_each(human_ids) GROUP BY value"))

    def trim_assignments(self) -> None:
        """Make room for one more of MOST_ASSIGNMENTS: the oldest go, but never what holds or is wanted now."""
        (count,) = self._db.execute("SELECT count(*) FROM assignments").fetchone()
        if count >= MOST_ASSIGNMENTS:
            self._db.execute(
                f"DELETE FROM assignments WHERE number IN (SELECT number FROM assignments"
                f" WHERE number NOT IN ({NEWEST_SHOWN} UNION {NEWEST_ORDERS}) ORDER BY number LIMIT ?)",
                (count - MOST_ASSIGNMENTS + 1,),
            )

    def read(self, sensor_id: str, human_id: str, node: str, read_ns: int, parameters_json: str) -> None:
        """Keep parameters that were read of a sensor on somebody, where they differ from the sensor's last ones.

        Whose they are is kept, not found out from times: a clock may be set back.
        """
        last = "SELECT human_id, node, parameters_json FROM readings WHERE sensor_id = ? ORDER BY number DESC LIMIT 1"
        if self._db.execute(last, (sensor_id,)).fetchone() == (human_id, node, parameters_json):
            return
        self._db.execute(
            "INSERT INTO readings (sensor_id, human_id, node, read_ns, parameters_json) VALUES (?, ?, ?, ?, ?)",
            (sensor_id, human_id, node, read_ns, parameters_json),
        )
        self._db.execute(
            "DELETE FROM readings WHERE sensor_id = ? AND number NOT IN"
            " (SELECT number FROM readings WHERE sensor_id = ? ORDER BY number DESC LIMIT ?)",
            (sensor_id, sensor_id, MOST_READINGS_OF_SENSOR),
        )
        self._db.execute(
            "DELETE FROM readings WHERE number NOT IN (SELECT number FROM readings ORDER BY number DESC LIMIT ?)",
            (MOST_READINGS,),
        )

    def readings(self, human_id: str = "") -> list[Reading]:
        """Every reading, or those of sensors on one participant; by sensor, the oldest first."""
        return [Reading(*row) for *row, worn_by in self._db.execute(_READ) if human_id in ("", worn_by)]

    def begin(self, session: Session) -> None:
        """Keep a session that runs, and what has become known of it; one that was called ended runs again.

        Who took part, where and why stays as it was then: a name that was taken out does not come back.
        """
        self.end("ended", but=(session.session_id, session.start_ns))
        row = (session.session_id, session.start_ns, session.study, session.task, json.dumps(session.human_ids))
        self._db.execute(
            "INSERT INTO sessions VALUES (?1, ?2, ?6, 'running', ?3, ?4, ?5, ?7, ?8) ON CONFLICT DO UPDATE"
            " SET stop_ns = ?6, directory = iif(state = 'running', ?7, directory), state = 'running'",
            (*row, session.stop_ns, session.directory, session.metadata_json),
        )
        self._db.execute(
            "DELETE FROM sessions WHERE state <> 'running' AND rowid NOT IN"
            " (SELECT rowid FROM sessions ORDER BY rowid DESC LIMIT ?)",
            (MOST_SESSIONS,),
        )

    def end(self, state: str, but: tuple[str, int] = ("", 0)) -> None:
        """Every session that runs, but one, has come to this end."""
        self._db.execute(
            "UPDATE sessions SET state = ? WHERE state = 'running' AND NOT (session_id = ? AND start_ns = ?)",
            (state, *but),
        )

    def running(self) -> str:
        """Return the session_id of the session that runs, empty where none does."""
        found = self._db.execute("SELECT session_id FROM sessions WHERE state = 'running'").fetchone()
        return str(found[0]) if found else ""

    def sessions(self, human_id: str = "") -> list[Session]:
        """Every session, or those one participant was in, in the order of their beginnings.

        Raises ValueError where no registry has written it.
        """
        names = tuple(one.name for one in fields(Session))
        which = f"WHERE {_IN_SESSION}" if human_id else ""
        rows = self._db.execute(
            f"SELECT {', '.join(names)} FROM sessions {which} ORDER BY start_ns, rowid", (human_id,) if human_id else ()
        )
        return [_session(dict(zip(names, row, strict=True))) for row in rows]

    def remove(self, human_id: str, others: tuple[str, ...]) -> Removed:
        """Take a pseudonym out by the rules of sense4hri-withdraw, all or nothing; what stays of it the result says.

        A sensor was on nobody while it was on them: so no older wearer comes back.
        """
        name = Pseudonym(human_id, others)
        self._db.execute("BEGIN IMMEDIATE")
        try:
            removed = self._remove(name)
            self._db.execute("COMMIT")
        except BaseException:
            self._db.execute("ROLLBACK")
            raise
        try:
            return replace(removed, in_log=not self.fold())
        except sqlite3.Error:
            return replace(removed, in_log=True)

    def fold(self) -> bool:
        """Bring what the write-ahead log holds into the file, and empty the log; False where a reader keeps it."""
        busy, _, _ = self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        return not busy

    def _remove(self, name: Pseudonym) -> Removed:
        ids = (name.human_id,)
        known = "SELECT sensor_id FROM sensors UNION SELECT sensor_id FROM assignments ORDER BY 1"
        left = [sensor_id for (sensor_id,) in self._db.execute(known)]
        assignments = self._db.execute(
            f"UPDATE assignments SET human_id = '{UNASSIGNED}', person_id = '' WHERE human_id = ?", ids
        ).rowcount
        self._without("assignments", "person_id", lambda text: "" if name.half_mentions(text) else text)
        sensors = self._db.execute("DELETE FROM sensors WHERE human_id = ?", ids).rowcount
        self._without("sensors", "parameters_json", name.json_without)
        for column in TEXTS_OF_SENSORS:
            self._without("sensors", column, name.name_without)
        readings = self._db.execute("DELETE FROM readings WHERE human_id = ?", ids).rowcount
        readings += self._without("readings", "parameters_json", name.json_without)
        self._without("readings", "node", name.name_without)
        sessions = self._db.execute(f"SELECT count(*) FROM sessions WHERE {_IN_SESSION}", ids).fetchone()[0]
        self._without("sessions", "human_ids", name.json_without)
        self._without("sessions", "metadata_json", name.json_without)
        for column in ("session_id", "study", "task"):
            self._without("sessions", column, name.name_without)
        self._without("sessions", "directory", name.path_without)
        return Removed(assignments, sensors, readings, sessions, tuple(one for one in left if name.half_mentions(one)))

    def _without(self, table: str, column: str, change: Callable[[str], str]) -> int:
        rows = self._db.execute(f"SELECT rowid, {column} FROM {table}").fetchall()
        changed = [(new, number) for number, old in rows if (new := change(old)) != old]
        self._db.executemany(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", changed)
        return len(changed)


def _session(row: dict[str, Any]) -> Session:
    return Session(**(row | {"human_ids": tuple(parse(row["human_ids"], "human_ids"))}))
