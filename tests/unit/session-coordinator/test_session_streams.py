"""Whether a required stream is there."""

from types import SimpleNamespace

import pytest
from sense4hri_msgs.msg import StreamHealth
from session_coordinator.streams import StreamWatch, _Heard


@pytest.mark.parametrize(
    ("rate_hz", "silent_s", "trouble"),
    [
        (130.0, 2.9, ""),
        (130.0, 3.1, "stale, silent for more than 3 s"),
        (0.2, 14.9, ""),
        (0.2, 15.1, "stale, silent for more than 15 s"),
        (0.0, 3.1, "stale, silent for more than 3 s"),
    ],
)
def test_a_stream_is_stale_after_stale_s_or_three_of_its_samples(rate_hz: float, silent_s: float, trouble: str) -> None:
    """What comes every five seconds is not stale between its samples."""
    watch = StreamWatch(SimpleNamespace(config=SimpleNamespace(stale_s=3.0)), lambda: 0.0)
    health = StreamHealth(nominal_rate_hz=rate_hz, measured_rate_hz=rate_hz)
    assert watch._trouble(_Heard(0.0, last_s=100.0, health=health), 100.0 + silent_s) == trouble
