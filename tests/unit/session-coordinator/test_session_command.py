"""`sense4hri-session`: what it makes of what it hears."""

import time
from argparse import Namespace
from types import SimpleNamespace

import pytest
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import SessionState
from session_coordinator import cli


class Line:
    """Answers as the coordinator does; the states come one by one, whenever one is waited for."""

    def __init__(self, *states: SessionState) -> None:
        self.state, self._coming = None, list(states)
        self.coordinators = [1]  # how many there are, whenever it is looked; the last number stays
        self.node = SimpleNamespace(count_publishers=self._count)

    def _count(self, topic: str) -> int:
        return self.coordinators.pop(0) if len(self.coordinators) > 1 else self.coordinators[0]

    def until(self, condition, seconds):
        if self._coming:
            self.state = self._coming.pop(0)
        return condition()

    def ask(self, kind, name, request):
        return SimpleNamespace(success=True, message="", session_id="s1")


def state(phase: str, session_id: str = "") -> SessionState:
    return SessionState(phase=getattr(SessionState, phase), session_id=session_id)


@pytest.mark.parametrize(("end", "status"), [("RECORDING", 0), ("FAILED", 1)])
def test_the_idle_before_a_start_does_not_end_it(end, status):
    """It was heard before the answer came, and says nothing of what was asked for."""
    wish = Namespace(
        study="s", session="s1", task="", metadata="", human=[], require=[], allow_warmup=False, no_wait=False
    )
    line = Line(state("IDLE"), state("PREPARING", "s1"), state(end, "s1"))
    assert cli.start(line, wish) == status


def test_who_follows_a_session_is_told_once_that_nobody_conducts_it_any_more(capsys):
    """Nothing else would be said until a coordinator is there again, which goes on with it."""
    preparing = state("PREPARING", "s1")
    line = Line(preparing, *[preparing] * 3, state("RECORDING", "s1"))
    line.coordinators = [1, 0, 0, 1, 0]
    assert cli._follow(line, "s1", {SessionState.RECORDING}).phase == SessionState.RECORDING
    told = capsys.readouterr().out.splitlines()
    assert [words.split()[0] for words in told] == ["PREPARING", "no", "PREPARING", "RECORDING"]
    assert told[1] == "no session-coordinator any more; the session goes on where one is started within its time"


def test_what_services_say_of_themselves_is_one_line_on_the_terminal(capsys):
    """A newline, and what moves a terminal's cursor, is shown by its picture."""
    said = state("RECORDING", "s1")
    said.waiting_for = ["recorder: none\n\x1b[2JIDLE"]
    cli.status(Line(said), Namespace())
    assert capsys.readouterr().out.endswith("waiting for recorder: none␊␛[2JIDLE\n")


@pytest.mark.parametrize(
    ("ahead_s", "begins", "waits"), [(30, "begins at", False), (-30, "since", True)], ids=["ahead", "over"]
)
def test_nobody_is_missing_before_the_announced_moment(ahead_s, begins, waits, capsys):
    """When it is announced nobody has answered yet; who is missing from that moment on is named."""
    said = state("RECORDING", "s1")
    said.start_at = from_ns(time.time_ns() + ahead_s * 10**9)
    said.waiting_for = ["clock_sync: no answer yet"]
    cli.status(Line(said), Namespace())
    told = capsys.readouterr().out
    assert begins in told
    assert ("clock_sync" in told) is waits
