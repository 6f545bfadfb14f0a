"""When a recorded message is due."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from replay.pace import LATEST_S, Pace

SECOND_NS = 1_000_000_000
rates = st.floats(0.1, 100.0)


@given(rates, st.integers(0, 3600 * SECOND_NS))
def test_recorded_time_is_divided_by_the_rate(rate, later_ns):
    """A message d seconds after the first is due d/rate seconds after it."""
    pace = Pace(rate)
    pace.begin(5 * SECOND_NS, 100.0)
    assert pace.due_s(5 * SECOND_NS + later_ns) == pytest.approx(100.0 + later_ns / 1e9 / rate)
    assert pace.position_ns(pace.due_s(5 * SECOND_NS + later_ns), 0) == pytest.approx(5e9 + later_ns, abs=1e3 * rate)


def test_without_a_rate_everything_is_due_at_once():
    """Rate 0 never waits, and its position is the newest message."""
    pace = Pace(0.0)
    pace.begin(0, 100.0)
    assert pace.due_s(10**18) == -math.inf
    assert pace.position_ns(200.0, 77) == 77


@given(st.floats(0.0, 1e4))
def test_a_pause_moves_everything_by_its_length(length_s):
    """While paused nothing is due; afterwards everything is due that much later."""
    pace = Pace(2.0)
    pace.begin(0, 10.0)
    before_s = pace.due_s(8 * SECOND_NS)
    pace.pause(11.0)
    assert pace.paused
    assert pace.due_s(0) == math.inf
    assert pace.position_ns(11.0 + length_s, 0) == 2 * SECOND_NS
    pace.resume(11.0 + length_s)
    assert pace.due_s(8 * SECOND_NS) == pytest.approx(before_s + length_s)


def test_a_seek_while_paused_stays_paused():
    """After a seek in a pause the pause goes on, and resuming begins at the new place."""
    pace = Pace(1.0)
    pace.begin(0, 0.0)
    pace.pause(1.0)
    pace.begin(60 * SECOND_NS, 5.0)
    assert pace.paused
    pace.resume(9.0)
    assert pace.due_s(60 * SECOND_NS) == pytest.approx(9.0)


def test_another_rate_goes_on_from_the_place_reached():
    """Changing the rate changes how fast it goes on, not where it is."""
    pace = Pace(1.0)
    pace.begin(0, 0.0)
    pace.set_rate(10.0, 4.0, 0)
    assert pace.position_ns(4.0, 0) == 4 * SECOND_NS
    assert pace.due_s(14 * SECOND_NS) == pytest.approx(5.0)
    pace.set_rate(0.0, 5.0, 14 * SECOND_NS)
    pace.set_rate(1.0, 6.0, 20 * SECOND_NS)
    assert pace.due_s(21 * SECOND_NS) == pytest.approx(7.0)


def test_what_is_far_behind_does_not_hurry():
    """A message later than the limit moves the whole schedule, so that no burst follows a stall of the host."""
    pace = Pace(1.0)
    pace.begin(0, 0.0)
    assert pace.played(SECOND_NS, 1.0 + LATEST_S / 2) == 0.0
    assert pace.played(2 * SECOND_NS, 12.0) == pytest.approx(10.0)
    assert pace.due_s(3 * SECOND_NS) == pytest.approx(13.0)


def test_a_stamp_years_away_keeps_nobody_waiting():
    """What comes after a silence of more than an hour is due at once; a shorter one is kept."""
    pace, year_ns = Pace(1.0), 365 * 86_400 * 10**9
    pace.begin(0, 100.0)
    assert pace.leap(10**9, 0, 100.5) == 0.0
    assert pace.due_s(10**9) == 101.0
    assert pace.leap(20 * year_ns, 10**9, 102.0) == (20 * year_ns - 10**9) / 1e9
    assert pace.due_s(20 * year_ns) == 102.0


@given(rates, st.floats(0.0, 10.0), st.integers(1, 5 * SECOND_NS))
def test_the_time_told_never_passes_a_message_that_is_still_to_come(rate, late_s, step_ns):
    """However late the next message is, /clock waits for it; before it is due the time is on its way there."""
    pace = Pace(rate)
    pace.begin(0, 100.0)
    due_s = pace.due_s(step_ns)
    assert pace.told_ns(due_s + late_s, 0, step_ns) == pytest.approx(step_ns, abs=1e3 * rate)
    assert pace.told_ns(due_s + late_s, 0, step_ns) <= step_ns
    assert pace.told_ns((100.0 + due_s) / 2, 0, step_ns) == pytest.approx(step_ns / 2, abs=1e3 * rate)
