"""The Compose file that goes after a study's on one of its several machines: what runs there, on its network.

    python compose/host_override.py --study STUDY --host lab-a [--tls]     # writes it, and prints its path

Every ROS node answers HTTP at its machine's address, each on a port of its own (FIRST_PORT on, in the order of the
study file, so that every machine knows those of all), and Prometheus asks all of them. What only shows (Prometheus,
Alertmanager, Grafana) listens on the loopback of its machine; the page too, and HTTPS before it on all addresses.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import study_file
import yaml
from command_words import parameters_of
from sense4hri.host_clocks import sanitised
from several_hosts import PROFILES, at, check, host_of, surroundings
from study_file import WRONG, Service, Study, StudyError

PAGE = "web_gui"
PAGE_PORT = 8080
NODE = "ROS_DOMAIN_ID"
FIRST_PORT = 9464
"""Of HTTP: on the machine's network each container needs one of its own."""
MOUNTED_PROFILES = Path("/several_hosts.xml")
BUILD = Path(__file__).resolve().parents[1] / "build"
SCRAPING = Path(__file__).parent / "prometheus" / "prometheus.yml"
MOUNTED_SCRAPING = "/etc/prometheus/prometheus.yml"
IMAGE = "sense4hri/"
PROMETHEUS = f"{IMAGE}prometheus"
LOOPBACK = "127.0.0.1"
SHOWING: dict[str, dict[str, Any]] = {
    PROMETHEUS: {"environment": {"PROMETHEUS_LISTEN": f"{LOOPBACK}:9090"}},
    f"{IMAGE}alertmanager": {"environment": {"ALERTMANAGER_LISTEN": f"{LOOPBACK}:9093"}},
    "grafana/grafana": {
        "environment": {"GF_SERVER_HTTP_ADDR": LOOPBACK},
        "extra_hosts": [f"prometheus:{LOOPBACK}"],  # by the name in its data source
    },
}
"""What changes, by image without its version, of what shows the study and is no node: one machine has them all."""
ON_THE_MACHINE = {"network_mode": "host"}
APART_NO_MORE = ("networks", "ports")
"""Keys of Docker's own networks, taken out of what shares its machine's."""


def write(study: Study, host: str, folder: Path, tls: bool = False) -> Path:
    """Write the Compose file of a machine and what Prometheus asks there; return its path. Raises StudyError."""
    scraped = folder / f"{host}.prometheus.yml"
    text = override(study, host, scraped.resolve(), tls)
    folder.mkdir(exist_ok=True)
    scraped.write_text(yaml.safe_dump(scraping(study), sort_keys=False))
    file = folder / f"{host}.yaml"
    file.write_text(text)
    return file


def override(study: Study, host: str, scraped: Path, tls: bool = False) -> str:
    """Return the Compose file of a machine. Raises StudyError.

    scraped: file of the configuration of Prometheus. tls: HTTPS goes before the page (tls.yaml). What is neither a node
    nor shows something (the proxy of Bluetooth) stays as the study has it.
    """
    check(study, host)
    _check_places(study, host, tls)
    services: dict[str, dict[str, Any] | None] = {}
    for service in (*study.services, *study.on_request):
        if host_of(study, service) not in (host, ""):
            services[service.name] = None
        elif NODE in service.environment:
            services[service.name] = _node(study, at(study, service, host), host)
        elif shows(service):
            mounted = {"volumes": [f"{scraped}:{MOUNTED_SCRAPING}:ro"]} if _kind(service) == PROMETHEUS else {}
            services[service.name] = SHOWING[_kind(service)] | mounted
    if tls:
        services["tls"] = _https(study)
    return "\n".join(["services:", *_lines(services)]) + "\n"


def targets(study: Study) -> dict[str, list[str]]:
    """Return address:port of the HTTP of every node of a study, by machine."""
    return {
        host: [
            f"{address}:{port_of(study, service)}"
            for service in study.services
            if NODE in service.environment and host_of(study, service) in (host, "")
        ]
        for host, address in study.hosts.items()
    }


def port_of(study: Study, service: Service) -> int:
    """Return the port of a node's HTTP, on whichever machine of the study it runs."""
    names = [each.name for each in (*study.services, *study.on_request)]
    return FIRST_PORT + names.index(service.name)


def scraping(study: Study) -> dict[str, Any]:
    """Return the configuration in compose/prometheus with addresses in place of the names in Docker's DNS.

    What is scraped has the machine's name, as host_clock metrics have it, in the label `host`.
    """
    content: dict[str, Any] = yaml.safe_load(SCRAPING.read_text())
    named = [content["alerting"]["alertmanagers"][0], *content["scrape_configs"]]
    nodes = [{"targets": found, "labels": {"host": sanitised(host)}} for host, found in targets(study).items() if found]
    known = {"alertmanager": [{"targets": [f"{LOOPBACK}:9093"]}], "metrics": nodes}
    for job in named:
        for entry in job.pop("dns_sd_configs", []):
            job["static_configs"] = [config for name in entry["names"] for config in known[name]]
    return content


def shows(service: Service) -> bool:
    """True for Prometheus and what it works with."""
    return _kind(service) in SHOWING


def _kind(service: Service) -> str:
    return service.image.partition(":")[0]


def _check_places(study: Study, host: str, tls: bool) -> None:
    """Raise StudyError where HTTPS has no page to go before, or what works together is on different machines."""
    page = study.of(PAGE)
    where = host_of(study, page) if page else "no machine"
    if tls and where != host:
        raise StudyError(f"{study.file}: TLS: HTTPS goes before the page, which runs on {where}, not on {host}")
    together = [service for service in (*study.services, *study.on_request) if shows(service)]
    places = {service.name: host_of(study, service) for service in together}
    if len({*places.values()}) > 1:
        told = ", ".join(f"{name} on {machine}" for name, machine in places.items())
        raise StudyError(f"{study.file}: x-host: must be one machine for all of these: {told}")


def _node(study: Study, service: Service, host: str) -> dict[str, Any]:
    """Return what changes of a container with a ROS node; as a plain process, the page is on loopback."""
    answering = {"METRICS_HOST": study.hosts[host], "METRICS_PORT": str(port_of(study, service))}
    environment = surroundings(study, host, MOUNTED_PROFILES) | answering
    keys = {"environment": environment, "volumes": [f"{PROFILES}:{MOUNTED_PROFILES}:ro"]}
    words = [*service.command, *service.added]
    return keys | ({"command": [word.replace("$", "$$") for word in words]} if words else {})


def _https(study: Study) -> dict[str, Any]:
    """Return what changes of HTTPS before the page: it finds the page on its machine's loopback."""
    page = study.of(PAGE)
    words = [*page.command, *page.added] if page else []
    port = parameters_of(f"{study.file}: services.{PAGE}.x-process", words).get("port", PAGE_PORT)
    return {"environment": {"PAGE": f"{LOOPBACK}:{port}", "PORT": "${TLS_PORT:-8443}"}}


def _lines(services: dict[str, dict[str, Any] | None]) -> Iterator[str]:
    """Yield the entries; None: taken out. Each line of JSON is YAML too."""
    for name, keys in services.items():
        if keys is None:
            yield f"  {name}: !reset null"
            continue
        yield f"  {name}:"
        yield from (f"    {key}: {json.dumps(value)}" for key, value in (ON_THE_MACHINE | keys).items())
        yield from (f"    {key}: !reset null" for key in APART_NO_MORE)


def main() -> int:
    """Write what Compose takes on this machine, or print what is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--study", required=True, help="name of a study in compose/studies, or path of a study file")
    parser.add_argument("--host", required=True, help="which of its machines this is")
    parser.add_argument("--tls", action="store_true", help="HTTPS goes before the page")
    parser.add_argument("--folder", type=Path, default=BUILD, help="where it is written (%(default)s)")
    options = parser.parse_args()
    try:
        print(write(study_file.read(study_file.find(options.study)), options.host, options.folder, options.tls))
    except StudyError as error:
        print(error, file=sys.stderr)
        return WRONG
    except OSError as error:
        print(f"{options.folder} cannot be written to: {error.strerror}", file=sys.stderr)
        return WRONG
    return 0


if __name__ == "__main__":
    sys.exit(main())
