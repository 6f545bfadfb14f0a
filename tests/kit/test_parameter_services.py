"""The kit's own parameter services: they answer as rclpy's do, and no request ends them."""

import pytest
import rclpy
from ears import Ears
from processes import poll
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from sense4hri.parameter_services import MOST_NAMES, ParameterServices

VALUES = {"b": True, "i": -7, "d": 0.5, "s": "text", "bs": [True, False], "is": [1, 2], "ds": [0.5], "ss": ["x", ""]}
TEXT = ParameterValue(type=4, string_value="new")
ALL = DescribeParameters, GetParameters, GetParameterTypes, ListParameters, SetParameters, SetParametersAtomically
NAMES = dict(
    zip(
        ALL,
        ("describe_parameters", "get_parameters", "get_parameter_types", "list_parameters", "set_parameters",
         "set_parameters_atomically"),
        strict=True,
    )
)  # fmt: skip


class Kept(Ears):
    """A node with the kit's parameter services; what they refuse is written down."""

    def __init__(self, beside: Ears) -> None:
        super().__init__("client", beside=beside)
        self.refused: list[str] = []
        self.own = rclpy.create_node("own", context=self.context, start_parameter_services=False)
        ParameterServices(self.own, lambda place, why: self.refused.append(f"{place}: {why}"))
        for name, value in VALUES.items():
            self.own.declare_parameter(name, value)
        self._executor.add_node(self.own)

    def close(self) -> None:
        self._executor.remove_node(self.own)
        self.own.destroy_node()
        super().close()


@pytest.fixture
def both(opened):
    """A node with rclpy's services and one with the kit's, of the same parameters."""
    return opened(Kept(beside=opened(Ears("rclpys", VALUES))))


def parameters(*values):
    return {"parameters": [Parameter(name=name, value=value) for name, value in values]}


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        *((kind, {"names": names}) for kind in ALL[:3] for names in ([], [*VALUES], ["i"], ["i", "nobody_has_this"])),
        *((ListParameters, {"prefixes": prefixes, "depth": 0}) for prefixes in ([], ["s"], ["nobody"])),
        (SetParameters, parameters(("s", TEXT))),
        (SetParameters, parameters(("i", TEXT), ("s", TEXT))),
        (SetParametersAtomically, parameters(("s", TEXT), ("is", ParameterValue(type=7, integer_array_value=[9])))),
    ],
)
def test_they_answer_as_those_of_rclpy(both, kind, fields):
    """`ros2 param`, launch and every client get the same answers, message for message."""
    answers = [both.ask(kind, f"/{node}/{NAMES[kind]}", kind.Request(**fields)) for node in ("rclpys", "own")]
    assert answers[0] == answers[1]
    assert both.refused == []


NONSENSE = [
    (("s", ParameterValue(type=77)), "parameter 's' is of type 77, which does not exist"),
    (("s", ParameterValue(type=255)), "parameter 's' is of type 255, which does not exist"),
    (("s", ParameterValue(type=4, string_value="x" * 65537)), "parameter 's' is longer than 10000 entries"),
    (("nobody_has_this", TEXT), "parameter 'nobody_has_this' is none of this node's"),
    (("s", ParameterValue()), "parameter 's' cannot be taken away"),
    (("\x00\x15" * 1000, TEXT), "is none of this node's"),
]


@pytest.mark.parametrize(("asked", "why"), NONSENSE, ids=[why for _, why in NONSENSE])
def test_what_makes_no_sense_is_refused_with_a_sentence(both, asked, why):
    """Each is one unsuccessful result, is told of, and changes nothing; what stands beside it is set."""
    good = ("d", ParameterValue(type=3, double_value=0.75, byte_array_value=[b"\xff"], bool_array_value=[True]))
    both.ask(SetParametersAtomically, "/own/set_parameters_atomically",
             SetParametersAtomically.Request(**parameters(good, asked)))  # fmt: skip
    assert both.own.get_parameter("d").value == 0.5
    answer = both.ask(SetParameters, "/own/set_parameters", SetParameters.Request(**parameters(asked, good)))
    assert [result.successful for result in answer.results] == [False, True]
    assert why in answer.results[0].reason
    assert len(both.refused) == 2
    assert all(line.startswith("/own/set_parameters") and why in line for line in both.refused)
    assert {name: both.own.get_parameter(name).value for name in VALUES} == VALUES | {"d": 0.75}


@pytest.mark.parametrize("kind", ALL)
def test_thousands_at_once_are_refused(both, kind):
    """A request for more than anybody has is answered at once, with nothing; the next one is served."""
    many = MOST_NAMES + 1
    field = "prefixes" if kind is ListParameters else "names" if kind in ALL[:3] else "parameters"
    item = Parameter(name="s", value=TEXT) if field == "parameters" else "s"
    both.ask(kind, f"/own/{NAMES[kind]}", kind.Request(**{field: [item] * many}))
    assert both.refused == [f"/own/{NAMES[kind]}: {many} parameters are asked for at once, at most {MOST_NAMES} can be"]
    values = both.ask(GetParameters, "/own/get_parameters", GetParameters.Request(names=["s"])).values
    assert [value.string_value for value in values] == ["text"]


def test_a_service_outlives_a_request_of_a_type_that_does_not_exist(start, ears):
    """The request that ended the ROS thread of every service is refused, counted and said; the next one is served."""
    toy = start("toy_service.py", follow="/x")
    for kind in (77, 255):
        nonsense = parameters(("follow", ParameterValue(type=kind)))
        answer = ears.ask(SetParameters, "/toy_service/set_parameters", SetParameters.Request(**nonsense))
        assert not answer.results[0].successful
    values = ears.ask(GetParameters, "/toy_service/get_parameters", GetParameters.Request(names=["follow"])).values
    assert values[0].string_value == "/x"
    toy.until("/toy_service/set_parameters: refused: parameter 'follow' is of type 77")
    counted = 'sense4hri_refused_messages_total{field="parameters",service="toy_service"} 2.0'
    poll(lambda: counted in toy.get("/metrics")[1], "both are counted")
