"""Who takes part, by pseudonym alone, derived from who wore what and from sessions; all of one of them, or none."""

import sqlite3
from collections.abc import Iterable
from dataclasses import dataclass

from sense4hri.errors import Refusal
from sense4hri.names import HUMAN_ID_FORM, UNASSIGNED, is_human_id

from metadata_registry.past import Reading, Removed, Session, Worn
from metadata_registry.registry import Registry
from metadata_registry.sensors import Sensor
from metadata_registry.store import Assignment, Store

RUNS = "which runs: stop it first"


@dataclass(frozen=True)
class Participant:
    """One pseudonym. sensors: those on it now; sessions: how many it was in; first_ns: ROS time it is first known."""

    human_id: str
    sensors: tuple[str, ...]
    sessions: int
    first_ns: int


@dataclass(frozen=True)
class Everything:
    """All the registry knows of one pseudonym: what it wore and was to wear, how that was set, and its sessions."""

    human_id: str
    assignments: tuple[Worn, ...]
    orders: tuple[Assignment, ...]
    sensors: tuple[Sensor, ...]
    readings: tuple[Reading, ...]
    sessions: tuple[Session, ...]


class Participants:
    """The participants of a study."""

    def __init__(self, store: Store, registry: Registry) -> None:
        self._store, self._registry = store, registry

    def all(self) -> list[Participant]:
        """Every pseudonym that wore a sensor, is to wear one or was in a session, in a steady order."""
        first_ns, sessions = self._store.past.first_ns(), self._store.past.session_counts()
        sensors: dict[str, list[str]] = {}
        for held in self._registry.assignments():
            sensors.setdefault(held.human_id, []).append(held.sensor_id)
        names = sorted(first_ns.keys() - {UNASSIGNED})
        return [
            Participant(name, tuple(sensors.get(name, ())), sessions.get(name, 0), first_ns[name]) for name in names
        ]

    def of(self, human_id: str) -> Everything:
        """Everything about one participant. Raises Refusal where it is not known."""
        self._others(human_id)
        past = self._store.past
        return Everything(
            human_id,
            assignments=tuple(past.worn(human_id)),
            orders=tuple(self._store.orders_for(human_id)),
            sensors=tuple(self._registry.sensors(human_id)),
            readings=tuple(past.readings(human_id)),
            sessions=tuple(past.sessions(human_id)),
        )

    def remove(
        self, human_id: str, worn_now: Iterable[str], preparing: Session | None = None, runs: str = RUNS
    ) -> Removed:
        """Take one participant out, for ever. worn_now: sensors that it wears or is to wear now.

        preparing: the session that is about to begin, which would bring its participants back. runs: what is said of
        one that runs.
        Raises Refusal where the pseudonym is not known, is still worn, or is in a session that runs or is prepared.
        """
        others = self._others(human_id)
        if still := sorted(worn_now):
            wears = f"'{human_id}' still wears, or is to wear, {', '.join(still)}"
            raise Refusal(f"{wears}: assign it to '{UNASSIGNED}' first", status=409)
        running = [s.session_id for s in self._store.past.sessions(human_id) if s.state == "running"]
        if running:
            raise Refusal(f"'{human_id}' is in session '{running[0]}', {runs}", status=409)
        if preparing is not None and human_id in preparing.human_ids:
            why = f"is in session '{preparing.session_id}', which is being prepared: stop it first"
            raise Refusal(f"'{human_id}' {why}", status=409)
        try:
            self._registry.keep()
            removed = self._store.past.remove(human_id, others)
        except sqlite3.Error as err:
            raise Refusal(f"nothing is deleted: the registry cannot write its database: {err}", status=503) from err
        self._registry.load()
        return removed

    def _others(self, human_id: str) -> tuple[str, ...]:
        """Return everybody but one participant. Raises Refusal where that one is not known."""
        if not is_human_id(human_id) or human_id == UNASSIGNED:
            raise Refusal(f"{human_id[:80]!r} is no pseudonym: {HUMAN_ID_FORM}", "human_id")
        names = [one.human_id for one in self.all()]
        if human_id not in names:
            raise Refusal(f"'{human_id}' is not known", "human_id", 404)
        return tuple(name for name in names if name != human_id)
