"""When a session is over of which its coordinator says nothing any more."""

import pytest
from metadata_registry.deserted import MOST_RECORDERS, Deserted
from sense4hri.recorder_status import RecorderStatus

OVER_AFTER_S = 120.0


class Study:
    """A study without a coordinator, second by second. recorders: what they say each second, by node."""

    def __init__(self) -> None:
        self.deserted, self.now_s = Deserted(OVER_AFTER_S), 1000.0

    def passes(self, seconds: int, **recorders: str) -> bool:
        """Whether session s1 was taken for over at any moment of it."""
        over = False
        for _ in range(seconds):
            self.now_s += 1.0
            for node, session_id in recorders.items():
                self.deserted.heard(RecorderStatus(node=node, session_id=session_id), self.now_s)
            self.deserted.looked(self.now_s)
            over |= self.deserted.is_over("s1", self.now_s)
        return over

    def why_not(self) -> str:
        return self.deserted.why_not("s1", self.now_s)


def test_it_is_over_once_the_coordinator_could_go_on_with_it_no_more() -> None:
    """Not before, be a recorder there that is in another session or in none."""
    for session_id in ("", "s2"):
        study = Study()
        assert not study.passes(120, recorder=session_id)
        assert "in 1 s it is taken for over" in study.why_not()
        assert study.passes(2, recorder=session_id)


def test_it_is_never_over_while_a_recorder_is_in_it() -> None:
    """Also one that is not heard any more, and one that says so beside another one that is not."""
    study = Study()
    assert not study.passes(1000, recorder="s1")
    assert not study.passes(1000)
    assert not study.passes(1000, recorder_b="")
    assert "a recorder still records: start the session-coordinator again" in study.why_not()
    assert study.passes(1, recorder="")


def test_it_is_not_over_where_nobody_says_that_it_is_not_recorded() -> None:
    """The graph may have come apart: what is not heard here may record elsewhere."""
    study = Study()
    assert not study.passes(1000)
    assert "no recorder says whether it records it" in study.why_not()
    study.passes(1, recorder="")
    assert not study.deserted.is_over("s1", study.now_s + 10.0)


def test_a_coordinator_that_is_there_ends_the_waiting() -> None:
    """However short it is there: the time begins anew, and so does what recorders have said."""
    study = Study()
    study.passes(119, recorder="")
    study.deserted.conducted()
    assert not study.passes(120, recorder="")


def test_time_in_which_the_registry_stood_still_is_not_counted() -> None:
    """What nobody here has heard in it is not the silence of others."""
    study = Study()
    study.passes(100, recorder="")
    study.now_s += 3600.0
    assert not study.passes(10, recorder="")


@pytest.mark.parametrize("first", ["", "s1"])
def test_memory_is_bounded(first: str) -> None:
    """However many names somebody publishes; the recorder that was there before is heard all the same."""
    study = Study()
    study.passes(1, recorder=first)
    for number in range(10 * MOST_RECORDERS):
        study.deserted.heard(RecorderStatus(node=f"x_{number}", session_id=""), study.now_s)
    assert len(study.deserted._said) == MOST_RECORDERS
    assert study.passes(200, recorder=first) is (first == "")
