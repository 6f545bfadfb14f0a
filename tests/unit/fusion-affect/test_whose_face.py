"""Which face belongs to which participant, by the contract's four steps."""

from fusion_affect.persons import People, match, newest_person_ids

ONE_FACE = frozenset({"f1"})
P1 = frozenset({"p1"})


def test_assignment_comes_first() -> None:
    """The person the assignment names is the participant, even where another has the participant's name."""
    people = People(
        P1, {"p1": "anna"}, frozenset({"anna", "p1"}), {"anna": "f7", "p1": "f1"}, {}, frozenset({"f1", "f7"})
    )
    assert match("p1", people)[:2] == ("anna", "f7")


def test_then_the_same_name() -> None:
    """Without an assignment the person of the same name is the participant, with any number of faces about."""
    people = People(frozenset({"p1", "p2"}), {}, frozenset({"p1"}), {"p1": "f1"}, {}, frozenset({"f1", "f2"}))
    assert match("p1", people)[:2] == ("p1", "f1")
    assert match("p2", people)[:2] == ("", "")


def test_then_the_only_one() -> None:
    """With one face and one participant, and no person, these two belong together."""
    found = match("p1", People(P1, faces=ONE_FACE))
    assert found[:2] == ("", "f1")
    assert "only face" in found.reason


def test_the_only_face_may_have_an_anonymous_person() -> None:
    """The anonymous person a person manager makes for the only face is told."""
    people = People(P1, {}, frozenset({"anonymous_person_abc"}), {"anonymous_person_abc": "f1"}, {}, ONE_FACE)
    assert match("p1", people)[:2] == ("anonymous_person_abc", "f1")


def test_two_faces_are_nobody() -> None:
    """Two faces and no person manager: nobody, and the reason counts the faces."""
    found = match("p1", People(P1, faces=frozenset({"f1", "f2"})))
    assert found[:2] == ("", "")
    assert "2 faces" in found.reason


def test_two_participants_are_nobody() -> None:
    """One face and two participants: nobody."""
    found = match("p1", People(frozenset({"p1", "p2"}), faces=ONE_FACE))
    assert found[:2] == ("", "")
    assert "2 participants" in found.reason


def test_no_face_is_nobody() -> None:
    """No face, or no fresh list of faces: nobody, and the reason says which."""
    assert "no faces are tracked" in match("p1", People(P1, faces=frozenset())).reason
    assert "no fresh list" in match("p1", People(P1, faces=None)).reason


def test_a_person_without_a_face_takes_no_other() -> None:
    """Where the participant's person is there but its face is not, the only face is not taken for it."""
    found = match("p1", People(P1, {}, frozenset({"p1"}), {"p1": ""}, {}, ONE_FACE))
    assert found[:2] == ("p1", "")
    assert "no face now" in found.reason


def test_an_absent_person_leaves_the_only_face() -> None:
    """An assignment that names a person nobody publishes falls through to the only face."""
    found = match("p1", People(P1, {"p1": "anna"}, faces=ONE_FACE))
    assert found.face_id == "f1"


def test_the_only_face_may_be_another_participants() -> None:
    """The only face is not given to a participant when its person is assigned to another one."""
    people = People(P1, {"p2": "bob"}, frozenset({"bob"}), {"bob": "f1"}, {}, ONE_FACE)
    found = match("p1", people)
    assert found[:2] == ("", "")
    assert "another participant, bob" in found.reason


def test_a_name_taken_by_an_assignment_is_not_free() -> None:
    """A person named like p2 but assigned to p1 is p1's alone."""
    people = People(frozenset({"p1", "p2"}), {"p1": "p2"}, frozenset({"p2"}), {"p2": "f1"}, {}, ONE_FACE)
    assert match("p1", people)[:2] == ("p2", "f1")
    assert match("p2", people)[:2] == ("", "")


def test_aliases_are_followed() -> None:
    """A person that was merged into another has the other's face; a ring of aliases ends."""
    people = People(
        P1, {"p1": "anon1"}, frozenset({"anna"}), {"anna": "f3"}, {"anon1": "anna"}, frozenset({"f3", "f4"})
    )
    assert match("p1", people)[:2] == ("anna", "f3")
    ring = People(P1, {"p1": "a"}, frozenset({"a", "b"}), {"a": "f1", "b": "f2"}, {"a": "b", "b": "a"}, ONE_FACE)
    assert match("p1", ring).face_id in ("f1", "f2")


def test_the_newest_naming_counts() -> None:
    """Of several sensors of one participant the newest naming counts, and a person belongs to one participant only."""
    assert newest_person_ids([("p1", "bob", 5), ("p1", "anna", 9), ("p1", "", 12)]) == {"p1": "anna"}
    assert newest_person_ids([("p1", "anna", 9), ("p2", "anna", 10)]) == {"p2": "anna"}
    assert newest_person_ids([("p1", "anna", 9), ("unassigned", "anna", 10)]) == {"p1": "anna"}
