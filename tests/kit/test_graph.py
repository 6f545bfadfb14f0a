"""Topics are followed as they come and go; nodes are asked for their parameters: a toy service as a real process."""

import json

import pytest
import rclpy
from ears import Ears
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def say_until(ears, toy, publishers, text):
    """Have all of them say it again and again until the toy has heard each of them."""

    def heard():
        for number, publisher in enumerate(publishers):
            publisher.publish(String(data=f"{text}{number}"))
        return all(f"heard {text}{number} on" in toy.log() for number in range(len(publishers)))

    ears.until(heard, lambda: f"{text} of all in:\n{toy.log()}")


def test_a_topic_is_heard_for_as_long_as_it_is_published(start, ears):
    """It is heard as it is offered, its end is told, and its next publisher is heard again."""
    toy = start("toy_service.py", follow="/toy/*")
    for times, text in enumerate(("once", "again"), 1):
        publisher = ears.node.create_publisher(String, "/toy/a", BEST_EFFORT)
        say_until(ears, toy, [publisher], text)
        ears.node.destroy_publisher(publisher)
        ears.until(lambda times=times: toy.log().count("gone: /toy/a") == times, toy.log)
    ears.until(lambda: ears.node.count_subscribers("/toy/a") == 0, "nobody listens any more")


def test_a_publisher_that_offers_less_is_heard_too(start, ears):
    """Beside a reliable publisher a best-effort one appears: the subscription is made again, for both."""
    toy = start("toy_service.py", follow="/toy/a")
    reliable = ears.node.create_publisher(String, "/toy/a", 10)
    say_until(ears, toy, [reliable], "first")
    assert "1 on /toy/a, RELIABLE" in toy.log()
    both = [reliable, ears.node.create_publisher(String, "/toy/a", BEST_EFFORT)]
    say_until(ears, toy, both, "then")
    assert "2 on /toy/a, BEST_EFFORT" in toy.log()


def test_what_was_latched_before_is_heard(start, ears):
    """A state that was published before anybody listened is heard once."""
    ears.node.create_publisher(String, "/toy/a", LATCHED).publish(String(data="kept"))
    toy = start("toy_service.py", follow="/toy/a")
    ears.until(lambda: "heard kept on /toy/a" in toy.log(), toy.log)


def test_another_type_of_the_same_name_is_not_heard(start, ears):
    """Of a topic that two nodes use for two types, only the one that is meant is followed."""
    from std_msgs.msg import Int32

    number = ears.node.create_publisher(Int32, "/toy/a", 10)
    toy = start("toy_service.py", follow="/toy/*")
    publisher = ears.node.create_publisher(String, "/toy/b", 10)
    say_until(ears, toy, [publisher], "b")
    assert number.get_subscription_count() == 0
    assert "/toy/a" not in toy.log()


VALUES = {"b": True, "i": -7, "d": 0.5, "s": "text", "bs": [True, False], "is": [1, 2], "ds": [0.5], "ss": ["x", ""]}


@pytest.mark.parametrize("names", [(), ("s", "nobody_has_this", "ds")])
def test_a_node_is_asked_for_its_parameters(start, opened, names):
    """Every kind of value comes as plain Python; a name the node lacks is left out and spoils no other."""
    node = opened(Ears("asked", parameters=VALUES))
    toy = start("toy_service.py", ask="/asked", **({"names": list(names)} if names else {}))
    node.until(lambda: "told {" in toy.log(), toy.log)
    told = json.loads(toy.log().partition("told ")[2].partition("\n")[0])
    assert {name: told[name] for name in VALUES if name in told} == {
        name: value for name, value in VALUES.items() if not names or name in names
    }
    assert "nobody_has_this" not in told


def test_a_node_that_is_not_there_is_asked_for_a_bounded_time(start):
    """Who is not on the graph tells nothing: the question ends with an error that names it."""
    toy = start("toy_service.py", ask="/nobody")
    assert toy.wait() == 1
    assert "TimeoutError: /nobody/list_parameters is not served" in toy.log()


class Liar(Ears):
    """A node whose parameter services answer what a test wants."""

    def __init__(self, *values: ParameterValue) -> None:
        super().__init__()
        self.values = values
        self.liar = rclpy.create_node("liar", context=self.context, start_parameter_services=False)
        self.liar.create_service(GetParameters, "liar/get_parameters", self._get)
        self.liar.create_service(ListParameters, "liar/list_parameters", self._list)
        self._executor.add_node(self.liar)

    def _list(self, request, response):
        response.result.names = [f"p{number}" for number in range(len(self.values))]
        return response

    def _get(self, request, response):
        if len(request.names) == len(self.values):
            response.values = list(self.values)
        return response

    def close(self) -> None:
        self._executor.remove_node(self.liar)
        self.liar.destroy_node()
        super().close()


GOOD = ParameterValue(type=2, integer_value=5)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (ParameterValue(type=77), "its parameter 'p1' is of type 77, which does not exist"),
        (ParameterValue(type=4, string_value="x" * 100_000), "its parameter 'p1' is longer than"),
        (ParameterValue(type=7, integer_array_value=[1] * 20_000), "its parameter 'p1' is longer than"),
        (ParameterValue(type=9, string_array_value=["x" * 100_000]), "its parameter 'p1' is longer than"),
    ],
)
def test_a_parameter_that_cannot_be_is_left_out_and_its_node_named(start, opened, bad, why):
    """The others of the same answer are told; the one is refused with a sentence."""
    node = opened(Liar(GOOD, bad))
    toy = start("toy_service.py", ask="/liar")
    node.until(lambda: "told {" in toy.log(), toy.log)
    assert 'told {"p0": 5}' in toy.log()
    assert f"/liar/get_parameters: refused: {why}" in toy.log()


def test_a_node_with_too_many_parameters_is_asked_for_some(start, opened):
    """Thousands of names are no reason to ask for ever: the first thousand are asked for."""
    node = opened(Liar(*[GOOD] * 5000))
    toy = start("toy_service.py", ask="/liar")
    node.until(lambda: "told {" in toy.log() or toy.child.poll() is not None, toy.log)
    assert "/liar/get_parameters: refused: it has 5000 parameters, 1000 of them are looked at" in toy.log()


def test_a_node_whose_name_rclpy_would_not_take_is_not_asked(start):
    """Another DDS program may call its node anything: it is a node that does not answer."""
    toy = start("toy_service.py", ask="/no name")
    assert toy.wait() == 1
    assert "TimeoutError: /no name/list_parameters is no name of a ROS service" in toy.log()
