"""What was refused is counted, and who sent it is named once."""

import pytest
from sense4hri import refusals
from sense4hri.refusals import MOST_NAMED, Refusals


class Told:
    """A Refusals whose publishers a test sets."""

    def __init__(self) -> None:
        self.nodes: list[str] = []
        self.counted: list[str] = []
        self.lines: list[str] = []
        self.refusals = Refusals(self.counted.append, lambda place: self.nodes, self.lines.append)


@pytest.fixture
def told(monkeypatch):
    monkeypatch.setattr(refusals, "LOOK_S", 0.0)
    return Told()


def test_each_sender_is_named_once_and_everything_counted(told):
    """A thousand messages of one node are one line; another node on the same topic is a second one."""
    told.nodes = ["/stranger"]
    for number in range(1000):
        told.refusals.add("/a", "PhysioRaw", f"reason {number}")
    assert told.lines == ["/a: refused from /stranger: reason 0; more of it is only counted"]
    assert told.counted == ["PhysioRaw"] * 1000
    told.nodes = ["/stranger", "/other"]
    told.refusals.add("/a", "PhysioRaw", "again")
    told.nodes = ["/other"]
    told.refusals.add("/a", "PhysioRaw", "again")
    assert len(told.lines) == 2
    assert "from /other, /stranger: again" in told.lines[1]
    assert told.refusals.named["/a"].count == 1002


def test_a_stranger_with_many_topics_does_not_fill_the_log(told):
    """Beyond MOST_NAMED topics nothing is written or remembered; all of it is counted."""
    for number in range(MOST_NAMED + 50):
        told.refusals.add(f"/t{number}", "Marker", "no")
    assert (len(told.lines), len(told.refusals.named), len(told.counted)) == (MOST_NAMED, MOST_NAMED, MOST_NAMED + 50)


def test_a_sentence_is_short(told):
    """What a stranger wrote stands in the log with at most a few hundred characters."""
    told.refusals.add("/a", "Marker", "x" * 100_000)
    assert len(told.lines[0]) < 400
