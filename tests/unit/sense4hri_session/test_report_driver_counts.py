"""What the report takes from the counts in a driver's health."""

import pytest
from sense4hri_msgs.msg import StreamHealth
from sense4hri_report.bins import Axis
from sense4hri_report.watch import HealthWatch


@pytest.mark.parametrize(
    ("told", "lost"),
    [
        ([(0, 0), (10, 0), (20, 0)], 0),
        ([(0, -1), (10, -1)], None),
        ([(0, 0), (10, -1)], None),
        ([(0, -1), (10, 0), (20, 3)], 3),
        ([(10, 5), (20, -1), (30, 6)], 1),
        ([(10, 5), (20, 7), (5, -1), (9, 4)], 6),
        ([], None),
    ],
)
def test_what_the_driver_no_longer_knows_is_not_known(told, lost):
    """(samples_total, lost_samples_total) of each account: -1 last is not known, in between it is no loss."""
    watch = HealthWatch(Axis(0, 10**10))
    for samples, missing in told:
        watch.take(StreamHealth(samples_total=samples, lost_samples_total=missing), 0)
    assert watch.counted("lost_samples_total") == lost
