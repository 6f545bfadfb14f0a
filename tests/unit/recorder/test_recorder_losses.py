"""Counting what never came."""

import pytest
from recorder import account as account_module
from recorder.account import DISK, MIDDLEWARE, QUEUE, Account, Hole
from recorder.accounts import Accounts
from recorder.losses import MOST_PUBLISHERS, Losses
from string_messages import string_channel

ONE, OTHER = b"1", b"2"


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
    for number in numbers:
        losses.take(ONE, number)
    assert (losses.lost, losses.missed) == (lost, missed)


def test_the_topics_that_lack_most_are_named():
    """Three of them, each with its exact count; of the others only the sum is left."""
    accounts = Accounts(0)
    assert accounts.lost_of == ""
    for topic, count in {"/a": 2, "/b": 300, "/whole": 0, "/c": 7, "/d": 1, "/e": 1}.items():
        accounts.lose(string_channel(topic), count, MIDDLEWARE)
    assert accounts.lost == 311
    assert accounts.lost_of == "300 of /b, 7 of /c, 2 of /a, the rest of 2 more"


def test_gaps_of_every_publisher_are_exact():
    """Each counts its own: the numbers of one say nothing of another's, and one that was out of sight goes on."""
    losses = Losses()
    sent = [(ONE, 1), (OTHER, 700), (ONE, 2), (OTHER, 701), (ONE, 5), (OTHER, 710), (ONE, 6)]
    found = [losses.take(*message) for message in sent]
    assert found == [(0, 0), (0, 699), (0, 0), (0, 0), (2, 0), (8, 0), (0, 0)]
    assert (losses.lost, losses.missed) == (10, 699)


def test_messages_without_a_number_are_not_counted():
    """The middleware says 0 where it has none."""
    losses = Losses()
    assert [losses.take(ONE, number) for number in (0, 3, 0, 5)] == [(0, 0), (0, 2), (0, 0), (1, 0)]


def test_publishers_without_end_cost_bounded_memory():
    """The one that is heard all the time is not forgotten for others that came and went."""
    losses = Losses()
    for k in range(1, 3 * MOST_PUBLISHERS):
        losses.take(ONE, 2 * k)
        losses.take(b"stranger %d" % k, 1)
    assert losses.lost == 3 * MOST_PUBLISHERS - 2
    assert len(losses._numbers) == MOST_PUBLISHERS


def test_the_history_of_a_latched_topic_is_not_missed():
    """A publisher that repeats its newest message to late subscribers had no reason to repeat those before."""
    losses = Losses()
    losses.replays = True
    losses.take(ONE, 7)
    assert (losses.lost, losses.missed) == (0, 0)


def test_every_hole_lies_between_its_messages():
    """With the log times around it, by cause; at an end it reaches to the recording's."""
    account = Account(5)
    account.lose(1, MIDDLEWARE)
    account.write(10)
    account.lose(2, MIDDLEWARE)
    account.lose(1, QUEUE)
    account.lose(3, QUEUE)
    for log_ns in (20, 30):
        account.write(log_ns)
    account.lose(4, DISK)
    assert account.holes(99) == [
        *(Hole(5, 10, 1, MIDDLEWARE), Hole(10, 20, 2, MIDDLEWARE), Hole(10, 20, 4, QUEUE)),
        Hole(30, 99, 4, DISK),
    ]
    assert (account.messages, account.lost) == (3, 11)


def test_with_too_many_holes_the_counts_stay_exact(monkeypatch):
    """Beyond the most that are kept the last one is widened; one of another cause is kept."""
    monkeypatch.setattr(account_module, "MOST_HOLES", 2)
    account = Account(0)
    for log_ns, cause in ((10, DISK), (20, DISK), (30, DISK), (40, DISK), (50, QUEUE)):
        account.lose(1, cause)
        account.write(log_ns)
    assert account.holes(99) == [Hole(0, 10, 1, DISK), Hole(10, 40, 3, DISK), Hole(40, 50, 1, QUEUE)]
    assert account.lost == 5
