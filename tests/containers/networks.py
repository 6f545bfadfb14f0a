"""Two machines on two networks of one Docker Engine, and the router between them, which delays, loses and cuts.

Docker lets nothing from one of its networks to another one. A machine is a container whose network others share.
"""

import json
import os

from docker_study import docker
from slow_network import DEVICE, SlowNetwork


class Networks(SlowNetwork):
    """Each machine at .11 of a network of its own, the way to the others through the device of SlowNetwork."""

    def __init__(self, *machines: str) -> None:
        number = os.getpid() % 250
        self.container = {machine: f"sense4hri-{machine}-{os.getpid()}" for machine in machines}
        self._subnets = {machine: f"10.{213 + i}.{number}" for i, machine in enumerate(machines)}
        try:
            for machine, subnet in self._subnets.items():
                name = self.container[machine]
                docker("network", "create", "--subnet", f"{subnet}.0/24", name)
                placed = ("--network", name, "--ip", f"{subnet}.11", "--name", name)
                docker("run", "--detach", "--init", *placed, "sense4hri/base", "sleep", "infinity")
            super().__init__(*machines, address={machine: f"{net}.11" for machine, net in self._subnets.items()})
        except BaseException:
            self._remove()
            raise

    def close(self) -> None:
        super().close()
        self._remove()

    def _named(self, host: str, name: str) -> list[str]:
        state = json.loads(docker("inspect", self.container[host]))[0]["State"]
        return ["attach", name, str(state["Pid"])]

    def _settings(self, host: str) -> list[list[str]]:
        others = [subnet for machine, subnet in self._subnets.items() if machine != host]
        ways = [["route", "add", f"{net}.0/24", "dev", DEVICE, "src", self.address[host]] for net in others]
        return [["link", "set", DEVICE, "mtu", "1500", "up"], *ways]

    def _remove(self) -> None:
        for name in self.container.values():
            docker("rm", "--force", name, check=False)
            docker("network", "rm", name, check=False)
