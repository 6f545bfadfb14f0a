"""The state of a participant: what makes it known, whose it is, and why it is unknown."""

from collections import deque

import pytest
from fused import ECG, NAN, NEUTRAL, PPG, TREE, at, run
from fusion_affect.align import ClockModel
from fusion_affect.fusion import Fusion
from fusion_affect.heart_rate import Baselines
from fusion_affect.state import Expression, State
from fusion_affect.streams import Rate
from sense4hri.names import StreamName


def test_the_proof_of_concept() -> None:
    """One participant with ECG and PPG before one face is calm_relaxed once a second, with the path that led there."""
    states = run(Fusion(TREE), 20.0)
    assert [s.time_ns for s in states] == [at(1 + n) for n in range(len(states))]
    assert len(states) >= 18
    last = states[-1]
    assert (last.state, last.human_id, last.face_id, last.expression) == ("calm_relaxed", "p1", "f1", "neutral")
    assert last.heart_rate_bpm == pytest.approx(71.0)
    assert last.confidence == pytest.approx(0.8)
    told = " | ".join(last.reasons)
    for step in (
        "only face",
        "ecg/h10_1 features 70.0",
        "ppg/verity_1 features 72.0",
        "'neutral' is composed",
        "85 bpm",
    ):
        assert step in told


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"expression": None}, "the expression of face f1 is missing"),
        ({"ecg": NAN, "ppg": NAN}, "ecg/h10_1 features is missing"),
        ({"ecg": 60.0, "ppg": 90.0}, "disagree by more than 10 bpm"),
        ({"faces": ("f1", "f2")}, "2 faces are tracked"),
        ({"faces": ()}, "no faces are tracked"),
        ({"faces": None, "expression": None}, "no fresh list of faces"),
        ({"expression": Expression("neutral", 0.1)}, "confidence 0.10 is below"),
        ({"expression": Expression("", 0.9)}, "is empty"),
        ({"expression": Expression("winking", 0.9)}, "'winking' is in no group"),
    ],
)
def test_unknown_with_the_reason(change: dict[str, object], why: str) -> None:
    """What is missing, doubtful, disagreeing or ambiguous gives unknown with confidence 0, and the reason says it."""
    last = run(Fusion(TREE), 8.0, **change)[-1]  # type: ignore[arg-type]
    assert last.state == "unknown"
    assert last.confidence == 0.0
    assert why in " | ".join(last.reasons)


def test_stale_heart_rate() -> None:
    """When both pipelines fall silent while the face goes on, the state turns unknown, and later there is none."""
    fusion = Fusion(TREE)
    run(fusion, 10.0)
    later = run(fusion, 30.0, ecg=None, ppg=None, start=10.0)
    assert [s.state for s in later][:3] == ["calm_relaxed"] * 3
    stale = [s for s in later if s.state == "unknown"]
    assert "ecg/h10_1 features is stale" in " | ".join(stale[0].reasons)
    assert later[-1].time_ns < at(28)


def test_stale_expression() -> None:
    """An expression that is no longer renewed turns the state unknown after three seconds."""
    fusion = Fusion(TREE)
    run(fusion, 10.0)
    later = run(fusion, 10.0, expression=None, start=10.0)
    assert later[-1].state == "unknown"
    assert "the expression of face f1 is stale" in " | ".join(later[-1].reasons)
    first = next(s for s in later if s.state == "unknown")
    assert first.time_ns == at(13)


def test_faces_nobody_lists_are_known_by_their_expressions() -> None:
    """Without a list of tracked faces the only face whose expression comes in is the only face."""
    last = run(Fusion(TREE), 8.0, faces=None)[-1]
    assert (last.state, last.face_id) == ("calm_relaxed", "f1")


def test_messages_without_receipt_stamp_are_left_out() -> None:
    """A heart rate or health that lacks the stamp the contract demands neither moves time nor resets anything."""
    fusion = Fusion(TREE)
    states = run(fusion, 5.0)
    fusion.rate(ECG, "features", Rate(200.0, 1.0), 0)
    fusion.health(ECG, 0, True)
    states += run(fusion, 5.0, start=5.0)
    assert repr(states) == repr(run(Fusion(TREE), 10.0))


def test_one_pipeline_is_enough() -> None:
    """When one pipeline cannot tell, the other one decides, and the reasons say which was left out."""
    last = run(Fusion(TREE), 8.0, ppg=NAN)[-1]
    assert last.state == "calm_relaxed"
    assert last.heart_rate_bpm == 70.0
    assert "ppg/verity_1 features is missing" in " | ".join(last.reasons)


def test_unstamped_expressions_are_counted_and_used() -> None:
    """Unstamped expressions, as real recognisers send them, are used at the stamp of the newest input, and counted."""
    fusion = Fusion(TREE)
    states = run(fusion, 10.0, stamped=False)
    assert fusion.unstamped_expressions == 20
    assert [s.state for s in states] == [s.state for s in run(Fusion(TREE), 10.0)]


def test_an_unstamped_expression_before_anything_else() -> None:
    """An expression that comes before any stamp waits for the first one."""
    fusion = Fusion(TREE)
    fusion.expression("f1", NEUTRAL, 0)
    states = run(fusion, 3.0, expression=None)
    assert states[-1].expression == "neutral"


def test_a_face_that_vanished_before_anything_else_is_not_used() -> None:
    """Its expression, which waited for a time to be of, is of none."""
    fusion = Fusion(TREE)
    fusion.expression("f1", NEUTRAL, 0)
    fusion.face_vanished("f1")
    states = run(fusion, 3.0, expression=None, faces=None)
    assert [state.expression for state in states] == [""] * len(states)
    assert states


def test_human_id_changes_and_streams_vanish() -> None:
    """A sensor that moves to another participant takes its state along; the old participant has none."""
    fusion = Fusion(TREE)
    run(fusion, 5.0, ppg=None)
    moved = ECG._replace(human_id="p2")
    fusion.rate(moved, "features", Rate(70.0, 0.9), at(5.3))
    fusion.vanished(ECG, "features")
    fusion.faces(("f1",), at(6.0))
    fusion.expression("f1", NEUTRAL, at(6.0))
    fusion.rate(moved, "features", Rate(70.0, 0.9), at(6.3))
    fusion.faces(("f1",), at(6.6))
    assert {(s.human_id, s.state) for s in fusion.due() if s.time_ns == at(6)} == {("p2", "calm_relaxed")}


def test_nobody_wears_it() -> None:
    """A sensor that is unassigned makes no state, and is no second participant."""
    fusion = Fusion(TREE)
    for second in range(5):
        fusion.rate(PPG._replace(human_id="unassigned"), "features", Rate(99.0, 0.9), at(second))
    states = run(fusion, 8.0, start=5.0)
    assert {s.human_id for s in states} == {"p1"}
    assert states[-1].state == "calm_relaxed"


def test_two_participants_with_a_person_manager() -> None:
    """With persons each participant gets the expression of its own face."""
    fusion = Fusion(TREE)
    fusion.persons("tracked", ("p1", "anna"))
    fusion.person_face("p1", "f1")
    fusion.person_face("anna", "f2")
    fusion.assignments([("p2", "anna", 1)])
    states: list[State] = []
    for second in range(8):
        fusion.faces(("f1", "f2"), at(second))
        fusion.expression("f1", NEUTRAL, at(second))
        fusion.expression("f2", Expression("scared", 0.7), at(second))
        fusion.rate(ECG, "features", Rate(70.0, 0.9), at(second))
        fusion.rate(ECG._replace(human_id="p2"), "features", Rate(110.0, 0.9), at(second))
        states += fusion.due()
    last = {s.human_id: s for s in states}
    assert (last["p1"].state, last["p1"].person_id, last["p1"].face_id) == ("calm_relaxed", "p1", "f1")
    assert (last["p2"].state, last["p2"].person_id, last["p2"].face_id) == ("stressed_anxious", "anna", "f2")


def test_only_health_is_a_live_stream_too() -> None:
    """A participant who wears only sensors without heart rate has a state, unknown, that says what is missing."""
    fusion = Fusion(TREE)
    states: list[State] = []
    for second in range(5):
        fusion.health(StreamName("p1", "eda", "e4_1"), at(second), True)
        fusion.health(StreamName("p2", "eda", "e4_2"), at(second), False)
        states += fusion.due()
    assert {s.human_id for s in states} == {"p1"}
    assert "there is no ecg or ppg heart rate" in states[-1].reasons


@pytest.mark.parametrize("valence", [NAN, 7.0, float("inf")])
@pytest.mark.parametrize("sure", [0.9, NAN, 1.7])
def test_a_valence_that_is_none_is_nan_with_the_reason(valence: float, sure: float) -> None:
    """A recogniser may know one of the two; a confidence is 0 to 1, and that of what is not known 0."""
    last = run(Fusion(TREE), 5.0, expression=Expression("neutral", sure, valence, 0.4))[-1]
    (first, second) = last.indicators
    assert (first.name, repr(first.value), first.confidence) == ("expression_valence", "nan", 0.0)
    assert (second.value, second.confidence) == (0.4, {0.9: 0.9, 1.7: 1.0}.get(sure, 0.0))
    assert last.reasons.count("expression_valence is missing: the expression of face f1 has none of -1..1") == 1
    assert not any("arousal" in reason for reason in last.reasons)


def test_indicators_only_where_they_are_honest() -> None:
    """Valence and arousal that the recogniser leaves at zero are not passed on as if they were measured."""
    assert run(Fusion(TREE), 5.0)[-1].indicators == ()
    filled = run(Fusion(TREE), 5.0, expression=Expression("happy", 0.8, 0.6, 0.2))[-1]
    assert [(i.name, i.value) for i in filled.indicators] == [("expression_valence", 0.6), ("expression_arousal", 0.2)]
    assert filled.indicators[0].sources == ("/humans/faces/f1/expression",)


def kept(thing: object) -> int:
    """How many values it holds, in whatever it holds them."""
    if isinstance(thing, dict):
        return sum(map(kept, thing.values()))
    if isinstance(thing, list | tuple | set | frozenset | deque):
        return sum(map(kept, thing))
    return kept(vars(thing)) if type(thing).__module__.startswith("fusion_affect") else 1


def test_who_comes_and_goes_leaves_nothing_behind() -> None:
    """Faces and participants with new names for as long as it runs: it holds as much as before."""
    fusion, held, said = Fusion(TREE), [], set()
    for second in range(3 * Baselines.MOST):
        come, gone = ECG._replace(human_id=f"p{second}"), ECG._replace(human_id=f"p{second - 2}")
        fusion.features_offered(come)
        fusion.expression(f"f{second}", NEUTRAL, at(second))
        fusion.rate(come, "features", Rate(70.0, 0.9), at(second))
        said |= {state.human_id for state in fusion.due()}
        fusion.vanished(gone, "features")
        fusion.clock(gone, ClockModel(0, at(0), 0.0))  # clock-sync has not noticed yet
        fusion.vanished(gone, "clock")
        fusion.face_vanished(f"f{second - 2}")
        held.append(kept(fusion))
    assert len(said) > 2 * Baselines.MOST
    assert max(held[2 * Baselines.MOST :]) <= max(held[: 2 * Baselines.MOST])
