"""A study on several machines: the part of each, from one study file.

    python compose/several_hosts.py --study STUDY --host lab-a        # its part, as `docker compose -f` takes it

`x-study.hosts` names the machines and their addresses, the first of them the one that runs whatever has no `x-host`.
The recorder's machine is the reference of all clocks; clock-sync runs on every machine.
"""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import study_file
import yaml
from study_file import WRONG, Service, Study, StudyError

CLOCK_SYNC = "clock_sync"
NODE = "ROS_DOMAIN_ID"
FIRST_PORT = 9464
"""Of HTTP: on the machine's network each container needs one of its own."""
PROFILES = Path(__file__).with_name("several_hosts.xml")
MOUNTED = Path("/several_hosts.xml")


def part(study: Study, host: str) -> Study:
    """Return what a machine runs of a study; all of it where the study is of one machine. Raises StudyError."""
    if not study.hosts and not host:
        return study
    if host not in study.hosts:
        known = ", ".join(study.hosts) or "no machine"
        raise StudyError(f"{study.file}: x-study.hosts: HOST={host} is none of its machines; it names {known}")
    services = [_at(study, service, host) for service in study.services if host_of(study, service) in (host, "")]
    return dataclasses.replace(study, services=tuple(services))


def host_of(study: Study, service: Service) -> str:
    """Return the machine of a service; empty for clock-sync, which runs on all of them."""
    return "" if service.package == CLOCK_SYNC else service.host or next(iter(study.hosts))


def reference(study: Study) -> str:
    """Return the machine whose clock all others are measured against: the recorder's."""
    recorder = study.of("recorder")
    return next(iter(study.hosts)) if recorder is None else host_of(study, recorder)


def surroundings(study: Study, host: str, profiles: Path = PROFILES) -> dict[str, str]:
    """Return the variables of whatever runs there: its name, where the others are, without multicast, and profiles."""
    peers = ";".join(address for name, address in study.hosts.items() if name != host)
    told = {"SENSE4HRI_HOST": host, "ROS_STATIC_PEERS": peers, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    return told | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profiles)}


def _at(study: Study, service: Service, host: str) -> Service:
    told = ["--ros-args", "-p", f"reference_host:={reference(study)}"] if service.package == CLOCK_SYNC else []
    environment = {**service.environment, **surroundings(study, host)}
    return dataclasses.replace(service, environment=environment, command=(*service.command, *told))


def override(study: Study, host: str) -> str:
    """Return the Compose file that goes after the study's: this machine's services alone, ROS nodes on its network.

    Those without a ROS domain (Prometheus, the proxy of Bluetooth) stay on Docker's.
    """
    here = {service.name: service for service in part(study, host).services}
    lines = ["services:"]
    for number, service in enumerate(study.services):
        if service.name not in here:
            lines += [f"  {service.name}: !reset null"]
            continue
        if NODE in service.environment:
            own = {service.name: _on_the_machines_network(study, here[service.name], host, FIRST_PORT + number)}
            lines += [f"  {line}" for line in yaml.safe_dump(own, sort_keys=False).splitlines()]
            lines += ["    networks: !reset null", "    ports: !reset null"]
    return "\n".join(lines) + "\n"


def _on_the_machines_network(study: Study, service: Service, host: str, port: int) -> dict[str, Any]:
    """Return what changes of a container that shares the machine's network: as a plain process, HTTP is on loopback."""
    environment = surroundings(study, host, MOUNTED) | {"METRICS_HOST": "127.0.0.1", "METRICS_PORT": str(port)}
    keys = {"network_mode": "host", "environment": environment, "volumes": [f"{PROFILES}:{MOUNTED}:ro"]}
    words = [*service.command, *service.added]
    return keys | ({"command": [word.replace("$", "$$") for word in words]} if words else {})


def main() -> int:
    """Print the override of a machine, or what is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--study", required=True)
    parser.add_argument("--host", required=True)
    options = parser.parse_args()
    try:
        print(override(study_file.read(study_file.find(options.study)), options.host), end="")
    except StudyError as error:
        print(error, file=sys.stderr)
        return WRONG
    return 0


if __name__ == "__main__":
    sys.exit(main())
