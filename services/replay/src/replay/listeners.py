"""Who listens to what is played: waited for before the first message, as what begins beside it takes its time."""

import asyncio
import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any

from rclpy.node import NodeNameNonExistentError
from sense4hri.errors import ConfigError
from sense4hri.service import Service

from replay.config import Config
from replay.outlet import Outlet

LOOK_S = 0.05


class Listeners:
    """Those of the outlets, whatever these are by then. stopped: says that waiting is in vain."""

    def __init__(
        self, service: Service[Any], config: Config, outlets: Mapping[str, Outlet], stopped: Callable[[], bool]
    ) -> None:
        self._node, self._log, self._config = service.node, service.log, config
        self._outlets, self._stopped = outlets, stopped

    async def come(self) -> None:
        """Wait until who listens has stopped changing; nobody at all is waited for until the timeout.

        Raises ConfigError where a node of `wait_for` is not there by then.
        """
        await self.unchanged(self._who)
        if self._stopped():
            return
        if missing := self._missing():
            waited_s = self._config.discovery_timeout_s
            raise ConfigError(f"parameter 'wait_for': after {waited_s:g} s there is no node {', no '.join(missing)}")
        if not any(self._matched()):
            self._log.warning("nobody listens to anything that is played")

    async def unchanged(self, look: Callable[[], Hashable]) -> None:
        """Wait until look() has returned the same, and something, for discovery_s; or the timeout."""
        begun = since = time.monotonic()
        seen = look()
        while not self._stopped() and time.monotonic() - begun < self._config.discovery_timeout_s:
            if seen is not None and time.monotonic() - since >= self._config.discovery_s:
                return
            await asyncio.sleep(LOOK_S)
            if (now := look()) != seen:
                seen, since = now, time.monotonic()

    def _who(self) -> Hashable:
        """All who listen, also to what those who listen here will say; None while somebody is missing."""
        counts = self._matched()
        if not any(counts) or self._missing():
            return None
        names = sorted(name for name, _ in self._node.get_topic_names_and_types())
        return (*counts, *((name, self._node.count_subscribers(name)) for name in names))

    def _matched(self) -> tuple[int, ...]:
        return tuple(outlet.subscribers() for outlet in self._outlets.values())

    def _missing(self) -> list[str]:
        """Nodes of `wait_for` that are not there yet, or subscribe to nothing yet."""
        return [name for name in self._config.wait_for if not self._subscribes(name)]

    def _subscribes(self, name: str) -> bool:
        namespace, _, own = name.strip("/").rpartition("/")
        try:
            return bool(self._node.get_subscriber_names_and_types_by_node(own, f"/{namespace}"))
        except NodeNameNonExistentError:
            return False
