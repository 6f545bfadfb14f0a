"""What a recorder says of itself: text on the graph, values for whoever hears it."""

from types import SimpleNamespace

import pytest
from sense4hri.recorder_status import NAME, RecorderStatus

SAID = RecorderStatus(
    *("recorder_2", "warning", "3 messages lost", True, "/data/s1", "s1"),
    *(1000, 3, 20_000, 10**12, 61.5, "/data/s0/report.html", 0.2),
)


def published(values, level=b"\0", name=NAME):
    """A DiagnosticStatus with these values."""
    entries = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
    return SimpleNamespace(name=name, hardware_id="recorder_2", level=level, message="3 messages lost", values=entries)


def test_what_is_written_is_read_again():
    """Every value comes back as what it was, also where it is not known; the agreement's keys are all there."""
    for said in (SAID, RecorderStatus("recorder_2", "warning", "3 messages lost", minutes_left=None)):
        assert all(isinstance(value, str) for value in said.values().values())
        assert RecorderStatus.parse(published(said.values(), b"\x01")) == said


def test_what_somebody_else_publishes_there_is_not_a_recorders():
    """Another status is none, a level that does not exist is an error."""
    assert RecorderStatus.parse(published({}, name="camera: frames")) is None
    assert RecorderStatus.parse(published({}, b"\xff")).level == "error"


@pytest.mark.parametrize(
    ("message", "lost", "of", "besides"),
    [
        ("3 messages lost", 3, "", ""),
        ("3 messages lost (2 of /a, 1 of /b)", 3, "2 of /a, 1 of /b", ""),
        ("3 messages lost (3 of /a); not safe; no report", 3, "3 of /a", "not safe; no report"),
        ("the disk lasts 12 more minutes", 0, "", "the disk lasts 12 more minutes"),
        ("30 messages lost", 3, "", "30 messages lost"),
        ("30 messages lost", None, "", "30 messages lost"),
    ],
)
def test_what_a_message_says_of_losses_stands_apart_from_the_rest(message, lost, of, besides):
    """Whoever counts losses already shows the rest; words that are not of the number that is told are the rest."""
    said = RecorderStatus(level="warning", message=message, lost=lost)
    assert (said.lost_of, said.besides) == (of, besides)


@pytest.mark.parametrize("wrong", ["", "many", "-3", "nan", "\u00b2", "9" * 30])
def test_what_a_recorder_cannot_say_is_not_known(wrong):
    """An empty or senseless number is None, never 0; so is one that is absent."""
    counts = ("messages", "lost", "free_bytes", "written_bytes")
    for values in (dict.fromkeys(counts, wrong), {}):
        status = RecorderStatus.parse(published(values))
        assert [getattr(status, name) for name in (*counts, "minutes_left")] == [None] * 5
    for minutes in ("", "soon", "nan", "inf"):
        assert RecorderStatus.parse(published({"minutes_left": minutes})).minutes_left is None
