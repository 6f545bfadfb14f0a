"""Parameters that make no sense."""

import pytest
from replay.config import Config


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate", -1.0),
        ("rate", 0.001),
        ("rate", float("nan")),
        ("what", "half"),
        ("topics", ("a",)),
        ("exclude", ("b/*",)),
        ("start_s", -1.0),
        ("discovery_s", float("nan")),
        ("wait_for", ("interpreter-ecg",)),
    ],
)
def test_a_wrong_parameter_is_named(name, value):
    """What cannot be played is refused with the parameter's name."""
    with pytest.raises(ValueError, match=f"'{name}'"):
        Config(**{name: value})


@pytest.mark.parametrize("rate", [0.0, 0.1, 1.0, 20.0, 1000.0])
def test_from_a_tenth_to_as_fast_as_can_be(rate):
    """0 is as fast as subscribers keep up; otherwise from slow motion to a thousandfold."""
    assert Config(rate=rate).rate == rate
