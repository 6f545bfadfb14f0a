"""Health that is not well says why."""

import pytest
from sense4hri.health import Link, State, StreamCounts, health_message


@pytest.mark.parametrize("state", [state for state in State if state is not State.STREAMING])
@pytest.mark.parametrize("reason", ["", "the strap is gone"])
def test_what_does_not_stream_has_a_reason(state: State, reason: str) -> None:
    """The device's own where there is one; of one that streams nothing is to be said."""
    (told,) = health_message("strap_1", state, 130.0, Link(reason=reason), StreamCounts()).reasons
    assert told == reason if reason else told
    assert list(health_message("strap_1", State.STREAMING, 130.0, Link(), StreamCounts()).reasons) == []
