"""What a cluster runs of a study: per service one Deployment and, where others must find it, one Service. Pure.

A service that mounts something of its machine (the D-Bus proxy) becomes a second container in the pod of everybody with
whom it shares a volume, and that volume is the pod's own: so the machine's path stays in pods of a namespace apart.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from study_file import Service, Study, StudyError
from study_tokens import INSIDE, ROLES, files_of, roles_of

Manifest = dict[str, Any]
USER = 10001
"""As in the images; all pods' files belong to it."""
METRICS_PORT = 9464
FIRST_DDS_PORT, PER_DOMAIN = 7410, 250
"""UDP port of participant 0 of domain 0, at which others find it; ports per domain."""
MEASURED = {
    "default": ("96Mi", "50m"),
    "sensor-bench": ("160Mi", "100m"),
    "web-gui": ("128Mi", "150m"),
    "recorder": ("128Mi", "150m"),
    "fusion-affect": ("96Mi", "100m"),
    "bluetooth": ("16Mi", "10m"),
}
"""Requests: memory and CPU a little above what docs/benchmarks.md (containers) says of each; a test compares."""
LIMITS = {"memory": "512Mi", "cpu": "1000m"}
"""What goes wrong in one service stays there; ten times and more of what it needs. Where a study gives none."""
SIZE = re.compile(r"(?P<number>\d+(\.\d+)?)\s*(?P<unit>[bkmg]?)b?", re.I)
CORES = re.compile(r"\d+(\.\d+)?")
MEBIBYTES = {"": 2**-20, "b": 2**-20, "k": 2**-10, "m": 1, "g": 2**10}
NAME = re.compile(r"[a-z]([a-z0-9-]{0,48}[a-z0-9])?")
"""Of what a cluster has for a service or a volume, whose own names add some signs to it."""
TAKEN = {
    "services": re.compile(r"graph|kustomization|metrics|namespaces|policies|volumes"),
    "volumes": re.compile(r"scraping|tokens|(machine|tmp)-.*"),
}
"""Of the same form, and names of what is written beside the services, or of what pods have beside a study's volumes."""
TARGET = re.compile(r"(?P<first>\d+)(?:-(?P<last>\d+))?(?:/(?P<protocol>\w+))?")
OF_THE_NETWORK = ("driver_lsl", "driver_pupil_labs", "bridge_lsl")
"""Packages whose devices and listeners are on the network, at ports that no Service and no policy here has."""
CONFIGURED = ("ROS_DOMAIN_ID", "ALLOWED_HOSTS", "METRICS_HOST", "METRICS_PORT", "SENSE4HRI_HOST")
"""Variables whose values come from the ConfigMap, whatever the study gives; the machine's name from the cluster."""
SOCKETS = ("/run/dbus",)
"""Folders of its machine that a sidecar may see: what a study keeps in files of a machine, a cluster has nowhere."""
OWN_PROBES = {"prometheus": ["ready", "9090"]}
"""By service: the command of its image that says whether it is ready; over HTTP it asks for the view token."""
CONFIG_FILES = {"prometheus": ("scraping", "/etc/prometheus", "prometheus.yml")}
"""By service: ConfigMap, folder, and the file there that it stands in for."""


@dataclass(frozen=True)
class Names:
    """What the objects of one study are called. tag: of our images. domain: its ROS domain."""

    study: str
    tag: str
    domain: int = 0

    @property
    def namespace(self) -> str:
        return f"sense4hri-{self.study}"

    @property
    def radio_namespace(self) -> str:
        """Of the pods that see something of their machine."""
        return f"{self.namespace}-radio"

    def image(self, name: str) -> str:
        """An image of ours carries the release as its tag."""
        return f"{name}:{self.tag}" if name.startswith("sense4hri/") and ":" not in name else name

    def labels(self, service: str) -> dict[str, str]:
        return {"app.kubernetes.io/name": service, "app.kubernetes.io/part-of": self.namespace}

    @property
    def dds_port(self) -> int:
        return FIRST_DDS_PORT + PER_DOMAIN * self.domain


def is_ros(service: Service) -> bool:
    """True where it takes part in the ROS graph."""
    return "ROS_DOMAIN_ID" in service.environment


def machine_paths(service: Service) -> dict[str, str]:
    """Path in the container -> path of the machine."""
    return {target: source for target, source in service.mounts.items() if source.startswith("/")}


def volumes(service: Service) -> set[str]:
    return {source for source in service.mounts.values() if not source.startswith("/")}


def sidecars(study: Study, service: Service) -> list[Service]:
    """Return the services that run in its pod: they share a volume with it, and see something of the machine."""
    return [other for other in study.services if machine_paths(other) and volumes(other) & volumes(service)]


def pods(study: Study) -> Iterator[tuple[Service, list[Service]]]:
    """Yield each service that has a pod, with its sidecars. Raises StudyError for what no cluster can run."""
    for service in study.services:
        where = f"{study.file}: services.{service.name}"
        for named in (f"services.{service.name}", *(f"volumes.{name}" for name in sorted(volumes(service)))):
            kind, _, name = named.partition(".")
            if not NAME.fullmatch(name):
                text = "must be small letters, digits and - in a cluster, a letter first, 50 at most"
                raise StudyError(f"{study.file}: {named}: {text}")
            if TAKEN[kind].fullmatch(name):
                raise StudyError(f"{study.file}: {named}: the manifests have {name} of their own; choose another name")
        if is_of_the_network(service):
            text = "no pod reaches a device on the network, beside the ROS graph; see k8s/README.md"
            raise StudyError(f"{where}.command: {text}")
        if service.devices:
            raise StudyError(f"{where}.devices: a device of this machine reaches no pod; see k8s/README.md")
        seen = machine_paths(service).values()
        shares = any(volumes(service) & volumes(other) for other in study.services if other is not service)
        for path in seen:
            if not shares or str(PurePosixPath(path).parent) not in SOCKETS:
                text = f"{path} is of this machine; a pod has none of it, put it into an image"
                raise StudyError(f"{where}.volumes: {text}")
        if not seen:
            yield service, sidecars(study, service)


def is_of_the_network(service: Service) -> bool:
    link = str(service.parameters.get("port", ""))
    at_an_address = link.startswith(("socket:", "rfcomm:")) or bool(service.parameters.get("ip_address"))
    return service.package in OF_THE_NETWORK or at_an_address


def namespace_of(names: Names, beside: list[Service]) -> str:
    return names.radio_namespace if beside else names.namespace


def workload(names: Names, service: Service, beside: list[Service]) -> list[Manifest]:
    """Return its Deployment, and its Service where it is in the ROS graph or listens."""
    meta = {"name": service.name, "namespace": namespace_of(names, beside), "labels": names.labels(service.name)}
    deployment = {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": meta,
        "spec": {
            "replicas": 1,
            "strategy": {"type": "Recreate"},  # one participant behind its Service, one writer of a file or a stream
            "selector": {"matchLabels": names.labels(service.name)},
            "template": {"metadata": _pod_meta(names, service), "spec": _pod(names, service, beside)},
        },
    }
    ports = _ports(names, service)
    spec = {"selector": names.labels(service.name), "publishNotReadyAddresses": True, "ports": ports}
    return [deployment, *([{"apiVersion": "v1", "kind": "Service", "metadata": meta, "spec": spec}] if ports else [])]


def _ports(names: Names, service: Service) -> list[dict[str, Any]]:
    """Where others find it. The target of a mapping of Compose is its last number."""
    ros = [
        {"name": "dds", "protocol": "UDP", "port": names.dds_port, "targetPort": names.dds_port},
        {"name": "metrics", "protocol": "TCP", "port": METRICS_PORT, "targetPort": METRICS_PORT},
    ]
    targets = sorted({target for given in service.ports for target in _targets(given)} - {(METRICS_PORT, "TCP")})
    more = [
        {"name": f"port-{port}-{protocol.lower()}", "protocol": protocol, "port": port, "targetPort": port}
        for port, protocol in targets
    ]
    if len(more) == 1:
        more[0]["name"] = "http"
    return [*(ros if is_ros(service) else []), *more]


def _targets(given: Any) -> Iterator[tuple[int, str]]:
    """Yield port and protocol of the container of an entry of `ports`."""
    is_long = isinstance(given, dict)
    text = f"{given.get('target')}/{given.get('protocol', 'tcp')}" if is_long else str(given).rpartition(":")[2]
    if found := TARGET.fullmatch(text):
        first = int(found["first"])
        for port in range(first, int(found["last"] or first) + 1):
            yield port, (found["protocol"] or "tcp").upper()


def _pod_meta(names: Names, service: Service) -> dict[str, Any]:
    if not is_ros(service):
        return {"labels": names.labels(service.name)}
    scrape = {"scrape": "true", "port": str(METRICS_PORT), "path": "/metrics"}
    annotations = {f"prometheus.io/{key}": value for key, value in scrape.items()}
    return {"labels": names.labels(service.name) | {"sense4hri.org/ros": "true"}, "annotations": annotations}


def _pod(names: Names, service: Service, beside: list[Service]) -> dict[str, Any]:
    containers = [_container(names, service), *(_container(names, other) for other in beside)]
    return {
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,  # no variables such as PROMETHEUS_PORT made from names of Services
        "terminationGracePeriodSeconds": 15,
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": USER,
            "runAsGroup": USER,
            "fsGroup": USER,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "containers": containers,
        "volumes": _volumes(service, beside),
    }


def _container(names: Names, service: Service) -> dict[str, Any]:
    return {
        "name": service.name,
        "image": names.image(service.image),
        "imagePullPolicy": "IfNotPresent",
        **({"args": [_literal(word) for word in service.command]} if service.command else {}),
        **({"workingDir": service.folder} if service.folder else {}),
        **_environment(service),
        **({"ports": _container_ports(names, service)} if _ports(names, service) else {}),
        **_probes(service),
        "resources": _resources(service),
        "terminationMessagePolicy": "FallbackToLogsOnError",  # `kubectl describe pod` shows its last sentence
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        | ({"appArmorProfile": {"type": "Unconfined"}} if machine_paths(service) else {}),  # else no D-Bus on Ubuntu
        "volumeMounts": [*_mounts(service), {"name": f"tmp-{service.name}", "mountPath": "/tmp"}],
    }


def _literal(word: str) -> str:
    """A cluster puts a variable in place of $(NAME), and one $ in that of two; Compose has done so already."""
    return word.replace("$", "$$")


def _environment(service: Service) -> dict[str, Any]:
    configured = CONFIGURED if is_ros(service) else ()
    own = [
        {"name": name, "value": _literal(value)}
        for name, value in service.environment.items()
        if name not in configured
    ]
    if not is_ros(service):
        return {"env": own} if own else {}
    tokens = [{"name": name, "value": file} for name, file in files_of(ROLES).items()]
    machine = {"name": "SENSE4HRI_HOST", "valueFrom": {"fieldRef": {"fieldPath": "spec.nodeName"}}}
    return {"env": [*own, *tokens, machine], "envFrom": [{"configMapRef": {"name": "graph"}}]}


def _container_ports(names: Names, service: Service) -> list[dict[str, Any]]:
    return [
        {"name": port["name"], "containerPort": port["port"], "protocol": port["protocol"]}
        for port in _ports(names, service)
    ]


def _probes(service: Service) -> dict[str, Any]:
    """Probes over HTTP, or by a command; of a proxy, whether its socket is there; none of somebody else's, which may
    have no HTTP."""
    if machine_paths(service):
        sockets = [f"{target}/system_bus_socket" for target, source in service.mounts.items() if source[0] != "/"]
        return {"readinessProbe": {"exec": {"command": ["test", "-S", *sockets]}, "periodSeconds": 5}}
    if not service.ours and service.name not in OWN_PROBES:
        return {}
    own = {"exec": {"command": OWN_PROBES[service.name]}} if service.name in OWN_PROBES else None
    ready, alive = own or _http("/readyz"), own or _http("/healthz")
    return {
        "startupProbe": {**alive, "timeoutSeconds": 5, "periodSeconds": 2, "failureThreshold": 60},
        "readinessProbe": {**ready, "timeoutSeconds": 5, "periodSeconds": 5, "failureThreshold": 2},
        "livenessProbe": {**alive, "timeoutSeconds": 5, "periodSeconds": 10, "failureThreshold": 6},
    }


def _http(path: str) -> dict[str, Any]:
    return {"httpGet": {"path": path, "port": METRICS_PORT}}


def _resources(service: Service) -> dict[str, Any]:
    memory, cpu = MEASURED.get(service.name, MEASURED["default"])
    own = SIZE.fullmatch(service.mem_limit)
    limits = LIMITS | ({"memory": f"{_mebibytes(own)}Mi"} if own and float(own["number"]) else {})
    if CORES.fullmatch(service.cpus) and float(service.cpus):
        limits["cpu"] = f"{max(round(1000 * float(service.cpus)), 1)}m"
    least = {
        "memory": min(memory, limits["memory"], key=lambda size: int(size.removesuffix("Mi"))),
        "cpu": min(cpu, limits["cpu"], key=lambda share: int(share.removesuffix("m"))),
    }
    return {"requests": least, "limits": limits}


def _mebibytes(size: re.Match[str]) -> int:
    return round(float(size["number"]) * MEBIBYTES[size["unit"].lower()])


def _mounts(service: Service) -> list[dict[str, Any]]:
    """Where a container has its volumes; of a path of the machine its folder, since a socket may be made anew there."""
    own = [
        {"name": source, "mountPath": at} | ({"readOnly": True} if at in service.read_only else {})
        for at, source in service.mounts.items()
        if not source.startswith("/")
    ]
    machine = [
        {"name": _machine_name(source), "mountPath": str(PurePosixPath(at).parent), "readOnly": True}
        for at, source in machine_paths(service).items()
    ]
    config = [
        {"name": name, "mountPath": f"{folder}/{file}", "subPath": file, "readOnly": True}
        for name, folder, file in _configs(service)
    ]
    tokens = [{"name": "tokens", "mountPath": INSIDE, "readOnly": True}] if roles_of(service.environment) else []
    return [*own, *machine, *config, *tokens]


def _configs(service: Service) -> list[tuple[str, str, str]]:
    return [CONFIG_FILES[service.name]] if service.name in CONFIG_FILES else []


def _machine_name(source: str) -> str:
    """The name of the volume that is the folder of a path of the machine, such as machine-run-dbus."""
    return "machine" + str(PurePosixPath(source).parent).replace("/", "-").lower()


def _volumes(service: Service, beside: list[Service]) -> list[dict[str, Any]]:
    """The pod's volumes: claims; folders in memory, and what it shares with its sidecars; folders of the machine."""
    shared = {name for other in beside for name in volumes(other)}
    claims = [
        {"name": name, "persistentVolumeClaim": {"claimName": name}} for name in sorted(volumes(service) - shared)
    ]
    in_memory = [*sorted(shared), *(f"tmp-{each.name}" for each in (service, *beside))]
    folders = [{"name": name, "emptyDir": {"medium": "Memory", "sizeLimit": "64Mi"}} for name in in_memory]
    machine = {source for other in beside for source in machine_paths(other).values()}
    hosts = [
        {"name": _machine_name(each), "hostPath": {"path": str(PurePosixPath(each).parent), "type": "Directory"}}
        for each in sorted(machine)
    ]
    configs = [{"name": name, "configMap": {"name": name}} for name, _, _ in _configs(service)]
    return [*claims, *configs, *_tokens(roles_of(service.environment)), *folders, *hosts]


def _tokens(roles: tuple[str, ...]) -> list[dict[str, Any]]:
    """The Secret that k8s/up.sh makes, whose keys are the roles; no token is in an environment, as with `make up`."""
    part = {} if roles == ROLES else {"items": [{"key": role, "path": role} for role in roles]}
    secret = {"secretName": "tokens", "defaultMode": 0o440, **part}
    return [{"name": "tokens", "secret": secret}] if roles else []
