"""The six services by which a node's parameters are read and set (`ros2 param`), safe against whatever is asked.

rclpy's own end the thread that spins the node where a request holds what it does not expect. These answer everything
else the same way.
"""

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_parameters

from sense4hri.errors import Refused
from sense4hri.parameter_value import plain_value

MOST_NAMES = 1000
"""In one request."""
LONGEST_SHOWN = 80


class ParameterServices:
    """Serves the parameters of one node. refused(service name, sentence): told of every request that is refused."""

    def __init__(self, node: Node, refused: Callable[[str, str], None]) -> None:
        self._node, self._refused = node, refused
        self._serve(DescribeParameters, "describe_parameters", self._describe)
        self._serve(GetParameters, "get_parameters", self._get)
        self._serve(GetParameterTypes, "get_parameter_types", self._types)
        self._serve(ListParameters, "list_parameters", self._list)
        self._serve(SetParameters, "set_parameters", self._set)
        self._serve(SetParametersAtomically, "set_parameters_atomically", self._set_atomically)

    def _serve(self, kind: type, name: str, handler: Callable[[Any, Any], None]) -> None:
        full_name = f"{self._node.get_fully_qualified_name()}/{name}"

        def answer(request: Any, response: Any) -> Any:
            try:
                handler(request, response)
            except Refused as err:
                self._refused(full_name, str(err))
            return response

        self._node.create_service(kind, full_name, answer, qos_profile=qos_profile_parameters)

    def _describe(self, request: Any, response: Any) -> None:
        if self._has_all(request.names):
            response.descriptors = [self._node.describe_parameter(name) for name in request.names]

    def _get(self, request: Any, response: Any) -> None:
        if self._has_all(request.names):
            response.values = [self._node.get_parameter(name).get_parameter_value() for name in request.names]

    def _types(self, request: Any, response: Any) -> None:
        if self._has_all(request.names):
            response.types = [self._node.get_parameter_type(name) for name in request.names]

    def _list(self, request: Any, response: Any) -> None:
        _bounded(request.prefixes)
        response.result = self._node.list_parameters(request.prefixes, request.depth)

    def _set(self, request: Any, response: Any) -> None:
        """Each parameter has its own result, also where all of them are refused."""
        try:
            _bounded(request.parameters)
        except Refused as err:
            response.results = [SetParametersResult(reason=str(err)) for _ in request.parameters[:MOST_NAMES]]
            raise
        reasons: list[str] = []
        for message in request.parameters:
            response.results.append(self._set_together([message], reasons))
        if reasons:
            raise Refused(reasons[0])

    def _set_atomically(self, request: Any, response: Any) -> None:
        try:
            _bounded(request.parameters)
        except Refused as err:
            response.result = SetParametersResult(reason=str(err))
            raise
        reasons: list[str] = []
        response.result = self._set_together(request.parameters, reasons)
        if reasons:
            raise Refused(reasons[0])

    def _set_together(self, messages: Sequence[ParameterMessage], reasons: list[str]) -> SetParametersResult:
        """Set all of them or none; where what is asked makes no sense, add the reason to reasons."""
        try:
            return self._node.set_parameters_atomically([self._read(message) for message in messages])
        except Refused as err:
            reasons.append(str(err))
            return SetParametersResult(successful=False, reason=str(err))

    def _read(self, message: ParameterMessage) -> Parameter:
        """Return a parameter that this node has, with a value that can be one. Raises Refused."""
        name = message.name[:LONGEST_SHOWN]
        try:
            value = plain_value(message.value)
        except Refused as err:
            raise Refused(f"parameter {name!r} {err}") from err
        if not self._node.has_parameter(message.name):
            raise Refused(f"parameter {name!r} is none of this node's")
        if value is None:
            raise Refused(f"parameter {name!r} cannot be taken away")
        return Parameter.from_parameter_msg(message)

    def _has_all(self, names: Sequence[str]) -> bool:
        """Where a node lacks one of the names it answers for none, as rclpy does. Raises Refused."""
        _bounded(names)
        return all(self._node.has_parameter(name) for name in names)


def _bounded(entries: Sequence[object]) -> None:
    if len(entries) > MOST_NAMES:
        raise Refused(f"{len(entries)} parameters are asked for at once, at most {MOST_NAMES} can be")
