"""Two nodes of one name: told of by each of them, and not of one that was killed and started anew."""

from sense4hri.namesakes import LOOK_S, TOLD_AFTER_S, Namesakes

OWN, OTHER = ("recorder", "/"), ("clock_sync", "/")


def told(looks):
    """What is told at each of these looks at the graph, LOOK_S apart."""
    namesakes = Namesakes(*OWN)
    return [namesakes.look(names, number * LOOK_S) for number, names in enumerate(looks)]


def test_two_nodes_of_one_name_are_told_once_and_again_when_they_come_again():
    """Longer than DDS remembers a process that was killed, which is no other node."""
    longer = round(TOLD_AFTER_S / LOOK_S) + 1
    says = told([[OWN, OTHER], *[[OWN, OTHER, OWN]] * (longer + 5), [OWN], *[[OWN, OWN]] * longer])
    assert [bool(text) for text in says] == [*[False] * longer, True, *[False] * 6, *[False] * (longer - 1), True]
    assert "another node is called /recorder" in says[longer]


def test_a_node_that_was_killed_and_is_back_and_one_of_another_namespace_are_none():
    """Of the killed one the graph shows 20 s more."""
    assert not any(told([[OWN, OWN]] * round(25 / LOOK_S) + [[OWN]] * 10))
    assert not any(told([[OWN, ("recorder", "/lab_b")]] * 20))
