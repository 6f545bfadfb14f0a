"""Which nodes there were while recording, and with what parameters: asked of each once, then followed."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, field
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterEvent
from rclpy.qos import QoSProfile
from sense4hri.errors import Refused
from sense4hri.graph import ask_parameters
from sense4hri.parameter_value import plain_value
from sense4hri.service import Service

LOOK_S = 1.0
ASK_TIMEOUT_S, TRIES = 10.0, 2
EVENTS = QoSProfile(depth=1000)
MOST_NODES, LONGEST_PARAMETERS = 300, 1 << 15  # characters of JSON of one node; a driver has some thousand
LEFT_OUT = "!left_out"  # no parameter can be called so


@dataclass
class _Seen:
    """One node. seen_ns, gone_ns: on the host's clock; gone_ns is 0 while it is there."""

    name: str
    seen_ns: int
    gone_ns: int = 0
    parameters: dict[str, Any] = field(default_factory=dict)
    _characters: dict[str, int] = field(default_factory=dict)

    def keep(self, name: str, value: Any) -> None:
        """Take a parameter's value; what would be more than LONGEST_PARAMETERS together is left out, and said."""
        self.drop(name)
        value = _json(value)
        characters = len(json.dumps({name: value}))
        if sum(self._characters.values()) + characters > LONGEST_PARAMETERS:
            self.parameters[LEFT_OUT] = f"further parameters: at most {LONGEST_PARAMETERS} characters are kept"
            return
        self.parameters[name], self._characters[name] = value, characters

    def drop(self, name: str) -> None:
        """Forget a parameter."""
        self.parameters.pop(name, None)
        self._characters.pop(name, None)

    def as_json(self) -> dict[str, Any]:
        return {"node": self.name, "seen_ns": self.seen_ns, "parameters": dict(self.parameters)}


class Nodes:
    """Follows the graph. A node that tells no parameters is listed without them; at most MOST_NODES are."""

    def __init__(self, service: Service[Any]) -> None:
        self._service = service
        self._seen: dict[str, _Seen] = {}
        service.subscribe(ParameterEvent, "/parameter_events", self._changed, EVENTS)
        service.every(LOOK_S, self._look)

    def since(self, at_ns: int) -> list[dict[str, Any]]:
        """Every node that was there at this time or later, as in recorder.json; from any thread."""
        seen = [node for node in list(self._seen.values()) if not node.gone_ns or node.gone_ns >= at_ns]
        return [node.as_json() for node in sorted(seen, key=lambda node: node.name)]

    def _look(self) -> None:
        """Note which nodes have come, and which have gone, since the last look."""
        names = self._service.node.get_node_names_and_namespaces()
        present = {f"{space.rstrip('/')}/{name}" for name, space in names if not name.startswith("_")}
        now_ns = time.time_ns()
        for node in self._seen.values():
            if node.name not in present:
                node.gone_ns = node.gone_ns or now_ns
        for name in sorted(present):
            known = self._seen.get(name)
            if (known is None and self._is_room()) or (known is not None and known.gone_ns):
                node = self._seen[name] = _Seen(name, now_ns)
                self._service.start(self._ask(node))

    def _is_room(self) -> bool:
        """Make room for one more node; of those that are there none is forgotten."""
        gone = min((one for one in self._seen.values() if one.gone_ns), key=lambda one: one.gone_ns, default=None)
        if len(self._seen) >= MOST_NODES and gone is not None:
            del self._seen[gone.name]
        return len(self._seen) < MOST_NODES

    def _changed(self, event: ParameterEvent) -> None:
        node = self._seen.get(event.node)
        if node is not None:
            for parameter in [*event.new_parameters, *event.changed_parameters]:
                self._take(node, parameter)
            for parameter in event.deleted_parameters:
                node.drop(parameter.name)

    def _take(self, node: _Seen, parameter: Parameter) -> None:
        try:
            node.keep(parameter.name, plain_value(parameter.value))
        except Refused as err:
            why = f"{node.name}: its parameter {parameter.name!r} {err}"
            self._service.refuse("/parameter_events", "ParameterEvent", why)

    async def _ask(self, node: _Seen) -> None:
        for _ in range(TRIES):
            try:
                values = await ask_parameters(self._service, node.name, timeout_s=ASK_TIMEOUT_S)
            except TimeoutError:
                continue
            for name, value in values.items():
                node.keep(name, value)
            return


def _json(value: Any) -> Any:
    """Return the value as JSON can hold it: infinities and NaN become None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return [_json(entry) for entry in value] if isinstance(value, list) else value
