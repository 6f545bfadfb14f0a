"""Globs over topic names: what they cover, and that none of them can hang anybody."""

import random
import re

import pytest
from sense4hri.patterns import LONGEST, MOST, Patterns, _covers, checked

HOSTILE = "/*/" + "*" * 200 + "X/**"
TOPIC = "/humans/physiological/p1/ecg/h10_1/raw"


def naive(glob: str, topic: str) -> bool:
    """The same, as a regular expression says it: right, and on some globs never done."""
    parts = glob.strip("/").split("/")
    within = (re.escape(part).replace(r"\*", "[^/]*").replace(r"\?", "[^/]") for part in parts)
    said = ("(/[^/]*)*" if part == "**" else "/" + text for part, text in zip(parts, within, strict=True))
    return re.fullmatch("".join(said), topic) is not None


def test_a_glob_covers_what_a_regular_expression_says() -> None:
    """20 000 random globs and topics: the same answer as the naive reading, with both answers often enough."""
    dice = random.Random(1)
    covered = 0
    for _ in range(20_000):
        glob = "".join("/" + "".join(dice.choices("a*?", k=dice.randint(0, 3))) for _ in range(dice.randint(1, 4)))
        topic = "".join("/" + "".join(dice.choices("ab", k=dice.randint(0, 2))) for _ in range(dice.randint(0, 4)))
        expected = naive(glob, topic)
        covered += expected
        assert Patterns([glob]).match(topic) is expected, (glob, topic)
    assert covered > 1000


@pytest.mark.parametrize(
    "glob",
    [
        HOSTILE,
        "/" + "*a" * 100 + "X",
        "/" + "*?" * 100 + "X",
        "/**" * 80 + "/X",
        "/**/*a*" * 30 + "/X",
        "/**/?" * 50 + "/X",
    ],
)
def test_no_glob_hangs(glob: str) -> None:
    """The worst globs are done with the longest names, long before this test's time is up."""
    for topic in (TOPIC, "/" + "a" * 5000, "/a" * 300, "/aaaaaaaa" * 30):
        assert not Patterns([glob]).match(topic)


def test_no_glob_is_looked_at_more_often_than_parts_by_parts() -> None:
    """Each part of a glob is held against each part of a name at most once, however many `**` there are."""
    looks = 0

    def look(part: str) -> bool:
        nonlocal looks
        looks += 1
        return part == "a"

    glob = (None, look) * 40 + (lambda part: False,)
    assert not _covers(glob, ["a"] * 80)
    assert looks <= 81 * 80


def test_repeated_stars_are_one() -> None:
    """`**` beside `**` is one `**`, and within a part it is `*`."""
    assert Patterns(["/**/**/raw"]).match(TOPIC)
    assert Patterns(["/**/h**1/raw"]).match(TOPIC)
    assert not Patterns(["/**/**/raw"]).match(TOPIC + "/x")


def test_globs_are_bounded_where_they_come_in() -> None:
    """Too many, or one too long, are refused in a sentence that names them."""
    assert checked(["/a"] * MOST, "patterns") == ("/a",) * MOST
    assert checked(["/" + "a" * (LONGEST - 1)], "patterns")
    with pytest.raises(ValueError, match=f"patterns: {MOST + 1} globs, at most {MOST}"):
        checked(["/a"] * (MOST + 1), "patterns")
    with pytest.raises(ValueError, match=f"patterns: a glob of {LONGEST + 1} characters"):
        checked(["/" + "*" * LONGEST], "patterns")
