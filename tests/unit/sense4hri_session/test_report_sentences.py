"""How a report writes its sentences."""

import pytest
from sense4hri_report.pieces import sentence
from sense4hri_report.verdict import not_recorded


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("the recorder has not closed it", "The recorder has not closed it"),
        ("s01_rest_0.mcap was cut off", "s01_rest_0.mcap was cut off"),
        ("p1/ecg/h10_1: 3 gaps", "p1/ecg/h10_1: 3 gaps"),
        ("", ""),
    ],
)
def test_a_name_keeps_its_letters(text, written):
    """A sentence has a capital letter, but a file or a stream is called what it is called."""
    assert sentence(text) == written


def test_many_topics_that_could_not_be_recorded_for_one_reason_are_one_sentence():
    """A stranger may have hundreds of them; another reason is another sentence."""
    refused = [{"topic": f"/x/{number}", "why": "too many"} for number in range(3)]
    assert not_recorded([*refused, {"topic": "/y", "why": "no such type"}]) == [
        "/x/0 and 2 more could not be recorded: too many",
        "/y could not be recorded: no such type",
    ]
