"""Offset, skew and uncertainty of every device clock on the graph, and of every other host's clock."""

import asyncio
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from sense4hri import stamps
from sense4hri.host_clocks import sanitised, this_host
from sense4hri.recorder_status import RecorderStatus
from sense4hri.run import run
from sense4hri.service import Service

from clock_sync.config import Config
from clock_sync.hosts import Answers, Reference, node_name
from clock_sync.sync import ClockSync

NOW_NS = 30 * stamps.SECOND_NS


class Role:
    """Which host this is, and which is the reference: the parameter's, else the recorder's, else this one.

    recorder: host of the recorder, empty until one is heard. A node's name follows from the role: where the role turns
    out to be another one, `serve` ends and `main` begins anew.
    """

    def __init__(self) -> None:
        self.recorder = ""
        self._changed, self._stopped = asyncio.Event(), asyncio.Event()

    @property
    def begins_anew(self) -> bool:
        """True where it has turned out to be another one, and nobody has told the process to stop meanwhile."""
        return self._changed.is_set() and not self._stopped.is_set()

    def host(self, config: Config) -> str:
        """Return this host's name."""
        return sanitised(config.host or this_host())

    def reference(self, config: Config) -> str:
        """Return the reference host's name."""
        return sanitised(config.reference_host) if config.reference_host else self.recorder or self.host(config)

    def node_name(self, config: Config) -> str:
        """Return the name of the node in this role."""
        return node_name(self.host(config), self.reference(config))

    async def serve(self, service: Service[Config]) -> None:
        """Keep the models until the service is told to stop, or has another role."""
        self._changed, self._stopped = asyncio.Event(), service.stopped
        host, reference = self.host(service.config), self.reference(service.config)

        def hear(message: DiagnosticArray) -> None:
            for status in message.status if _is_of_now(message) else ():
                told = RecorderStatus.parse(status)
                if told is not None and told.host and not self.recorder:
                    self._follow(service, sanitised(told.host), reference)
                    service.unsubscribe(subscription)

        if not service.config.reference_host and not self.recorder:
            subscription = service.hear_diagnostics(hear)
        if host == reference:
            ClockSync(service, Reference(service, host))
        else:
            Answers(service, host).show()
            service.log.info(f"answers for host {host}; the reference is {reference}")
        service.ready()
        ends = [asyncio.ensure_future(each.wait()) for each in (self._changed, self._stopped)]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        for each in ends:
            each.cancel()

    def _follow(self, service: Service[Config], recorder: str, reference: str) -> None:
        """Take the host of the recorder that is heard first for the reference."""
        self.recorder = recorder
        if recorder != reference:
            service.log.info(f"the recorder runs on host {recorder}, which is the reference therefore")
            self._changed.set()


def _is_of_now(message: DiagnosticArray) -> bool:
    """False for what a replay plays: another machine's recorder, long ago."""
    return abs(time.time_ns() - stamps.to_ns(message.header.stamp)) < NOW_NS


def main() -> int:
    """Run until stopped; return the exit status."""
    role = Role()
    while True:
        status = run("clock_sync", Config, role.serve, node_name=role.node_name)
        if status or not role.begins_anew:
            return status


if __name__ == "__main__":
    sys.exit(main())
