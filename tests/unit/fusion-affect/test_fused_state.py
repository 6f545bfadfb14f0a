"""From messages with stamps to states on the grid, without ROS."""

import math
import random
from collections.abc import Callable
from functools import partial

import pytest
from fusion_affect.align import SECOND_NS, ClockModel, Grid, Newest, corrected_ns
from fusion_affect.fusion import Fusion
from fusion_affect.heart_rate import Baseline, Reading, combine
from fusion_affect.state import Expression, State
from fusion_affect.streams import Rate
from fusion_affect.tree import load
from sense4hri.names import StreamName

NAN = math.nan
TREE = load()
START = 1_700_000_000 * SECOND_NS
ECG, PPG = StreamName("p1", "ecg", "h10_1"), StreamName("p1", "ppg", "verity_1")
NEUTRAL = Expression("neutral", 0.9)


def at(seconds: float) -> int:
    return START + round(seconds * SECOND_NS)


def run(
    fusion: Fusion,
    seconds: float,
    *,
    ecg: float | None = 70.0,
    ppg: float | None = 72.0,
    expression: Expression | None = NEUTRAL,
    stamped: bool = True,
    faces: tuple[str, ...] | None = ("f1",),
    start: float = 0.0,
) -> list[State]:
    """Ten steps a second of a study with one participant; what is None is not sent."""
    states: list[State] = []
    for step in range(round(seconds * 10)):
        now = at(start + step / 10)
        if faces is not None:
            fusion.faces(faces, now)
        if expression and step % 5 == 0:
            fusion.expression("f1", expression, now if stamped else 0)
        if ecg is not None and step % 10 == 3:
            fusion.rate(ECG, "features", Rate(ecg, 0.9), now)
        if ppg is not None and step % 10 == 7:
            fusion.rate(PPG, "features", Rate(ppg, 0.8), now)
        states += fusion.due()
    return states


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


def test_wall_time_does_not_matter() -> None:
    """The states depend on stamps alone: at any speed, in order or shuffled within half a second, they are the same."""
    calls: list[tuple[float, Callable[[Fusion], None]]] = []
    for step in range(200):
        now = step / 10 + 0.001
        calls.append((now, partial(Fusion.faces, face_ids=("f1",), stamp_ns=at(now))))
        if step % 5 == 0:
            word = "neutral" if step < 100 else "angry"
            seen = Expression(word, 0.9)
            calls.append((now, partial(Fusion.expression, face_id="f1", expression=seen, stamp_ns=at(now))))
        if step % 10 == 3:
            rate = Rate(70.0 + step / 10, 0.9)
            calls.append((now, partial(Fusion.rate, name=ECG, source="features", rate=rate, receipt_ns=at(now))))

    def states(order: list[tuple[float, Callable[[Fusion], None]]]) -> list[State]:
        fusion, found = Fusion(TREE), []
        for _, call in order:
            call(fusion)
            found += fusion.due()
        return [s for s in found if s.time_ns >= at(2)]

    wanted = states(calls)
    shuffle = random.Random(1)
    late = sorted(calls, key=lambda entry: entry[0] + shuffle.uniform(0, 0.39))
    assert repr(states(late)) == repr(wanted)
    assert {s.state for s in wanted} == {"calm_relaxed", "stressed_anxious"}


def test_time_that_steps_back_begins_afresh() -> None:
    """A replay that starts over gives the states of its first pass again."""
    fusion = Fusion(TREE)
    first = run(fusion, 15.0)
    assert repr(run(fusion, 15.0)) == repr(first)


def test_a_long_pause_is_not_filled() -> None:
    """After a pause of an hour the grid goes on at the newest second instead of making up for 3600."""
    fusion = Fusion(TREE)
    run(fusion, 5.0)
    states = run(fusion, 5.0, start=3600.0)
    assert len(states) < 8
    assert states[-1].state == "calm_relaxed"


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


def test_corrected_time_orders_inputs() -> None:
    """A rate whose samples were taken before the grid point counts there, however late it was received."""
    fusion = Fusion(TREE)
    fusion.clock(ECG, ClockModel(0, START, 0.0))
    fusion.rate(ECG, "features", Rate(70.0, 0.9), at(1.9), 1 * SECOND_NS)
    fusion.rate(ECG, "features", Rate(80.0, 0.9), at(3.4), round(2.9 * SECOND_NS))
    fusion.faces((), at(3.6))
    assert [(state.time_ns, state.heart_rate_bpm) for state in fusion.due()] == [(at(2), 70.0), (at(3), 80.0)]


def test_the_last_milliseconds_of_a_clock_model_decide_nothing() -> None:
    """Two models a few ms apart, as live and recomputed ones are before the first shared segment, give one state."""
    found = []
    for offset_ns in (START, START - 5_000_000):
        fusion = Fusion(TREE)
        fusion.clock(ECG, ClockModel(0, offset_ns, 0.0))
        for second in range(1, 5):
            rate = Rate(60.0 + second, 0.9)
            fusion.rate(ECG, "features", rate, at(second + 0.05), round((second + 0.002) * SECOND_NS))
        found.append(repr(fusion.due()))
    assert found[0] == found[1]


def test_clock_model_of_another_epoch_is_not_used() -> None:
    """A model that puts a sample into the future or minutes before its receipt gives way to the receipt stamp."""
    model = ClockModel(0, 0, 0.0)
    assert corrected_ns(at(0), at(0.2), model) == at(0.2)
    assert corrected_ns(at(0), at(0.4), model) == at(0)
    assert corrected_ns(at(0), at(500), model) == at(500)
    assert corrected_ns(at(10), at(0), model) == at(0)
    assert corrected_ns(0, at(5), model) == at(5)
    assert corrected_ns(at(0), at(5), None) == at(5)


def test_newest_is_sorted() -> None:
    """Values that come out of order are found by their own time, and only those not after the moment asked for."""
    newest: Newest[str] = Newest()
    for time_ns, value in ((3, "c"), (1, "a"), (2, "b")):
        newest.put(time_ns, value)
    assert newest.at(0) is None
    assert newest.at(2) == (2, "b")
    assert newest.at(9) == (3, "c")


def test_grid_waits_half_a_second() -> None:
    """A grid point is due when an input bears a stamp half a second after it, once."""
    grid = Grid()
    grid.saw("x", at(0.2))
    grid.saw("x", at(1.4))
    assert grid.due() == []
    grid.saw("x", at(1.5))
    assert grid.due() == [at(1)]
    assert grid.due() == []


def reading(
    pipeline: str, source: str, bpm: float, quality: float = 0.9, age_s: float = 0.5, sensor: str = "s1"
) -> Reading:
    return Reading(pipeline, sensor, source, bpm, quality, age_s)


@pytest.mark.parametrize(
    ("source", "readings", "bpm"),
    [
        ("features", [("ecg", "features", 70.0), ("ecg", "device", 75.0)], 70.0),
        ("device", [("ecg", "features", 70.0), ("ecg", "device", 75.0, NAN)], 75.0),
        ("auto", [("ecg", "features", 70.0), ("ecg", "device", 75.0, NAN)], 70.0),
        ("auto", [("ecg", "features", NAN), ("ecg", "device", 75.0, NAN)], 75.0),
        ("auto", [("ecg", "features", 70.0, 0.1), ("ecg", "device", 75.0, NAN)], 75.0),
        ("features", [("ecg", "device", 75.0)], NAN),
        ("auto", [("ecg", "features", 70.0), ("ppg", "features", 74.0)], 72.0),
        ("auto", [("ecg", "features", 70.0, 0.9, 6.0), ("ppg", "features", 74.0)], 74.0),
        ("auto", [("ecg", "features", 0.0)], NAN),
        ("auto", [("ecg", "features", math.inf)], NAN),
        ("auto", [], NAN),
    ],
)
def test_heart_rate_source(source: str, readings: list[tuple], bpm: float) -> None:
    """The parameter heart_rate_source decides which rate of a sensor counts; pipelines are averaged."""
    found = combine([reading(*r) for r in readings], source, TREE.limits)
    assert found.bpm == pytest.approx(bpm, nan_ok=True)
    assert found.reasons


def test_only_what_concerns_the_heart_rate_is_told() -> None:
    """Of the reasons those about the heart rate are told, and nothing of a source that was not needed."""
    because = ("hrv: needs 30 s", "heart_rate_bpm needs three intervals")
    missing = Reading("ppg", "s1", "features", NAN, NAN, 0.5, because)
    found = combine(
        [missing, reading("ecg", "features", 70.0), reading("ecg", "device", 70.0, age_s=9.0)], "auto", TREE.limits
    )
    assert found.reasons[1:] == ("ppg/s1 features is missing: heart_rate_bpm needs three intervals",)


def test_two_sensors_of_one_pipeline_count_once() -> None:
    """Each pipeline has one vote, however many sensors it has."""
    readings = [
        reading("ecg", "features", 70.0, sensor="a"),
        reading("ecg", "features", 72.0, sensor="b"),
        reading("ppg", "features", 75.0),
    ]
    assert combine(readings, "auto", TREE.limits).bpm == pytest.approx(73.0)


def test_baseline_between_markers() -> None:
    """The median between baseline_start and baseline_end is the resting baseline, and moves the thresholds."""
    fusion = Fusion(TREE)
    run(fusion, 5.0)
    fusion.marker("baseline_start", "", at(5.0))
    run(fusion, 20.0, ecg=60.0, ppg=60.0, start=5.0)
    fusion.marker("baseline_end", "p1", at(24.0))
    last = run(fusion, 8.0, ecg=92.0, ppg=92.0, start=25.0)[-1]
    assert last.state == "stressed_anxious"
    assert "resting baseline 60.0 bpm" in last.reasons
    relative = next(i for i in last.indicators if i.name == "heart_rate_relative")
    assert relative.value == pytest.approx(92 / 60 - 1)
    assert relative.sources == (ECG.topic("features"), PPG.topic("features"))
    assert ("heart_rate_baseline", "1/min", 60.0) in last.extra


def test_baseline_from_the_first_seconds() -> None:
    """With baseline_s the first so many seconds are the resting baseline; until then the reasons count."""
    fusion = Fusion(TREE, baseline_s=15.0)
    states = run(fusion, 14.0)
    assert "of 15 s" in " | ".join(states[-1].reasons)
    last = run(fusion, 10.0, start=14.0)[-1]
    assert "resting baseline 71.0 bpm" in last.reasons


def test_short_baseline_is_not_learnt() -> None:
    """Three seconds of rest are no baseline; the reason says so and the one before stays."""
    baseline = Baseline()
    baseline.mark(at(0), "baseline_start")
    for second in range(12):
        baseline.learn(at(second), 60.0)
    baseline.mark(at(12), "baseline_end")
    baseline.mark(at(13), "baseline_start")
    for second in range(12, 16):
        baseline.learn(at(second), 100.0)
    baseline.mark(at(16), "baseline_end")
    baseline.learn(at(17), 100.0)
    assert baseline.bpm == 60.0
    assert "was not learnt" in baseline.reason


def test_a_late_marker_does_not_turn_time_back() -> None:
    """A marker set afterwards, for a moment long past, leaves the grid and all inputs alone."""
    fusion = Fusion(TREE)
    run(fusion, 60.0)
    fusion.marker("baseline_end", "", at(59.0))
    fusion.marker("baseline_start", "", at(20.0))
    states = run(fusion, 5.0, start=60.0)
    assert [s.state for s in states] == ["calm_relaxed"] * len(states)
    assert states[0].time_ns == at(60)


def test_indicators_only_where_they_are_honest() -> None:
    """Valence and arousal that the recogniser leaves at zero are not passed on as if they were measured."""
    assert run(Fusion(TREE), 5.0)[-1].indicators == ()
    filled = run(Fusion(TREE), 5.0, expression=Expression("happy", 0.8, 0.6, 0.2))[-1]
    assert [(i.name, i.value) for i in filled.indicators] == [("expression_valence", 0.6), ("expression_arousal", 0.2)]
    assert filled.indicators[0].sources == ("/humans/faces/f1/expression",)


def test_an_awaited_heart_rate_is_waited_for() -> None:
    """No grid point passes what a computed heart rate last spoke of, until others are three seconds ahead of it."""
    grid = Grid()
    grid.saw("features", at(0.9), awaited=True)
    grid.saw("faces", at(3.8))
    assert grid.due() == []
    grid.saw("features", at(2.1), awaited=True)
    assert grid.due() == [at(1), at(2)]
    grid.saw("faces", at(5.6))
    assert grid.due() == [at(3), at(4), at(5)]


def test_the_first_features_are_waited_for_too() -> None:
    """A source that is there and has not spoken holds the grid at the first input, or where it came, for 3 s."""
    grid = Grid(expected=["features"])
    grid.saw("faces", at(0.2))
    grid.saw("faces", at(3.1))
    assert grid.due() == []
    grid.saw("features", at(1.3), awaited=True)
    assert grid.due() == [at(1)]
    grid.saw("faces", at(4.4))
    assert grid.due() == [at(2), at(3)]
    grid.expect("features")
    grid.saw("faces", at(7.0))
    assert grid.due() == [at(4)]
    grid.saw("faces", at(7.5))
    assert grid.due() == [at(5), at(6), at(7)]


def test_who_computes_nothing_more_is_not_waited_for() -> None:
    """Without features on the graph, or once their topic has gone, states wait for no heart rate."""
    fusion = Fusion(TREE)
    fusion.features_offered(ECG)
    fusion.vanished(ECG, "features")
    fusion.health(PPG, at(0.4), True)
    fusion.faces(("f1",), at(1.6))
    assert [state.time_ns for state in fusion.due()] == [at(1)]


def test_a_stream_that_comes_back_is_waited_for() -> None:
    """After a minute without its device, the first computed heart rate counts from its own time on, however late."""

    def states(lag_s: float) -> str:
        fusion, found = Fusion(TREE), []
        fusion.features_offered(ECG)
        calls = [(now, partial(fusion.health, PPG, at(now), True)) for now in range(90)]
        calls += [(now + 0.1, partial(fusion.health, ECG, at(now + 0.1), not 10 < now < 70)) for now in range(90)]
        for now in (*range(1, 10), *range(71, 90)):
            rate = partial(fusion.rate, ECG, "features", Rate(60.0 + now), at(now - 0.2))
            calls.append((now - 0.2 + lag_s, rate))
        for _, call in sorted(calls, key=lambda entry: entry[0]):
            call()
            found += [state for state in fusion.due() if state.time_ns <= at(80)]
        return repr(found)

    assert states(2.0) == states(0.02)


def test_computing_time_does_not_matter() -> None:
    """Features that lag two seconds of recorded time, as in a fast replay, give the states of features at once."""

    def states(lag_s: float) -> str:
        calls: list[tuple[float, Callable[[Fusion], None]]] = []
        for step in range(300):
            now = step / 10 + 0.001
            calls.append((now, partial(Fusion.faces, face_ids=("f1",), stamp_ns=at(now))))
            if step % 5 == 0:
                calls.append((now, partial(Fusion.expression, face_id="f1", expression=NEUTRAL, stamp_ns=at(now))))
            if step % 10 == 3:
                rate = partial(Fusion.rate, name=ECG, source="features", rate=Rate(50.0 + step / 7), receipt_ns=at(now))
                calls.append((now + lag_s, rate))
        fusion, found = Fusion(TREE), []
        fusion.features_offered(ECG)
        for _, call in sorted(calls, key=lambda entry: entry[0]):
            call(fusion)
            found += [state for state in fusion.due() if state.time_ns <= at(25)]
        return repr(found)

    assert states(2.0) == states(0.02)


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
