"""What stands around a study's pods: namespaces, peers, who may talk to whom, and what is asked to be stored. Pure."""

from typing import Any

import yaml
from workloads import METRICS_PORT, Manifest, Names

DEFAULT_SIZE = "1Gi"
SIZES = {"recordings": "50Gi", "prometheus": "10Gi", "radio": "10Mi"}
PARTICIPANTS = 3
"""Participants of one pod whose ports are open: its service, and commands such as sense4hri-session run in it."""
MONITORING = {"sense4hri.org/monitoring": "true"}
"""Namespaces with this label may read the metrics."""


def namespaces(names: Names, radio: bool) -> list[Manifest]:
    """The study's namespace under the restricted policy; that of the pods that see their machine under none."""
    levels = {names.namespace: "restricted"} | ({names.radio_namespace: "privileged"} if radio else {})
    return [
        {
            "apiVersion": "v1",
            "kind": "Namespace",
            "metadata": {
                "name": name,
                "labels": {"app.kubernetes.io/part-of": names.namespace, "pod-security.kubernetes.io/enforce": level},
            },
        }
        for name, level in levels.items()
    ]


def graph(names: Names, namespace: str, services: list[tuple[str, str]]) -> Manifest:
    """The ConfigMap that lets every node find the others without multicast.

    services: namespace and name of everybody in the ROS graph. A name that does not resolve would keep a node from
    being made, so each is of a Service, whose address stays when its pod is replaced.
    """
    data = {
        "ROS_DOMAIN_ID": str(names.domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_STATIC_PEERS": ";".join(f"{name}.{of}.svc" for of, name in services),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "ALLOWED_HOSTS": "",
        "METRICS_HOST": "0.0.0.0",
        "METRICS_PORT": str(METRICS_PORT),  # where probes, Services, policies and Prometheus find each pod
    }
    return {**_head("v1", "ConfigMap", "graph", namespace), "data": data}


def metrics_service(namespace: str) -> Manifest:
    """The headless Service whose DNS entry holds every pod with metrics, as the network alias has in compose.yaml."""
    port = {"name": "metrics", "port": METRICS_PORT, "targetPort": METRICS_PORT}
    spec = {"clusterIP": "None", "publishNotReadyAddresses": True, "selector": {"sense4hri.org/ros": "true"}}
    return {**_head("v1", "Service", "metrics", namespace), "spec": {**spec, "ports": [port]}}


def scraping(names: Names, config: str, of: list[str]) -> Manifest:
    """The ConfigMap with the configuration in compose/prometheus, which asks for the pods of all namespaces."""
    content = yaml.safe_load(config)
    for job in content["scrape_configs"]:
        for entry in job.get("dns_sd_configs", []):
            entry["names"] = [f"metrics.{namespace}.svc" for namespace in of]
    data = {"prometheus.yml": yaml.safe_dump(content, sort_keys=False)}
    return {**_head("v1", "ConfigMap", "scraping", names.namespace), "data": data}


def claim(volume: str, namespace: str) -> Manifest:
    """What is asked for a volume: of the cluster's default class, mounted on one machine at a time."""
    size = SIZES.get(volume, DEFAULT_SIZE)
    spec = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": size}}}
    return {**_head("v1", "PersistentVolumeClaim", volume, namespace), "spec": spec}


def policies(names: Names, namespace: str) -> list[Manifest]:
    """Nobody talks to anybody but: names, the ROS graph of this study, and those who read metrics."""
    ros = {"matchLabels": {"sense4hri.org/ros": "true"}}
    study = {"matchLabels": {"app.kubernetes.io/part-of": names.namespace}}
    prometheus = {"matchLabels": {"app.kubernetes.io/name": "prometheus"}}
    others = [{"namespaceSelector": study, "podSelector": ros}]
    dds = [_port("UDP", names.dds_port + number) for number in range(2 * PARTICIPANTS)]
    dns = {"ports": [_port("UDP", 53), _port("TCP", 53)]}  # wherever the cluster's DNS is
    metrics = [_port("TCP", METRICS_PORT)]
    readers = [
        {"namespaceSelector": study, "podSelector": prometheus},
        {"namespaceSelector": {"matchLabels": MONITORING}},
    ]
    graph_ports = {"ingress": [{"from": others, "ports": dds}], "egress": [{"to": others, "ports": dds}]}
    rules: dict[str, tuple[Any, dict[str, Any]]] = {
        "nobody": ({}, {"policyTypes": ["Ingress", "Egress"]}),
        "names": ({}, {"policyTypes": ["Egress"], "egress": [dns]}),
        "graph": (ros, {"policyTypes": ["Ingress", "Egress"], **graph_ports}),
        "metrics": (ros, {"policyTypes": ["Ingress"], "ingress": [{"from": readers, "ports": metrics}]}),
        "scraping": (prometheus, {"policyTypes": ["Egress"], "egress": [{"to": others, "ports": metrics}]}),
    }
    return [
        {
            **_head("networking.k8s.io/v1", "NetworkPolicy", name, namespace),
            "spec": {"podSelector": pods, **rule},
        }
        for name, (pods, rule) in rules.items()
    ]


def _port(protocol: str, number: int) -> dict[str, Any]:
    return {"protocol": protocol, "port": number}


def _head(version: str, kind: str, name: str, namespace: str) -> Manifest:
    return {"apiVersion": version, "kind": kind, "metadata": {"name": name, "namespace": namespace}}
