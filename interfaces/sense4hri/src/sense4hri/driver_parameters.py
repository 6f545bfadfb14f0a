"""The parameters of a running driver: anyone may set human_id, all else the driver alone, as its device says it."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from sense4hri import parameters
from sense4hri.device import DriverConfig, Identity
from sense4hri.intake import LONGEST_NAME
from sense4hri.schema import check, find
from sense4hri.service import Service

HUMAN = find(DriverConfig, "human_id")


class OwnParameters:
    """Guards them from now on. moved(human_id): called on the main thread when somebody has set another one."""

    def __init__(self, service: Service[Any], moved: Callable[[str], None]) -> None:
        self._service, self._moved = service, moved
        self._own_change = False
        service.node.add_on_set_parameters_callback(self._on_set)

    @contextlib.contextmanager
    def changing(self) -> Iterator[None]:
        """For the length of the context parameters are set by the driver itself."""
        self._own_change = True
        try:
            yield
        finally:
            self._own_change = False

    def identify(self, identity: Identity, config: DriverConfig) -> None:
        """Tell what the device says of itself, where the study says nothing; of a long text what others read of it."""
        told = {name: value for name, value in identity._asdict().items() if value is not None}
        defaults = {field.name: field.default for field in dataclasses.fields(config)}
        known = {name: value for name, value in told.items() if getattr(config, name) == defaults[name]}
        for name, text in known.items():
            if len(text) > LONGEST_NAME:
                told_of = f"{config.sensor_id}: the device says a {name} of {len(text)} characters"
                self._service.log.warning(f"{told_of}: the first {LONGEST_NAME} are kept")
                known[name] = text[:LONGEST_NAME]
        with self.changing():
            self._service.node.set_parameters(parameters.as_parameters(known))

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        """Take or refuse a change. Runs on the ROS thread or our own."""
        for change in changes:
            if change.name != "human_id" and not self._own_change:
                return SetParametersResult(successful=False, reason=f"{change.name} cannot be set at run time")
            if change.name == "human_id":
                try:
                    check("human_id", HUMAN.kind, HUMAN.rule, change.value)
                except ValueError as err:
                    return SetParametersResult(successful=False, reason=str(err))
                self._service.post(self._moved, change.value)
        return SetParametersResult(successful=True)
