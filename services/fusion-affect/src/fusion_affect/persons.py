"""Which face belongs to a participant (contract, section 2); pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sense4hri.names import UNASSIGNED


@dataclass(frozen=True)
class People:
    """What the graph says of people at one moment."""

    humans: frozenset[str] = frozenset()
    """human_ids with live streams."""
    assigned: Mapping[str, str] = field(default_factory=dict)
    """human_id -> person_id, from the assignments."""
    persons: frozenset[str] = frozenset()
    """ROS4HRI persons, tracked or known."""
    face_of: Mapping[str, str] = field(default_factory=dict)
    """person_id -> face_id; empty = the person has no face now."""
    alias_of: Mapping[str, str] = field(default_factory=dict)
    """person_id -> the person it was merged into."""
    faces: frozenset[str] | None = None
    """Faces seen now; None = nobody says."""


class Match(NamedTuple):
    """The person and the face of a participant, empty where there is none; and why."""

    person_id: str
    face_id: str
    reason: str


def match(human_id: str, people: People) -> Match:
    """Who a participant is: the person its assignment names, else the one of its name, else the only one there is."""
    named = people.assigned.get(human_id, "")
    for person_id, why in ((named, "assigned"), (human_id, "of the same name")):
        person = _merged(person_id, people)
        if person and person in people.persons | people.face_of.keys() and _is_free(person, human_id, people):
            return _with_face(person, why, people)
    return _only_one(human_id, named, people)


def newest_person_ids(assignments: list[tuple[str, str, int]]) -> dict[str, str]:
    """human_id -> person_id from (human_id, person_id, since in ns): of somebody the newest counts, on both sides."""
    assigned: dict[str, str] = {}
    for human_id, person_id, _ in sorted(assignments, key=lambda entry: entry[2]):
        if not person_id or human_id == UNASSIGNED:
            continue
        for other in [human for human, person in assigned.items() if person == person_id]:
            del assigned[other]
        assigned[human_id] = person_id
    return assigned


def _merged(person_id: str, people: People) -> str:
    """Follow aliases to the person that is left."""
    seen = set()
    while person_id not in seen and people.alias_of.get(person_id):
        seen.add(person_id)
        person_id = people.alias_of[person_id]
    return person_id


def _is_free(person_id: str, human_id: str, people: People) -> bool:
    """No other participant's assignment names this person."""
    return all(_merged(person, people) != person_id for human, person in people.assigned.items() if human != human_id)


def _with_face(person_id: str, why: str, people: People) -> Match:
    face_id = people.face_of.get(person_id, "")
    if not face_id:
        return Match(person_id, "", f"person {person_id} ({why}) has no face now")
    return Match(person_id, face_id, f"face {face_id} is that of person {person_id} ({why})")


def _only_one(human_id: str, named: str, people: People) -> Match:
    missing = f"no person is named {human_id}" if not named else f"person {named} is not there"
    if people.faces is None:
        return Match("", "", f"{missing}, and no fresh list of faces is there")
    if len(people.faces) != 1:
        return Match("", "", f"{missing}, and {len(people.faces) or 'no'} faces are tracked, not one")
    if people.humans != {human_id}:
        return Match("", "", f"{missing}, and {len(people.humans)} participants have live streams, not one")
    (face_id,) = people.faces
    owners = sorted(person for person, face in people.face_of.items() if face == face_id)
    for person_id in owners:
        if not _is_free(person_id, human_id, people):
            return Match("", "", f"{missing}, and face {face_id} is that of another participant, {person_id}")
    return Match(
        owners[0] if owners else "", face_id, f"the only face, {face_id}, and the only participant belong together"
    )
