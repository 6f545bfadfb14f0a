"""Health that is not well says why."""

import pytest
from sense4hri import health
from sense4hri.health import Link, State, StreamCounts, health_message


@pytest.mark.parametrize("state", [state for state in State if state is not State.STREAMING])
@pytest.mark.parametrize("reason", ["", "the strap is gone"])
def test_what_does_not_stream_has_a_reason(state: State, reason: str) -> None:
    """The device's own where there is one; of one that streams nothing is to be said."""
    (told,) = health_message("strap_1", state, 130.0, Link(reason=reason), StreamCounts()).reasons
    assert told == reason if reason else told
    assert list(health_message("strap_1", State.STREAMING, 130.0, Link(), StreamCounts()).reasons) == []


@pytest.mark.parametrize(
    ("factor", "after_s", "told"),
    [(2.0, 40.0, True), (1.3, 40.0, True), (1.2, 40.0, False), (0.5, 40.0, False), (2.0, 10.0, False)],
)
def test_more_samples_than_are_declared_are_told(
    monkeypatch: pytest.MonkeyPatch, factor: float, after_s: float, told: bool
) -> None:
    """By a host's clock their times are wrong, and nothing else shows it; the first seconds may be catching up."""
    now_s = 5.0
    monkeypatch.setattr(health.time, "monotonic", lambda: now_s)
    counts = StreamCounts(nominal_hz=100.0)
    counts.samples_total = 7_000  # of an earlier connection
    counts.begin()
    while now_s < 5.0 + after_s:
        now_s += 0.2
        counts.arrived(round(20 * factor))
    reasons = health_message("box_1", State.STREAMING, 100.0, Link(), counts).reasons
    assert [f"{100 * factor:.0f} samples per s" in each for each in reasons] == [True] * told
    counts.device_time = True  # the device stamps them: its times are right, as of a recording that is played faster
    assert not health_message("box_1", State.STREAMING, 100.0, Link(), counts).reasons


def test_of_what_has_no_rate_none_are_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Irregular samples come as they come."""
    now_s = 0.0
    monkeypatch.setattr(health.time, "monotonic", lambda: now_s)
    counts = StreamCounts()
    now_s = 60.0
    counts.arrived(10_000)
    assert not health_message("box_1", State.STREAMING, 0.0, Link(), counts).reasons
