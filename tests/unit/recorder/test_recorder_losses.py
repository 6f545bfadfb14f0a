"""Counting what never came."""

import pytest
from recorder import account as account_module
from recorder.account import DISK, MIDDLEWARE, QUEUE, Account, Hole
from recorder.accounts import Accounts
from recorder.losses import Losses
from string_messages import string_channel

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
    losses = Losses(lambda: True)
    losses.follow(ONE)
    for number in numbers:
        losses.take(number)
    assert (losses.lost, losses.missed) == (lost, missed)


def test_the_topics_that_lack_most_are_named():
    """Three of them, each with its exact count; of the others only the sum is left."""
    accounts = Accounts(0)
    assert accounts.lost_of == ""
    for topic, count in {"/a": 2, "/b": 300, "/whole": 0, "/c": 7, "/d": 1, "/e": 1}.items():
        accounts.lose(string_channel(topic), count, MIDDLEWARE)
    assert accounts.lost == 311
    assert accounts.lost_of == "300 of /b, 7 of /c, 2 of /a, the rest of 2 more"


def test_several_publishers_are_not_counted():
    """Numbers that may belong to either of two publishers say nothing, nor does the first after one has gone."""
    losses = Losses(lambda: True)
    losses.follow(ONE | OTHER)
    for number in (1, 700, 2, 701):
        losses.take(number)
    losses.follow(ONE)
    for number in (900, 901, 903):
        losses.take(number)
    assert (losses.lost, losses.missed) == (1, 0)


def test_a_second_publisher_is_believed_before_the_graph_shows_it():
    """Its numbers are no gap in those of the first; once it is gone the first one's next gap counts again."""
    connected = 1
    losses = Losses(lambda: connected == 1)
    losses.follow(ONE)
    losses.take(1)
    connected = 2
    for number in (2, 5, 3, 6, 4, 9):
        losses.take(number)
    assert (losses.lost, losses.missed) == (0, 0)
    connected = 1
    for number in (10, 12):
        losses.take(number)
    assert losses.lost == 1


@pytest.mark.parametrize(("after", "told"), [(OTHER, (0, 500)), (ONE, (497, 0))])
def test_a_publisher_that_takes_the_place_of_another_counts_anew(after, told):
    """A driver started again had 500 messages before it was known; one out of sight has lost what it skips."""
    losses = Losses(lambda: True)
    losses.follow(ONE)
    for number in (1, 2, 3):
        losses.take(number)
    losses.follow(frozenset())
    losses.follow(after)
    assert losses.take(501) == told


def test_the_history_of_a_latched_topic_is_not_missed():
    """A publisher that repeats its newest message to late subscribers had no reason to repeat those before."""
    losses = Losses(lambda: True)
    losses.replays = True
    losses.follow(ONE)
    losses.take(7)
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
