"""When a state is due, and by what time: stamps alone decide."""

import random
from collections.abc import Callable
from functools import partial

from fused import ECG, NEUTRAL, PPG, START, TREE, at, run
from fusion_affect.align import AWAITED_LOOKS, SECOND_NS, ClockModel, Grid, Newest, corrected_ns
from fusion_affect.fusion import Fusion
from fusion_affect.state import Expression, State
from fusion_affect.streams import Rate
from sense4hri.names import StreamName


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


def test_who_is_who_holds_for_the_first_state_where_it_is_told_before_that() -> None:
    """At a start nothing orders it among the inputs: one heard a moment later must not make another first state."""
    fusion = Fusion(TREE)
    assert run(fusion, 0.7, start=0.6) == []
    fusion.persons("tracked", ("p1",))
    fusion.person_face("p1", "f1")
    states = run(fusion, 2.0, start=1.3)
    assert [(s.time_ns, s.person_id) for s in states] == [(at(1), "p1"), (at(2), "p1")]


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


def test_one_stamp_ahead_of_all_others_silences_only_while_its_source_is_there() -> None:
    """Once a driver whose host is an hour ahead has left, states go on with the time of those who are there."""
    fusion = Fusion(TREE)
    before = run(fusion, 10.0)
    fusion.health(PPG, at(3610.0), streaming=True)
    fusion.due()
    assert run(fusion, 5.0, start=10.0) == []
    fusion.vanished(PPG, "health")
    after = run(fusion, 10.0, start=15.0)
    assert len(before) >= 8
    assert [state.time_ns for state in after][:1] <= [at(16)]
    assert len(after) >= 8


def test_what_was_said_while_one_stamp_was_ahead_counts_once_its_source_has_left() -> None:
    """Neither who is who, nor the expressions without a stamp after it, wait for the time of a host an hour ahead."""
    fusion = Fusion(TREE)
    run(fusion, 10.0, stamped=False)
    fusion.health(PPG, at(3610.0), streaming=True)
    fusion.due()
    fusion.persons("tracked", ("p1",))
    fusion.person_face("p1", "f1")
    run(fusion, 600.0, start=10.0, stamped=False)
    fusion.vanished(PPG, "health")
    states = run(fusion, 10.0, start=610.0, stamped=False)
    assert {(state.person_id, state.expression) for state in states[1:]} == {("p1", "neutral")}
    assert len(states) >= 8


def test_a_camera_an_hour_ahead_silences_only_while_it_is_there() -> None:
    """Once nobody lists faces any more, states go on with the time of the sensors."""
    fusion = Fusion(TREE)
    run(fusion, 5.0, faces=None)
    fusion.faces(("f1", "f2"), at(3605.0))
    fusion.due()
    assert run(fusion, 5.0, start=5.0, faces=None) == []
    fusion.faces_vanished()
    states = run(fusion, 10.0, start=10.0, faces=None)
    assert len(states) >= 8
    assert states[-1].face_id == "f1"


def test_lists_of_faces_without_a_stamp_are_no_clock() -> None:
    """They got the time of a host an hour ahead, and hold nobody there once that has left."""
    fusion = Fusion(TREE)
    run(fusion, 5.0, faces=None)
    fusion.health(PPG, at(3610.0), streaming=True)
    fusion.faces(("f1", "f2"), 0)
    fusion.due()
    fusion.vanished(PPG, "health")
    states = run(fusion, 10.0, start=5.0, faces=None)
    assert len(states) >= 8
    assert states[-1].face_id == "f1"


def test_corrected_time_orders_inputs() -> None:
    """A rate whose samples were taken before the grid point counts there, however late it was received."""
    fusion = Fusion(TREE)
    fusion.clock(ECG, ClockModel(0, START, 0.0))
    fusion.rate(ECG, "features", Rate(70.0, 0.9), at(1.9), 1 * SECOND_NS)
    fusion.vanished(ECG, "clock")  # clock-sync has ended: what it said last goes on
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


def named(heard_s: float, stamp_ns: int) -> list[str]:
    """Whom p1 is taken for at each second of 10, where anna takes the place of berta in the middle."""
    fusion, found = Fusion(TREE), []
    fusion.persons("tracked", ("anna", "berta"))
    fusion.assignments([("p1", "berta", 1)], at(-5.0))
    calls = [(step / 10, partial(fusion.health, ECG, at(step / 10), True)) for step in range(106)]
    calls.append((heard_s, partial(fusion.assignments, [("p1", "anna", 2)], stamp_ns)))
    for _, call in sorted(calls, key=lambda entry: entry[0]):
        call()
        found += [state.person_id for state in fusion.due()]
    return found


def test_an_assignment_holds_from_its_stamp_on() -> None:
    """Heard at once, late within the half second, or early, as in a fast replay: the same second is the first."""
    wanted = ["berta"] * 6 + ["anna"] * 5
    assert named(5.95, at(5.9)) == wanted
    assert named(6.3, at(5.9)) == wanted
    assert named(4.0, at(5.9)) == wanted


def test_an_assignment_of_no_time_or_of_another_one_holds_at_once() -> None:
    """Without a stamp, or with that of a registry whose clock is an hour off, it holds from when it came."""
    wanted = ["berta"] * 6 + ["anna"] * 5
    for stamp_ns in (0, at(-3600.0), at(3600.0)):
        assert named(5.95, stamp_ns)[-5:] == wanted[-5:]


def test_the_assignment_that_came_last_counts() -> None:
    """One stamped before another that is still to hold, as where the registry's clock was set back, is not undone."""
    fusion, found = Fusion(TREE), []
    fusion.persons("tracked", ("anna", "berta", "carla"))
    for step in range(100):
        fusion.health(ECG, at(step / 10), True)
        if step == 20:
            fusion.assignments([("p1", "anna", 1)], at(5.0))
            fusion.assignments([("p1", "berta", 2)], at(4.0))
        found += [state.person_id for state in fusion.due()]
    assert found == [""] * 5 + ["berta"] * 5
    again = []
    for step in range(40):
        fusion.assignments([("p1", "carla", 1)], at(-3600.0))
        fusion.health(ECG, at(step / 10 - 3600.0), True)
        again += [state.person_id for state in fusion.due()]
    assert set(again) == {"carla"}


def test_who_comes_back_is_there_from_their_first_sign_on() -> None:
    """Whatever the computing time of another's heart rate: a silence ends in no state before its end."""

    def seconds_of_p2(lag_s: float) -> list[int]:
        fusion, found = Fusion(TREE), []
        fusion.features_offered(ECG)
        eda = StreamName("p2", "eda", "e4_1")
        calls = [(now + 0.1, partial(fusion.health, eda, at(now + 0.1), True)) for now in (*range(10), *range(40, 50))]
        calls += [(now + lag_s, partial(fusion.rate, ECG, "features", Rate(70.0), at(now))) for now in range(50)]
        for _, call in sorted(calls, key=lambda entry: entry[0]):
            call()
            found += [(s.time_ns - START) // SECOND_NS for s in fusion.due() if s.human_id == "p2"]
        return [second for second in found if second < 45]

    assert seconds_of_p2(2.0) == seconds_of_p2(0.02) == [*range(1, 25), *range(41, 45)]


def test_a_fast_camera_is_remembered_for_as_long_as_a_grid_point_waits() -> None:
    """In a replay at 20x, looked at once a second of it, 60 lists of two faces a second and features 8 s late."""
    fusion, said, images = Fusion(TREE), set(), 60
    fusion.features_offered(ECG)
    calls = [(n / images, partial(fusion.faces, ("f1", "f2"), at(n / images))) for n in range(30 * images)]
    calls += [(n / 2, partial(fusion.expression, "f1", NEUTRAL, at(n / 2))) for n in range(60)]
    calls += [(n + 8.0, partial(fusion.rate, ECG, "features", Rate(70.0), at(n))) for n in range(22)]
    calls += [(n + 0.5, lambda: said.update(state.reasons[0] for state in fusion.due())) for n in range(30)]
    for _, call in sorted(calls, key=lambda entry: entry[0]):
        call()
    assert said == {"no person is named p1, and 2 faces are tracked, not one"}


def test_a_hand_over_is_seen_without_the_graph() -> None:
    """In a replay no topic goes: who wore a sensor until another did has no state and no heart rate of it any more."""

    def states(*, live: bool) -> list[tuple[int, str, str, float]]:
        fusion, found = Fusion(TREE), []
        band = StreamName("p1", "eda", "band_1")
        calls: list[tuple[float, Callable[[], object]]] = []
        for step in range(300):
            now, ecg = step / 10, ECG if step < 200 else ECG._replace(human_id="p2")
            calls.append((now, partial(fusion.faces, ("f1",), at(now))))
            calls.append((now, partial(fusion.expression, "f1", NEUTRAL, at(now))))
            if step < 100:
                calls.append((now, partial(fusion.health, band, at(now), True)))
            if step % 10 == 3:
                calls.append((now, partial(fusion.health, ecg, at(now), True)))
                calls.append((now, partial(fusion.rate, ecg, "features", Rate(70.0), at(now))))
        if live:
            calls += [(20.2, partial(fusion.vanished, ECG, field)) for field in ("health", "features")]
        for _, call in sorted(calls, key=lambda entry: entry[0]):
            call()
            found += [(s.time_ns, s.human_id, s.state, s.heart_rate_bpm) for s in fusion.due() if s.time_ns > at(20)]
        return found

    assert repr(states(live=False)) == repr(states(live=True))
    assert {(human_id, bpm) for _, human_id, _, bpm in states(live=False) if human_id == "p2"} == {("p2", 70.0)}
    assert states(live=False)[-1][1:3] == ("p2", "calm_relaxed")


def test_a_driver_that_ends_is_seen_without_the_graph() -> None:
    """It says so before its topics go; in a replay they stay. What comes back later is there again."""

    def seconds_of_p1(*, live: bool) -> list[int]:
        fusion, found = Fusion(TREE), []
        eda = StreamName("p2", "eda", "e4_1")
        calls = [(now, partial(fusion.health, eda, at(now), True)) for now in range(40)]
        for now in (*range(20), *range(30, 40)):
            calls.append((now, partial(fusion.health, ECG, at(now), True)))
            calls.append((now + 0.05, partial(fusion.rate, ECG, "features", Rate(70.0), at(now))))
        calls.append((19.8, partial(fusion.health, ECG, at(19.8), False, ends=True)))
        if live:
            calls += [(19.9, partial(fusion.vanished, ECG, field)) for field in ("health", "features")]
        for _, call in sorted(calls, key=lambda entry: entry[0]):
            call()
            found += [(s.time_ns - START) // SECOND_NS for s in fusion.due() if s.human_id == "p1"]
        return [second for second in found if second != 19]  # live its data have gone with its topics

    assert seconds_of_p1(live=False) == seconds_of_p1(live=True) == [*range(19), *range(30, 39)]


def test_a_driver_that_ends_gives_its_sensor_back_to_nobody() -> None:
    """Who wore it a moment before is no wearer for that."""
    fusion, found = Fusion(TREE), []
    eda, moved = StreamName("p3", "eda", "e4_1"), ECG._replace(human_id="p2")
    for now in range(20):
        fusion.health(eda, at(now), True)
        if now < 10:
            fusion.health(ECG if now < 5 else moved, at(now), True)
        if now == 10:
            fusion.health(moved, at(now), False, ends=True)
        found += [(state.human_id, (state.time_ns - START) // SECOND_NS) for state in fusion.due()]
    assert [second for human_id, second in found if human_id == "p1"] == [*range(5)]
    assert [second for human_id, second in found if human_id == "p2"] == [*range(5, 10)]


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


def looked_often(grid: Grid) -> list[int]:
    """What is due once an awaited source has been looked for as often as in 3 s of a study."""
    return [point for _ in range(AWAITED_LOOKS + 1) for point in grid.due()]


def test_an_awaited_heart_rate_is_waited_for() -> None:
    """No grid point passes what a computed heart rate last spoke of, until others are three seconds ahead of it."""
    grid = Grid()
    grid.saw("features", at(0.9), awaited=True)
    grid.saw("faces", at(3.8))
    assert grid.due() == []
    grid.saw("features", at(2.1), awaited=True)
    assert grid.due() == [at(1), at(2)]
    grid.saw("faces", at(5.0))
    assert looked_often(grid) == []
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
    assert looked_often(grid) == [at(2), at(3)]
    grid.expect("features")
    grid.saw("faces", at(7.0))
    assert looked_often(grid) == [at(4)]
    grid.saw("faces", at(7.5))
    assert grid.due() == [at(5), at(6), at(7)]


def test_three_seconds_of_a_fast_replay_are_a_moment() -> None:
    """Others three seconds ahead at once, as at 20x, are no silence: it is looked for some more, or until 9 s ahead."""
    grid = Grid()
    grid.saw("features", at(0.9), awaited=True)
    grid.saw("faces", at(5.6))
    assert grid.due() == []
    grid.saw("features", at(4.1), awaited=True)
    assert grid.due() == [at(1), at(2), at(3), at(4)]
    grid.saw("faces", at(13.0))
    assert grid.due() == []
    grid.saw("faces", at(13.2))
    assert grid.due() == [at(second) for second in range(5, 13)]


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
