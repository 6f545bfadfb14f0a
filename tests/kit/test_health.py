"""What a driver says of its host's clock."""

import time
from collections.abc import Callable

import pytest
from sense4hri import health


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """interrupted(n): the process is kept waiting for 100 ms before the n-th reading of the wall clock."""

    def at(number: int) -> None:
        real, count, lag_ns = time.time_ns, 0, 0

        def delayed() -> int:
            nonlocal count, lag_ns
            count += 1
            lag_ns += 100_000_000 if count == number else 0
            return real() + lag_ns

        monotonic = time.monotonic_ns
        monkeypatch.setattr(health.time, "time_ns", delayed)
        monkeypatch.setattr(health.time, "monotonic_ns", lambda: monotonic() + lag_ns)

    return at


@pytest.mark.parametrize("number", [1, 3, 5])
def test_a_process_kept_waiting_tells_of_no_step_of_the_wall_clock(interrupted, number):
    """Of several readings of both clocks the one counts between which nothing came."""
    before_ns = health.realtime_minus_monotonic_ns()
    interrupted(number)
    assert abs(health.realtime_minus_monotonic_ns() - before_ns) < 2_000_000
