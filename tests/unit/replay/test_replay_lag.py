"""When playback waits for features."""

from replay.lag import Lag

SECOND_NS = 10**9
T0_NS = 1_700_000_000 * SECOND_NS


def at(seconds: float) -> int:
    return T0_NS + round(seconds * SECOND_NS)


def played(until_s: float, spoke_s: float) -> Lag:
    """Five frames a second from 0 on, and features once a second from 1 on."""
    lag = Lag()
    for step in range(round(until_s * 5) + 1):
        lag.sent(at(step / 5))
        if step and step % 5 == 0 and step / 5 <= spoke_s:
            lag.spoke(at(step / 5))
    return lag


def test_the_first_features_are_waited_for():
    """An interpreter that is there and has not spoken yet holds playback up 2.5 s after the first raw message."""
    assert not played(2.4, 0.0).behind()
    assert played(2.6, 0.0).behind()


def test_features_may_be_two_and_a_half_seconds_behind():
    """Less is how they come, at the start of a segment too; more holds playback up until they have come."""
    assert not played(12.4, 10.0).behind()
    lag = played(12.6, 10.0)
    assert lag.behind()
    lag.spoke(at(11.0))
    assert not lag.behind()


def test_who_stays_silent_is_given_up_until_it_speaks():
    """A dead interpreter holds playback up once; when it speaks again it counts again."""
    lag = played(13.0, 10.0)
    lag.given_up = True
    assert not lag.behind()
    lag.spoke(at(10.2))
    assert lag.behind()


def test_after_a_gap_features_begin_anew():
    """Where the recording holds nothing for a while, features count from the data after it on."""
    lag = played(10.0, 10.0)
    lag.sent(at(60.0))
    assert not lag.behind()
    for step in range(1, 14):
        lag.sent(at(60.0 + step / 5))
    lag.spoke(at(10.0))
    assert lag.behind()
    lag.spoke(at(61.0))
    assert not lag.behind()


def test_a_seek_begins_afresh():
    """After a seek back, stamps of before say nothing."""
    lag = played(60.0, 50.0)
    assert lag.behind()
    lag.begin()
    lag.sent(at(5.0))
    assert not lag.behind()
