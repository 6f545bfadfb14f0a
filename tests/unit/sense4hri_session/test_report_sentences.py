"""How a report writes its sentences."""

import pytest
from sense4hri_report.pieces import sentence


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
