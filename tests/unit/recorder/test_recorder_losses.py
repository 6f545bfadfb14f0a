"""Counting what never came."""

import pytest
from recorder.losses import Losses

ONE, OTHER = frozenset([b"1"]), frozenset([b"2"])


@pytest.mark.parametrize(
    ("numbers", "lost", "missed"),
    [
        ([1, 2, 3], 0, 0),
        ([1, 2, 5, 6, 8], 3, 0),
        ([4, 5, 6], 0, 3),
        ([1, 2, 3, 1, 2], 0, 0),
        ([1, 2, 3, 3, 4], 0, 2),
        ([10, 11, 2, 3, 5], 1, 10),
    ],
)
def test_gaps_of_one_publisher_are_exact(numbers, lost, missed):
    """A gap is lost, what precedes a publisher's first message was missed, a lower number is a new publisher."""
    losses = Losses()
    losses.follow(ONE)
    for number in numbers:
        losses.take(number)
    assert (losses.lost, losses.missed) == (lost, missed)


def test_several_publishers_are_not_counted():
    """Numbers that may belong to either of two publishers say nothing, nor does the first after one has gone."""
    losses = Losses()
    losses.follow(ONE | OTHER)
    for number in (1, 700, 2, 701):
        losses.take(number)
    losses.follow(ONE)
    for number in (900, 901, 903):
        losses.take(number)
    assert (losses.lost, losses.missed) == (1, 0)


def test_the_history_of_a_latched_topic_is_not_missed():
    """A publisher that repeats its newest message to late subscribers had no reason to repeat those before."""
    losses = Losses()
    losses.replays = True
    losses.follow(ONE)
    losses.take(7)
    assert (losses.lost, losses.missed) == (0, 0)
