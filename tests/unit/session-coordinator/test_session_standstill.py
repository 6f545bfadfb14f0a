"""A coordinator that stood still itself: what it did not hear meanwhile is nobody's silence."""

from conducted_study import Study
from sense4hri.beats import SILENT_S, Beat, Beats
from session_coordinator.awake import MOST_S, AwakeClock
from session_coordinator.coordinator import SETTLE_S
from session_coordinator.session import Phase


def test_time_in_which_this_process_stood_still_does_not_count():
    """However often; what passes between readings that are near each other counts in full."""
    given = [0.0]
    clock = AwakeClock(lambda: given[0])
    begun_s = clock.now_s()
    for step_s in (0.1, 0.25, 17.0, 0.1, 3600.0, 0.1):
        given[0] += step_s
        clock.now_s()
    assert abs(clock.now_s() - begun_s - (0.55 + 2 * MOST_S)) < 1e-9


def test_a_machine_that_is_starved_again_and_again_accuses_nobody_and_a_dead_service_is_told_all_the_same():
    """It stands still for 5 s, and 0.3 s it goes: who beats is not called silent, who does not is."""
    given, beats = [0.0], Beats()
    clock = AwakeClock(lambda: given[0])
    beats.take(Beat("dead", "1"), clock.now_s())
    for _ in range(20):
        given[0] += 5.0
        found = beats.troubles(clock.now_s())
        assert "living" not in found
        beats.take(Beat("living", "1"), clock.now_s())
        for _ in range(3):
            given[0] += 0.1
            clock.now_s()
    assert found.keys() == {"dead"}
    assert 20 * (MOST_S + 0.3) > SILENT_S


def test_who_is_not_on_the_graph_when_it_wakes_may_be_found_again():
    """DDS forgets after 20 s in which nothing was heard; who is not there later has gone, and is told then."""
    study = Study("driver", "interpreter").record()
    there = dict(study.nodes)
    study.coordinator.woke(study.now())
    study.nodes.clear()
    study.look()
    study.nodes.update(there)
    study.look()
    assert study.session.expected == ("driver", "interpreter")
    del study.nodes["driver"]
    study.look()
    assert study.notes() == []
    study.pass_s(SETTLE_S)
    study.look()
    assert study.notes() == ["service gone: driver"]
    assert study.session.phase is Phase.RECORDING
