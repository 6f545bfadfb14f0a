"""A pseudonym in names that others have too."""

from sense4hri.pseudonym import Pseudonym

CROWD = [f"q{number}" for number in range(20_000)]


def test_of_the_others_only_those_that_hold_the_pseudonym_are_looked_for() -> None:
    """Of twenty thousand the one whose name has it as a part: a text is not compared with all of them."""
    name = Pseudonym("p1", [*CROWD, "p1_b"])
    assert not name.half_mentions("visit of p1_b and q7")
    assert name.half_mentions("visit of p1_c and q7")
    assert name._others is not None
    assert name._others.pattern.count("|") == 0
    assert Pseudonym("p1", CROWD)._others is None
