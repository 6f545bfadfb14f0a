"""How long is rested after work that costs more in a larger study."""

import time

import pytest
from sense4hri import pace
from sense4hri.pace import Pace


@pytest.fixture
def used(monkeypatch):
    """Have the next round use so much CPU of its thread, in s."""

    def use(seconds):
        readings = iter([10.0, 10.0 + seconds])
        monkeypatch.setattr(pace.time, "thread_time", lambda: next(readings))

    return use


@pytest.mark.parametrize(
    ("used_s", "rest_s"), [(0.0, 0.2), (0.001, 0.2), (0.004, 0.4), (0.015, 1.5), (0.02, 2.0), (5.0, 2.0)]
)
def test_the_rest_keeps_the_work_within_its_share(used, used_s, rest_s):
    """One hundredth of a core: a round of 4 ms is rested for 400; within the two bounds."""
    rounds = Pace(0.01, 0.2, 2.0)
    used(used_s)
    rounds.begin()
    assert rounds.rest_s() == pytest.approx(rest_s)


def test_waiting_is_no_work():
    """A round in which the thread only waited, as on a machine that is busy with others, is rested for no longer."""
    rounds = Pace(0.01, 0.2, 20.0)
    rounds.begin()
    time.sleep(0.05)
    assert rounds.rest_s() < 2.0  # 5 s if it counted


def test_what_others_do_between_two_parts_of_a_round_is_no_work_of_it(monkeypatch):
    """A round of 3 and 5 ms, between which others had the thread, is rested for like one of 8 ms."""
    readings = iter([10.0, 10.003, 20.0, 20.005])
    monkeypatch.setattr(pace.time, "thread_time", lambda: next(readings))
    rounds = Pace(0.01, 0.2, 2.0)
    rounds.begin()
    rounds.pause()
    rounds.go_on()
    assert rounds.rest_s() == pytest.approx(0.8)
