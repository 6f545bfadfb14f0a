"""A token is not found by trying, and who has it comes in."""

import pytest
from sense4hri.access import Access
from sense4hri.guesses import MOST_SOURCES, MOST_WRONG, UNGUESSABLE, WITHIN_S, Guesses

SHORT, LONG = "o" * (UNGUESSABLE - 1), "v" * UNGUESSABLE
HERE, ELSEWHERE = "10.0.0.7", "10.0.0.8"


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def guesses(clock: Clock) -> Guesses:
    """Of a process with a short operate token and a long view token, after all the wrong ones that HERE may try."""
    made = Guesses(Access("0.0.0.0", SHORT, LONG), clock)
    assert [made.denied(HERE, [f"wrong{n}"]) for n in range(MOST_WRONG)] == [None] * MOST_WRONG
    return made


def test_one_more_is_not_looked_at(guesses: Guesses) -> None:
    """Whether a further token is right is not told: a right short one is refused like any other."""
    refused = guesses.denied(HERE, ["one more"])
    assert refused is not None
    assert refused.status == 429
    assert guesses.denied(HERE, [SHORT]) == guesses.denied(HERE, ["wrong0", SHORT]) == refused


def test_others_and_long_tokens_come_in_all_the_same(guesses: Guesses) -> None:
    """Another address is not kept waiting, nor is a right token that nobody finds by trying, nor a request without."""
    assert guesses.denied(ELSEWHERE, [SHORT]) is None
    assert guesses.denied(HERE, [LONG]) is guesses.denied(HERE, ["one more", LONG]) is None
    assert guesses.denied(HERE, []) is None
    assert guesses.denied(HERE, ["x" * UNGUESSABLE]) is not None


def test_an_old_cookie_is_one_guess(guesses: Guesses, clock: Clock) -> None:
    """However often it is sent; that it is wrong is told it as ever."""
    clock.now_s += WITHIN_S
    assert {guesses.denied(HERE, ["old"]) for _ in range(10 * MOST_WRONG)} == {None}
    assert guesses.denied(HERE, [SHORT]) is None


def test_the_wait_ends(guesses: Guesses, clock: Clock) -> None:
    """A refused try does not make it longer."""
    clock.now_s += WITHIN_S - 1
    assert guesses.denied(HERE, [SHORT]) is not None
    clock.now_s += 1
    assert guesses.denied(HERE, [SHORT]) is None


def test_a_network_of_ipv6_is_one_guesser(clock: Clock) -> None:
    """Whoever has one address of it has all; an IPv4 address is the same where it is written as IPv6."""
    made = Guesses(Access("::", SHORT), clock)
    tried = [made.denied(f"2001:db8::{n:x}", [f"wrong{n}"]) for n in range(MOST_WRONG + 1)]
    assert tried.count(None) == MOST_WRONG
    assert made.denied("2001:db8:0:1::1", [SHORT]) is None
    tried = [made.denied(("::ffff:" if n % 2 else "") + HERE, [f"wrong{n}"]) for n in range(MOST_WRONG + 1)]
    assert tried.count(None) == MOST_WRONG


def test_what_is_remembered_is_bounded(guesses: Guesses) -> None:
    """Of the newest addresses; the oldest is forgotten."""
    for n in range(MOST_SOURCES - 1):
        guesses.denied(f"host{n}", ["wrong"])
    assert guesses.denied(HERE, [SHORT]) is not None
    for n in range(MOST_SOURCES):
        guesses.denied(f"host{n}", ["wrong"])
    assert guesses.denied(HERE, [SHORT]) is None


def test_where_no_token_is_set_none_can_be_found(clock: Clock) -> None:
    """A program that sends one all the same is answered."""
    made = Guesses(Access(), clock)
    assert {made.denied(HERE, [f"wrong{n}"]) for n in range(2 * MOST_WRONG)} == {None}
