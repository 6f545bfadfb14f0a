"""A study of two participants on two machines in containers, on two networks: lab-b has the radio and what is worn.

What `make up HOST=... TLS=...` gives Compose is used as it is, but for two words: what it puts on its machine's network
is put on that of a container that stands for the machine, and lab-b's wall clock can be set.
"""

from __future__ import annotations

import json
import urllib.parse
from pathlib import Path
from typing import Any

import asked
import host_override
import pytest
import study_file
from docker_study import ROOT, Study, docker, on_clock, watched
from monitoring import about
from networks import Networks
from several_hosts import host_of

DESK, RADIO = "lab-a", "lab-b"
STUDY = Path(__file__).with_name("two_networks.yaml")
ADDRESSES = {DESK: "LAB_A", RADIO: "LAB_B"}
"""Variables of the study file."""
LISTENS = "0A"


class Laboratory:
    """Both machines, what each runs of the study, and the clock of lab-b.

    patch: for what the study file and compose/tls.yaml are told.
    """

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.network = Networks(DESK, RADIO)
        patch.setenv("TLS_NAME", self.network.address[DESK])
        for host, variable in ADDRESSES.items():
            patch.setenv(variable, self.network.address[host])
        self.parts: dict[str, Study] = {}
        try:
            self.study = study_file.read(STUDY)
            there = [service.name for service in self.study.services if host_of(self.study, service) in (RADIO, "")]
            self.clock, clock = on_clock(folder / "wall_clock", there)
            self._up(DESK, ROOT / "compose" / "tls.yaml")
            self._up(RADIO, clock)
        except BaseException:
            self.close()
            raise

    def _up(self, host: str, overlay: Path) -> None:
        changed = host_override.write(self.study, host, self.folder, tls=host == DESK)
        whose = f'network_mode: "container:{self.network.container[host]}"'
        changed.write_text(changed.read_text().replace('network_mode: "host"', whose))
        self.parts[host] = Study(str(self.study.file), overlay, changed, machine=host)
        self.parts[host].up()

    def close(self) -> None:
        for part in self.parts.values():
            part.remove()
        self.network.close()

    @property
    def page(self) -> str:
        """Address of the page, as a browser of either network reaches it."""
        return f"https://{self.network.address[DESK]}:8443"

    def query(self, expression: str) -> list[dict[str, Any]]:
        """What Prometheus answers on the loopback of its machine."""
        address = "http://127.0.0.1:9090/api/v1/query?" + urllib.parse.urlencode({"query": expression})
        _, answer = self.network.within(DESK, lambda: watched(address, self.parts[DESK].tokens["view"]))
        found: list[dict[str, Any]] = json.loads(answer)["data"]["result"]
        return found

    def shown(self, metric: str, **labels: str) -> list[float]:
        """What the dashboards' first curve or column of a metric shows, of what has these labels."""
        query = next(each for each in asked.of_panels("h10_1", "ecg") if metric in each)
        return [float(one["value"][1]) for one in self.query(query) if labels.items() <= one["metric"].items()]

    def firing(self, alert: str, **labels: str) -> bool:
        """True while an alert fires, about what has these labels."""
        about = ", ".join(f'{name}="{value}"' for name, value in labels.items())
        return bool(self.query(f'ALERTS{{alertstate="firing", alertname="{alert}", {about}}}'))

    def alerts(self) -> list[str]:
        """Return what fires, each with what it is about."""
        found = [one["metric"] for one in self.query('ALERTS{alertstate="firing"}')]
        return sorted(f"{one['alertname']} {about(one) or one.get('field', '')}" for one in found)

    def open_ports(self, host: str) -> set[int]:
        """Return the TCP ports of a machine that somebody elsewhere can reach."""
        tables = [Path("/proc/thread-self/net") / name for name in ("tcp", "tcp6")]
        rows = self.network.within(host, lambda: [line.split() for file in tables for line in _rows(file)])
        ends = [row[1].split(":") for row in rows if row[3] == LISTENS]
        return {int(port, 16) for address, port in ends if not _is_loopback(address)}

    def nodes(self, host: str) -> list[str]:
        """Return the addresses at which the nodes of a machine answer HTTP."""
        return [f"http://{each}" for each in host_override.targets(self.study)[host]]

    def container(self, service: str) -> str:
        """The container of one of lab-b's services."""
        return self.parts[RADIO].container(service)

    def kill(self, service: str) -> None:
        """SIGKILL a service of lab-b; it stays away until `begin`."""
        docker("kill", self.container(service))

    def begin(self, service: str) -> None:
        docker("start", self.container(service))


def _rows(file: Path) -> list[str]:
    return file.read_text().splitlines()[1:] if file.exists() else []


def _is_loopback(address: str) -> bool:
    """Of /proc/net/tcp: of a word in the order of bytes of this machine."""
    return address.endswith("7F") or address == "0" * 24 + "01000000"
