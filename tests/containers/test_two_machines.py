"""A study on two machines in containers: each machine a network namespace with an address of its own, one Engine.

What `make up HOST=... TLS=...` gives Compose is used as it is, but for one word: what it puts on its machine's network
is put on that of a container that stands for the machine.
"""

from __future__ import annotations

import json
import os
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import asked
import host_override
import pytest
import study_file
import tls_checks
from docker_study import ROOT, Study, docker, get
from monitoring import known
from processes import poll, wait_for

pytestmark = pytest.mark.timeout(600)
HEALTHY_S = 180
NETWORK = f"10.213.{os.getpid() % 250}"
STUDY = """
name: two-machines
x-study:
  name: two-machines
  hosts: {addresses}
x-ours: &radio
  volumes: [radio:/run/dbus]
  x-host: lab-b
services:
  h10-1:
    <<: *radio
    extends: {{file: {compose}, service: driver-polar}}
    command: >
      python -m driver_polar --ros-args -p sensor_id:=h10_1 -p human_id:=p1 -p model:=H10
      -p "name:=Polar H10 1A2B3C01" -p "streams:=[ecg]"
  sensor-bench:
    <<: *radio
    extends: {{file: {compose}, service: sensor-bench}}
  interpreter-ecg: {{extends: {{file: {compose}, service: interpreter-ecg}}}}
  clock-sync: {{extends: {{file: {compose}, service: clock-sync}}}}
  recorder: {{extends: {{file: {compose}, service: recorder}}}}
  web-gui: {{extends: {{file: {compose}, service: web-gui}}}}
  prometheus: {{extends: {{file: {compose}, service: prometheus}}}}
volumes:
  recordings:
  prometheus:
  radio:
    driver_opts: {{type: tmpfs, device: tmpfs, o: "uid=10001,mode=755,size=1m"}}
"""


class Laboratory:
    """Two machines, lab-a with all but the radio and what is worn, and what each runs of the study."""

    def __init__(self, folder: Path) -> None:
        self._name = f"sense4hri-machines-{os.getpid()}"
        self.addresses = {
            host: f"10.213.{os.getpid() % 250}.{number}" for host, number in (("lab-a", 11), ("lab-b", 12))
        }
        docker("network", "create", "--subnet", f"10.213.{os.getpid() % 250}.0/24", self._name)
        self.parts: dict[str, Study] = {}
        try:
            for host, address in self.addresses.items():
                placed = ("--network", self._name, "--ip", address, "--name", f"{self._name}-{host}")
                docker("run", "--detach", "--init", *placed, "sense4hri/base", "sleep", "infinity")
            file = folder / "two-machines.yaml"
            given = json.dumps(self.addresses)
            file.write_text(STUDY.format(addresses=given, compose=ROOT / "compose" / "compose.yaml"))
            self.study = study_file.read(file)
            for host in self.addresses:
                self._up(file, host, folder)
        except BaseException:
            self.remove()
            raise

    def _up(self, file: Path, host: str, folder: Path) -> None:
        page = host == "lab-a"
        changed = host_override.write(self.study, host, folder, tls=page)
        text = changed.read_text()
        changed.write_text(text.replace('network_mode: "host"', f'network_mode: "container:{self._name}-{host}"'))
        overlays = [ROOT / "compose" / "tls.yaml"] if page else []
        self.parts[host] = Study(str(file), *overlays, changed, machine=host)
        self.parts[host].up()

    def remove(self) -> None:
        for part in self.parts.values():
            part.remove()
        for host in self.addresses:
            docker("rm", "--force", f"{self._name}-{host}", check=False)
        docker("network", "rm", self._name, check=False)

    def scraped(self, expression: str) -> list[dict[str, Any]]:
        """What Prometheus answers on the loopback of its machine."""
        asked = "http://127.0.0.1:9090/api/v1/query?" + urllib.parse.urlencode({"query": expression})
        script = (
            "import sys, urllib.request as u;"
            "told = {'Authorization': sys.argv[2]};"
            "print(u.urlopen(u.Request(sys.argv[1], headers=told), timeout=10).read().decode())"
        )
        part = self.parts["lab-a"]
        password = known(part.tokens["view"])["Authorization"]
        answer = docker("exec", part.container("recorder"), "python", "-c", script, asked, password)
        found: list[dict[str, Any]] = json.loads(answer)["data"]["result"]
        return found


@pytest.fixture
def laboratory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Laboratory]:
    monkeypatch.setenv("TLS_NAME", f"{NETWORK}.11")
    laboratory = Laboratory(tmp_path)
    try:
        yield laboratory
    finally:
        laboratory.remove()


def test_a_study_on_two_machines(laboratory: Laboratory, tmp_path: Path) -> None:
    """Every service is healthy, Prometheus asks all of both machines, the driver's ECG becomes features on the other
    machine, whose clock is measured as rules and panels ask, the page is behind HTTPS, and nothing else is open to who
    has no token."""
    for part in laboratory.parts.values():
        for service in part.services():
            wait_for(lambda part=part, name=service: part.healthy(name), HEALTHY_S, service)
    everything = sum(map(len, host_override.targets(laboratory.study).values()))
    assert everything == 7
    wait_for(lambda: len(laboratory.scraped('up{job="sense4hri"} == 1')) == everything, 60, "all are scraped")
    wait_for(
        lambda: laboratory.scraped('sense4hri_signal_quality_ratio{sensor_id="h10_1"} > 0.5'), 60, "features on lab-a"
    )
    clocks = 'sense4hri_host_clock_offset_seconds{field="lab_b"}'
    poll(lambda: laboratory.scraped(f"abs({clocks}) < 1e-3"), lambda: f"{laboratory.scraped(clocks)}", 60, 0.3)
    of_both = [each for each in asked.everything("h10_1", "ecg") if asked.OF_SEVERAL_HOSTS in each]
    poll(lambda: not asked.unanswered(of_both, laboratory.scraped), lambda: f"data for all of {of_both}", 60, 0.3)
    hosts = laboratory.scraped("count by (host) (sense4hri_ready)")
    assert {one["metric"]["host"] for one in hosts} == {"lab_a", "lab_b"}
    page, strap = laboratory.addresses["lab-a"], laboratory.study.services[0]
    driver = f"http://{laboratory.addresses['lab-b']}:{host_override.port_of(laboratory.study, strap)}"
    part = laboratory.parts["lab-a"]
    docker("cp", f"{part.container('tls')}:/certs/ca.crt", str(tmp_path / "ca.crt"))
    tls_checks.holds(page, 8443, tmp_path / "ca.crt", part.tokens["operate"])
    assert [get(driver + path)[0] for path in ("/metrics", "/readyz", "/openapi.json")] == [200, 200, 401]
    for port in (8080, 9090):
        with pytest.raises(OSError, match="refused"):
            get(f"http://{page}:{port}")
