"""Who of the services lives, by what they say once a second."""

from sense4hri.beats import AFRESH_S, EVERY_S, MAKES_ROOM_S, MOST, SILENT_S, Beat, Beats


def test_who_says_nothing_is_told_within_five_seconds_until_it_lives_again():
    """By a sentence that stays the same; who speaks again is well, who never spoke is not judged."""
    beats = Beats()
    assert beats.troubles(0.0) == {}
    beats.take(Beat("clock_sync", "1"), 0.0)
    assert beats.troubles(SILENT_S) == {}
    told = beats.troubles(5.0 - EVERY_S)
    assert list(told) == ["clock_sync"]
    assert "no heartbeat" in told["clock_sync"]
    assert beats.troubles(60.0) == beats.troubles(10_000.0) == told
    beats.take(Beat("clock_sync", "1"), 10_001.0)
    assert (beats.troubles(10_001.0), beats.afresh(10_001.0)) == ({}, [])


def test_a_killed_service_that_is_back_was_started_afresh_one_that_ended_was_not():
    """Also where it was back before anybody missed it."""
    beats = Beats()
    for service in ("killed", "restarted"):
        beats.take(Beat(service, "1"), 0.0)
    beats.take(Beat("restarted", "1", ended=True), 0.5)
    assert beats.troubles(100.0).keys() == {"killed"}
    for service in ("killed", "restarted"):
        beats.take(Beat(service, "2"), 101.0)
    assert beats.afresh(101.0) == ["killed"]
    beats.take(Beat("killed", "2"), 102.0)
    assert beats.afresh(102.0) == ["killed"]
    assert beats.afresh(101.0 + AFRESH_S) == []


def test_two_that_live_under_one_name_are_no_restart():
    """The first is heard again after the second: neither was killed, until one of them is silent or ends in order."""
    beats = Beats()
    for half_s in range(8):
        beats.take(Beat("recorder", str(half_s % 2)), half_s / 2)
        assert beats.twins(half_s / 2) == (["recorder"] if half_s >= 2 else [])
    assert beats.afresh(3.5) == []
    for second in range(4, 9):
        beats.take(Beat("recorder", "1"), float(second))
    assert (beats.twins(8.0), beats.afresh(8.0)) == ([], [])
    beats.take(Beat("recorder", "2"), 9.0)
    assert (beats.twins(9.0), beats.afresh(9.0)) == ([], ["recorder"])


def test_a_thread_that_hangs_is_told_in_its_service_s_words():
    """What the service says of itself is what is told."""
    beats = Beats()
    beats.take(Beat("recorder", "1", "no answer from the hearing thread"), 0.0)
    assert beats.troubles(0.1) == {"recorder": "no answer from the hearing thread"}


def test_a_stranger_with_a_thousand_services_takes_no_memory_and_no_place():
    """So many are known at most; those who are go on being judged."""
    beats = Beats()
    beats.take(Beat("recorder", "1"), 0.0)
    for number in range(2 * MOST):
        beats.take(Beat(f"stranger_{number}", "1"), 1.0)
    assert len(beats.troubles(10.0)) == MOST
    assert "recorder" in beats.troubles(10.0)
    beats.take(Beat("newcomer", "1"), 2.0 + MAKES_ROOM_S)
    assert "newcomer" in beats.troubles(10.0 + MAKES_ROOM_S)
