"""A study on several machines: the part of each, from one study file.

`x-study.hosts` names the machines and their addresses, the first of them the one that runs whatever has no `x-host`.
The recorder's machine is the reference of all clocks; clock-sync runs on every machine. What Compose runs of it:
host_override.py.
"""

import dataclasses
from pathlib import Path

from study_file import Service, Study, StudyError

CLOCK_SYNC = "clock_sync"
PROFILES = Path(__file__).with_name("several_hosts.xml")


def part(study: Study, host: str) -> Study:
    """Return what a machine runs of a study; all of it where the study is of one machine. Raises StudyError."""
    if not study.hosts and not host:
        return study
    check(study, host)
    services = [at(study, service, host) for service in study.services if host_of(study, service) in (host, "")]
    return dataclasses.replace(study, services=tuple(services))


def check(study: Study, host: str) -> None:
    """Raise StudyError where a machine is none of the study."""
    if host not in study.hosts:
        known = ", ".join(study.hosts) or "no machine"
        told = f"HOST={host} is none of its machines" if host else "HOST must say which of its machines this is"
        raise StudyError(f"{study.file}: x-study.hosts: {told}; it names {known}")


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


def at(study: Study, service: Service, host: str) -> Service:
    """Return a service as it runs on a machine of the study."""
    told = ["--ros-args", "-p", f"reference_host:={reference(study)}"] if service.package == CLOCK_SYNC else []
    environment = {**service.environment, **surroundings(study, host)}
    return dataclasses.replace(service, environment=environment, command=(*service.command, *told))
