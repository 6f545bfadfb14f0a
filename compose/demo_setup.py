"""What `make demo` settles before anything starts: options, ROS domain, the page's port, the study, what is wrong."""

import argparse
import contextlib
import os
import random
import socket
from pathlib import Path

import check_study
import several_hosts
import study_file
from arguments import positive
from checks.machine import GUI_PORT, PORTS_TRIED, page_port
from study_file import Study

ROOT = Path(__file__).resolve().parents[1]


def options(description: str) -> argparse.Namespace:
    """Return what was asked for on the command line."""
    parser = argparse.ArgumentParser(prog="make demo", description=description)
    parser.add_argument("--study", default="demo", help="name of a study in compose/studies, or path of a study file")
    parser.add_argument("--host", default="", help="of a study on several machines: which of them this is")
    parser.add_argument("--duration", type=positive, metavar="S", help="stop by itself after recording so many seconds")
    parser.add_argument("--input", metavar="FILE", help="p1 plays this real recording (see services/sensor-bench)")
    parser.add_argument("--port", type=int, help="port of the page; 8080, or the next free one, unless given")
    parser.add_argument("--recordings", type=Path, default=ROOT / "recordings", help="folder for recordings")
    return parser.parse_args()


def read(options: argparse.Namespace) -> Study:
    """Read the study file; the recordings' folder and the page's port are what its variables stand for.

    Raises StudyError.
    """
    study = study_file.read(study_file.find(options.study), _environment(options))
    return several_hosts.part(study, options.host)


def _environment(options: argparse.Namespace) -> dict[str, str]:
    return os.environ | {"RECORDINGS": str(options.recordings.resolve()), "GUI_PORT": str(_page_port(options.port))}


def own_domain() -> socket.socket:
    """Set ROS_DOMAIN_ID, unless it is set, to one that no other demo on this machine holds; close to release it."""
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    if "ROS_DOMAIN_ID" in os.environ:
        return claim
    for domain in random.sample(range(1, 30), 29):
        with contextlib.suppress(OSError):
            claim.bind(f"\0sense4hri-demo-domain-{domain}")
            os.environ["ROS_DOMAIN_ID"] = str(domain)
            return claim
    raise SystemExit("29 demos run on this machine already; set ROS_DOMAIN_ID to run another one")


def _page_port(given: int | None) -> int:
    """Return the port of the page: the given one, else 8080 or the next one that is free."""
    if given is not None:
        return given
    if (port := page_port()) is not None:
        return port
    raise SystemExit(f"ports {GUI_PORT} to {GUI_PORT + PORTS_TRIED - 1} are all taken; set PORT to a free one")


def unfit(options: argparse.Namespace) -> bool:
    """Say all that is wrong with the study and this machine; True where it cannot be run. Raises StudyError."""
    file = study_file.find(options.study)
    hours = options.duration / 3600 if options.duration else check_study.HOURS
    found = check_study.findings(file, "processes", hours, options.recordings, _environment(options), options.host)
    if found:
        check_study.print_all(found)
    return check_study.status(found) != 0


def unplayable(study: Study, path: str | None) -> str:
    """Return a sentence where this recording cannot be played by the study's virtual sensors, "" where it can."""
    if path is None:
        return ""
    if study.of("sensor_bench") is None:
        return f"INPUT={path} cannot be played: {study.file} has no sensor-bench"
    try:
        with open(path, "rb"):
            return ""
    except OSError as error:
        return f"INPUT={path} cannot be played: {error.strerror}"
