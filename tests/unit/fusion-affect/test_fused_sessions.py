"""A session begins afresh: its states do not depend on what was before."""

import pytest
from fused import ECG, NEUTRAL, TREE, at, run
from fusion_affect import held
from fusion_affect.fusion import Fusion
from fusion_affect.state import Expression, State
from fusion_affect.streams import Rate
from sense4hri.names import StreamName


def session(fusion: Fusion, start: float, seconds: float, **sent: object) -> list[State]:
    """A session with its start at `start`, announced a second ahead; the states of it."""
    states = run(fusion, 1.0, start=start - 1.0, **sent)  # type: ignore[arg-type]
    fusion.cut_at(at(start))
    return [s for s in states + run(fusion, seconds, start=start, **sent) if s.time_ns >= at(start)]  # type: ignore[arg-type]


def test_a_session_does_not_depend_on_what_was_before() -> None:
    """From start_at on a fusion that ran for a minute, with a baseline of then, says what a fresh one says."""
    long = Fusion(TREE, baseline_s=15.0)
    run(long, 20.0, ecg=55.0, ppg=55.0, expression=Expression("angry", 0.9))
    long.marker("baseline_start", "", at(20.0))
    run(long, 20.0, ecg=50.0, ppg=50.0, start=20.0)
    long.marker("baseline_end", "", at(40.0))
    run(long, 19.0, ecg=50.0, ppg=50.0, start=40.0)
    fresh = Fusion(TREE, baseline_s=15.0)
    states = session(long, 60.4, 30.0)
    assert repr(states) == repr(session(fresh, 60.4, 30.0))
    assert states[0].time_ns == at(61)
    assert "resting baseline 71.0 bpm" in states[-1].reasons


def test_an_older_recording_of_other_sensors_is_followed_after_a_session() -> None:
    """What is stamped long before the last start_at is another story, also from sources that were never seen."""
    fusion = Fusion(TREE)
    assert session(fusion, 5000.0, 10.0)
    states: list[State] = []
    for second in range(20):
        fusion.rate(StreamName("p9", "ecg", "other_1"), "features", Rate(70.0, 0.9), at(second))
        states += fusion.due()
    assert len(states) >= 15
    assert {state.human_id for state in states} == {"p9"}


def test_the_cut_goes_by_stamps_not_by_order_of_arrival() -> None:
    """Late inputs of before start_at count for the grid points before it alone, early ones for those after it."""
    fusion = Fusion(TREE)
    states = run(fusion, 10.0)
    fusion.cut_at(at(10.2))
    fusion.faces(("f1",), at(10.25))
    fusion.rate(ECG, "features", Rate(90.0, 0.9), at(10.21))
    states += fusion.due()
    fusion.expression("f1", Expression("angry", 0.9), at(9.95))
    fusion.rate(ECG, "features", Rate(75.0, 0.9), at(9.9))
    states += run(fusion, 5.0, start=10.3, ecg=None, ppg=None, expression=None)
    assert [s.time_ns for s in states] == [at(1 + n) for n in range(len(states))]
    assert [(s.heart_rate_bpm, s.expression) for s in states[9:11]] == [(73.5, "angry"), (90.0, "")]


def test_what_vanished_before_its_session_began_is_not_in_it() -> None:
    """A stream and a face that leave while the last states before a session are waited for tell nothing in it."""
    fusion = Fusion(TREE)
    run(fusion, 10.0)
    fusion.cut_at(at(10.5))
    fusion.rate(ECG, "features", Rate(70.0, 0.9), at(10.6))
    fusion.expression("f1", NEUTRAL, at(10.6))
    fusion.vanished(ECG, "features")
    fusion.face_vanished("f1")
    states = run(fusion, 5.0, ecg=None, expression=None, start=10.7)
    assert {(s.heart_rate_bpm, s.expression) for s in states if s.time_ns > at(10.5)} == {(72.0, "")}


def test_who_is_who_stays_through_the_cut_and_holds_from_when_it_came() -> None:
    """Persons said before a session, and one said late, count for the grid points after them alone."""
    fusion = Fusion(TREE)
    fusion.persons("tracked", ("p1",))
    fusion.person_face("p1", "f1")
    run(fusion, 3.0)
    states = session(fusion, 5.0, 3.2)
    assert {s.person_id for s in states} == {"p1"}
    fusion.persons("tracked", ("p1", "anna"))
    fusion.assignments([("p1", "anna", 1)])
    fusion.person_face("anna", "f1")
    states = run(fusion, 5.0, start=8.2)
    assert [s.person_id for s in states[:2]] == ["p1", "anna"]
    for _ in range(5000):
        fusion.person_face("p1", "f1")


def test_an_unstamped_expression_counts_from_its_receipt() -> None:
    """Its receipt is its time, unless that is far from every stamp: then a player of another time sends it."""
    for receipt, word in ((2.9, "angry"), (3.1, "neutral"), (-9e6, "angry")):
        fusion = Fusion(TREE)
        run(fusion, 2.5, expression=None)
        fusion.expression("f1", NEUTRAL, at(2.5))
        fusion.expression("f1", Expression("angry", 0.9), 0, at(receipt))
        states = run(fusion, 2.0, start=2.6, expression=None)
        assert {s.expression for s in states if s.time_ns == at(3)} == {word}


@pytest.mark.parametrize(
    ("name", "most"), [("", 100), ("x{}", 200)], ids=["one that says much", "many that say little"]
)
def test_a_flood_before_a_session_begins_pushes_nobody_out(
    monkeypatch: pytest.MonkeyPatch, name: str, most: int
) -> None:
    """Whatever is stamped ahead of the start waits, within a bound; what a strap and a face said there counts."""
    monkeypatch.setattr(held, "MOST_OF_ONE", 100)
    monkeypatch.setattr(held, "MOST", 200)
    fusion = Fusion(TREE)
    run(fusion, 10.0)
    fusion.cut_at(at(10.5))
    fusion.marker("baseline_start", "", at(10.6))
    fusion.rate(ECG, "features", Rate(90.0, 0.9), at(10.6))
    fusion.expression("f1", Expression("angry", 0.9), at(10.6))
    fusion.faces(("f1",), at(10.6))
    waiting = []
    for number in range(1000):
        if name:
            fusion.expression(name.format(number), NEUTRAL, at(10.6))
        else:
            fusion.marker("baseline_end", "p1", at(10.6))
        waiting.append(len(fusion._held))
    assert max(waiting) - 3 <= most
    states = run(fusion, 6.0, ecg=None, ppg=None, expression=None, start=10.7)
    assert [(s.heart_rate_bpm, s.expression) for s in states if s.time_ns == at(11)] == [(90.0, "angry")]
