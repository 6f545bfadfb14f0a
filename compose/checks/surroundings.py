"""Environment variables of a study: those that its services are given, and those that its file is filled in with."""

import os
import re
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from compose_yaml import VARIABLE, load, near
from host_override import FIRST_PORT, PROMETHEUS
from study_file import SERVICES, Study

from checks.finding import Finding, Places

_READ = """
ALLOWED_HOSTS DBUS_SYSTEM_BUS_ADDRESS METRICS_HOST METRICS_PORT
SENSE4HRI_HOST SENSE4HRI_VERSION SENSE4HRI_OPERATE_TOKEN SENSE4HRI_OPERATE_TOKEN_FILE SENSE4HRI_VIEW_TOKEN
SENSE4HRI_VIEW_TOKEN_FILE
"""
_OF_ROS = """
AMENT_PREFIX_PATH FASTDDS_BUILTIN_TRANSPORTS FASTDDS_DEFAULT_PROFILES_FILE FASTRTPS_DEFAULT_PROFILES_FILE
RCUTILS_COLORIZED_OUTPUT RCUTILS_CONSOLE_OUTPUT_FORMAT RCUTILS_LOGGING_BUFFERED_STREAM RCUTILS_LOGGING_USE_STDOUT
RMW_FASTRTPS_PUBLICATION_MODE RMW_FASTRTPS_USE_QOS_FROM_XML RMW_IMPLEMENTATION ROS_AUTOMATIC_DISCOVERY_RANGE
ROS_DISABLE_LOANED_MESSAGES ROS_DISCOVERY_SERVER ROS_DISTRO ROS_DOMAIN_ID ROS_HOME ROS_LOCALHOST_ONLY ROS_LOG_DIR
ROS_PYTHON_VERSION ROS_SECURITY_ENABLE ROS_SECURITY_ENCLAVE_OVERRIDE ROS_SECURITY_KEYSTORE ROS_SECURITY_STRATEGY
ROS_STATIC_PEERS ROS_SUPER_CLIENT ROS_TRACE_DIR ROS_VERSION
"""

READ = frozenset(_READ.split())
"""What the house's services read."""
OF_ROS = frozenset(_OF_ROS.split())
"""What ROS 2 Jazzy and Fast DDS read."""
NOBODY_ELSES = ("SENSE4HRI_", "ROS_")
"""With these a name is the house's or that of ROS."""
DOMAIN = "ROS_DOMAIN_ID"
ASKED = str(FIRST_PORT)  # in the configuration of Prometheus
ALIKE = 0.86  # from which a name is taken for a wrong spelling; ROS_HOME and ROS_NAME differ
HOUSE = SERVICES.parent / "compose" / "compose.yaml"


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield variables of services that nobody reads, and variables of the file that are misspelt."""
    known = READ | OF_ROS | set(_of_the_house())
    for service in study.services:
        for name in _given(study, service.name):
            meant = near(name, known, ALIKE)
            if name not in known and (meant or name.startswith(NOBODY_ELSES)):
                keys = f"services.{service.name}.environment"
                yield places.error(keys, f"nobody reads {name}{meant}", name)
    yield from _domains(study, places)
    yield from _unasked(study, places)
    yield from _filled_in(study, places)


def _domains(study: Study, places: Places) -> Iterator[Finding]:
    """Yield services in another ROS domain than most of the study."""
    domains = {each.name: each.environment[DOMAIN] for each in study.services if DOMAIN in each.environment}
    usual = next(iter(Counter(domains.values()).most_common(1)), ("", 0))[0]
    for name, domain in domains.items():
        if domain != usual:
            text = f"{DOMAIN} is {domain}, that of the others {usual}: it hears none of them"
            yield places.error(f"services.{name}.environment", text, DOMAIN)


def _unasked(study: Study, places: Places) -> Iterator[Finding]:
    """Yield services whose port the study's Prometheus does not ask; on several machines each is given its own."""
    is_asked = any(service.image.startswith(PROMETHEUS) for service in study.services) and not study.hosts
    for service in study.services if is_asked else ():
        if (port := service.environment.get("METRICS_PORT", ASKED)) != ASKED:
            text = f"METRICS_PORT is {port}: Prometheus asks at {ASKED} alone, and gets no metrics of it"
            yield places.warning(f"services.{service.name}.environment", text, "METRICS_PORT")


def _filled_in(study: Study, places: Places) -> Iterator[Finding]:
    """Yield `${NAME}` of the file that nobody sets: nearly one that the house's files have, or without a default."""
    known = {found.name for found in _variables(HOUSE.read_text("utf-8"))} | READ | OF_ROS
    for found in dict.fromkeys(_variables(study.file.read_text("utf-8"))):
        if found.name in known or found.name in os.environ:
            continue
        meant = near(found.name, known, ALIKE)
        if meant or not found.has_default:
            text = f"${{{found.name}}} is set by nobody{meant or ', and has no default: it is empty'}"
            yield places.warning("services", text, f"${{{found.name}", f"${found.name}")


def _of_the_house() -> Iterator[str]:
    """Yield the variables that the house's compose file gives its services."""
    for service in load(HOUSE, os.environ)["services"].values():
        yield from service.get("environment") or ()


def _given(study: Study, service: str) -> list[str]:
    """Return the variables that the study file itself gives a service."""
    given = load(study.file, os.environ)["services"][service].get("environment") or {}
    return [str(entry).partition("=")[0] for entry in given]


class _Variable(NamedTuple):
    name: str
    has_default: bool


def _variables(text: str) -> Iterator[_Variable]:
    """Yield the variables that a text is filled in with, comments left out."""
    for found in VARIABLE.finditer(re.sub(r"(?m)(^|\s)#.*$", "", text)):
        if name := found["braced"] or found["plain"]:
            yield _Variable(name, found["default"] is not None)
