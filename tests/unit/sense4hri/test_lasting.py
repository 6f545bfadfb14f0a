"""A quality that has not lasted is told from one that has."""

import math

from sense4hri.lasting import Lasting

SECOND_NS = 10**9
NAN = math.nan


def told(lasting: Lasting, *qualities: float, enough_s: float = 2.0) -> list[bool]:
    """What is said of an update each second."""
    return [lasting.too_short(quality, 10**15 + i * SECOND_NS, enough_s) for i, quality in enumerate(qualities)]


def test_what_is_good_for_a_moment_is_too_short_until_it_has_lasted():
    """A quality below the bound begins it anew, and is itself not called short."""
    assert told(Lasting(0.7), 0.8, 0.9, 0.7, 0.8) == [True, True, False, False]
    assert told(Lasting(0.7), 0.8, 0.6, 0.8, 0.8, 0.8) == [True, False, True, True, False]


def test_at_the_beginning_it_need_not_last_where_that_is_said():
    """A quality of NaN is none yet; once there was a bad one, and after a restart too, the rule is as ever."""
    lasting = Lasting(0.4, at_once=True)
    assert told(lasting, NAN, 0.9, 0.3, 0.9, 0.9, 0.9) == [False, False, False, True, True, False]
    assert told(lasting, 0.3, 0.9) == [False, True]
    lasting.restart()
    assert told(lasting, 0.9) == [False]


def test_what_cannot_be_said_asks_for_nothing():
    """Where it is not known how long is enough, nothing is too short."""
    assert told(Lasting(0.7), 0.9, enough_s=NAN) == [False]
