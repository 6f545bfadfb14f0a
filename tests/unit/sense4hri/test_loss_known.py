"""Whether a driver can know what is missing: where it cannot, health says -1 and never 0."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from sense4hri.chunk import Chunk
from sense4hri.device import Feature, Reported, Samples, Stream
from sense4hri.health import Link, State, health_message
from sense4hri.outlet import Outlet


def told(rate_hz, *items):
    """What health says of lost samples once these have been published; rate_hz: None where there is no raw."""
    stream = None if rate_hz is None else Stream(rate_hz, "uS", 0.0, 100.0, 16, ("eda",))
    outlet = Outlet(SimpleNamespace(metrics=MagicMock(), publisher=MagicMock()), "eda", "box_1", stream)
    outlet.open("p1")
    for item in items:
        (outlet.report if isinstance(item, Reported) else outlet.publish)(item)
    return health_message("box_1", State.STREAMING, outlet.nominal_hz, Link(), outlet.counts).lost_samples_total


def samples(device_ns, **given):
    return Samples("eda", Chunk(("eda",), np.zeros((1, 1)), device_ns, 10**18), **given)


@pytest.mark.parametrize(
    ("rate_hz", "items", "lost"),
    [
        (None, [Reported("eda", 10**18, None, (Feature("heart_rate", "1/min", (61.0,)),))], -1),
        (4.0, [], -1),
        (4.0, [samples(None)], -1),
        (0.0, [samples(10**9)], -1),
        (4.0, [samples(10**9)], 0),
        (4.0, [samples(10**9), samples(10**9 + 750_000_000)], 2),
        (4.0, [samples(None, lost=0), samples(None, lost=3)], 3),
        (0.0, [samples(10**9, lost=1)], 1),
        (4.0, [samples(2**63 - 1)], -1),
    ],
)
def test_a_loss_is_known_by_a_count_or_by_device_time_at_a_rate(rate_hz, items, lost):
    """Reports alone, no samples yet, no device time or no rate tell of no loss, unless the device counts."""
    assert told(rate_hz, *items) == lost
