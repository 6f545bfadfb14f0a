"""What must hold of a study's manifests and no schema knows: every fault is one sentence."""

from collections.abc import Iterator, Sequence
from typing import Any

Manifest = dict[str, Any]
MADE_BY_UP = {"tokens"}
"""The Secret that k8s/up.sh makes."""
MACHINE_FOLDERS = {"/run/dbus"}
"""What a pod may see of its machine."""


class Objects:
    """The manifests of one rendered overlay. Every question is within a namespace."""

    def __init__(self, manifests: Sequence[Manifest]) -> None:
        self.all = [each for each in manifests if each]

    def of(self, kind: str) -> list[Manifest]:
        return [each for each in self.all if each["kind"] == kind]

    def named(self, kind: str, namespace: str) -> set[str]:
        return {each["metadata"]["name"] for each in self.of(kind) if each["metadata"].get("namespace") == namespace}

    def pods(self) -> Iterator[tuple[str, str, dict[str, str], Manifest]]:
        """Namespace, name, labels and spec of every Deployment's pod."""
        for each in self.of("Deployment"):
            template = each["spec"]["template"]
            yield (
                each["metadata"]["namespace"],
                each["metadata"]["name"],
                template["metadata"]["labels"],
                template["spec"],
            )


def faults(manifests: Sequence[Manifest]) -> list[str]:
    """Return everything that is wrong."""
    objects = Objects(manifests)
    checks = (_selectors, _services, _references, _peers, _containers, _confinement, _machine, _policies, _volumes)
    return [fault for check in checks for fault in check(objects)]


def _selects(selector: dict[str, str], labels: dict[str, str]) -> bool:
    return selector.items() <= labels.items()


def _selectors(objects: Objects) -> Iterator[str]:
    for each in objects.of("Deployment"):
        name, spec = each["metadata"]["name"], each["spec"]
        if not _selects(spec["selector"]["matchLabels"], spec["template"]["metadata"]["labels"]):
            yield f"Deployment {name} does not select its own pods"
        if spec.get("replicas") != 1 or spec.get("strategy", {}).get("type") != "Recreate":
            yield f"Deployment {name} may run twice at once"


def _services(objects: Objects) -> Iterator[str]:
    for each in objects.of("Service"):
        name, namespace, spec = each["metadata"]["name"], each["metadata"]["namespace"], each["spec"]
        chosen = [
            pod for of, _, labels, pod in objects.pods() if of == namespace and _selects(spec["selector"], labels)
        ]
        if not chosen or (len(chosen) > 1 and spec.get("clusterIP") != "None"):
            yield f"Service {name} selects {len(chosen)} pods"
        for port, pod in ((port, pod) for port in spec["ports"] for pod in chosen):
            wanted = (port["targetPort"], port.get("protocol", "TCP"))
            if wanted not in {
                (p["containerPort"], p["protocol"]) for c in pod["containers"] for p in c.get("ports", [])
            }:
                yield f"Service {name}: no container has port {wanted[0]}"


def _references(objects: Objects) -> Iterator[str]:
    for namespace, name, _, pod in objects.pods():
        known = {kind: objects.named(kind, namespace) for kind in ("ConfigMap", "PersistentVolumeClaim")}
        known["Secret"] = objects.named("Secret", namespace) | MADE_BY_UP
        for kind, wanted in _named_by(pod):
            if wanted not in known[kind]:
                yield f"Deployment {name}: there is no {kind} {wanted}"
        volumes = {volume["name"] for volume in pod.get("volumes", [])}
        mounted = {mount["name"] for each in pod["containers"] for mount in each.get("volumeMounts", [])}
        if volumes != mounted:
            yield f"Deployment {name}: of volumes and mounts one is missing: {', '.join(sorted(volumes ^ mounted))}"


def _named_by(pod: Manifest) -> Iterator[tuple[str, str]]:
    """Kind and name of everything that a pod refers to."""
    for volume in pod.get("volumes", []):
        if "persistentVolumeClaim" in volume:
            yield "PersistentVolumeClaim", volume["persistentVolumeClaim"]["claimName"]
        if "configMap" in volume:
            yield "ConfigMap", volume["configMap"]["name"]
        if "secret" in volume:
            yield "Secret", volume["secret"]["secretName"]
    for container in pod["containers"]:
        for source in container.get("envFrom", []):
            yield "ConfigMap", source["configMapRef"]["name"]


def _peers(objects: Objects) -> Iterator[str]:
    found = {
        f"{each['metadata']['name']}.{each['metadata']['namespace']}.svc": port["port"]
        for each in objects.of("Service")
        for port in each["spec"]["ports"]
        if port["name"] == "dds" and each["spec"].get("publishNotReadyAddresses")
    }
    for each in (each for each in objects.of("ConfigMap") if each["metadata"]["name"] == "graph"):
        peers, domain = set(each["data"]["ROS_STATIC_PEERS"].split(";")), int(each["data"]["ROS_DOMAIN_ID"])
        for name in sorted(peers ^ set(found)):
            yield f"ROS_STATIC_PEERS and the Services differ: {name}"
        for name in sorted(name for name, port in found.items() if port != 7410 + 250 * domain):
            yield f"Service {name}: participant 0 of domain {domain} is not on port {found[name]}"
    ros = {
        (namespace, name) for namespace, name, labels, _ in objects.pods() if labels.get("sense4hri.org/ros") == "true"
    }
    for namespace, name in sorted(ros):
        if f"{name}.{namespace}.svc" not in found:
            yield f"Deployment {name} is in the graph and no peer"


def _containers(objects: Objects) -> Iterator[str]:
    for _, name, _, pod in objects.pods():
        for container in pod["containers"]:
            where = f"{name}, container {container['name']}"
            _, _, tag = container["image"].rpartition("/")[2].partition(":")
            if tag in ("", "latest"):
                yield f"{where}: the image {container['image']} has no tag of its own"
            for part in ("requests", "limits"):
                if not {"memory", "cpu"} <= container.get("resources", {}).get(part, {}).keys():
                    yield f"{where}: no {part} of memory and CPU"
            wanted = (
                ("startupProbe", "readinessProbe", "livenessProbe") if "ports" in container else ("readinessProbe",)
            )
            yield from (f"{where}: no {probe}" for probe in wanted if probe not in container)
            ports = {port["containerPort"] for port in container.get("ports", [])}
            probed = {container[probe]["httpGet"]["port"] for probe in wanted if "httpGet" in container.get(probe, {})}
            yield from (
                f"{where}: a probe asks port {port}, which is none of its own" for port in sorted(probed - ports)
            )


def _confinement(objects: Objects) -> Iterator[str]:
    """The restricted pod security standard, with a read-only root besides."""
    for _, name, _, pod in objects.pods():
        for key in ("hostNetwork", "hostPID", "hostIPC", "shareProcessNamespace"):
            if pod.get(key):
                yield f"{name}: {key}"
        if pod.get("automountServiceAccountToken") is not False or pod.get("enableServiceLinks") is not False:
            yield f"{name}: it is given a token of the cluster, or the addresses of all Services"
        context = pod.get("securityContext", {})
        if context.get("runAsNonRoot") is not True or not context.get("runAsUser"):
            yield f"{name}: it may run as root"
        if context.get("seccompProfile", {}).get("type") != "RuntimeDefault":
            yield f"{name}: no seccomp profile"
        for container in pod["containers"]:
            own = container.get("securityContext", {})
            if own.get("privileged") or own.get("allowPrivilegeEscalation") is not False:
                yield f"{name}: {container['name']} may become privileged"
            if own.get("capabilities") != {"drop": ["ALL"]} or own.get("readOnlyRootFilesystem") is not True:
                yield f"{name}: {container['name']} has capabilities, or may write its root"


def _machine(objects: Objects) -> Iterator[str]:
    """Only pods of a namespace apart see a folder of their machine, the one with D-Bus, and only in a sidecar."""
    key = "pod-security.kubernetes.io/enforce"
    levels = {each["metadata"]["name"]: each["metadata"]["labels"].get(key) for each in objects.of("Namespace")}
    for namespace, name, _, pod in objects.pods():
        folders = {each["name"]: each["hostPath"]["path"] for each in pod["volumes"] if "hostPath" in each}
        if levels.get(namespace) != ("privileged" if folders else "restricted"):
            yield f"{name}: its namespace {namespace} is {levels.get(namespace)}"
        yield from (
            f"{name}: it sees {path} of its machine" for path in sorted(set(folders.values()) - MACHINE_FOLDERS)
        )
        for mount in pod["containers"][0]["volumeMounts"]:
            if mount["name"] in folders:
                yield f"{name}: the service itself sees {folders[mount['name']]} of its machine"


def _policies(objects: Objects) -> Iterator[str]:
    for namespace in {namespace for namespace, *_ in objects.pods()}:
        own = [each for each in objects.of("NetworkPolicy") if each["metadata"]["namespace"] == namespace]
        if not any(each["spec"] == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]} for each in own):
            yield f"namespace {namespace}: what no policy allows is not forbidden"
        graph = {port["port"] for each in own for rule in each["spec"].get("ingress", []) for port in rule["ports"]}
        ports = {
            p["port"] for s in objects.of("Service") for p in s["spec"]["ports"] if p["name"] in ("dds", "metrics")
        }
        yield from (f"namespace {namespace}: nobody may reach port {port}" for port in sorted(ports - graph))
        for rule in (rule for each in own for way in ("ingress", "egress") for rule in each["spec"].get(way, [])):
            if not rule.get("ports"):
                yield f"namespace {namespace}: a policy opens every port"


def _volumes(objects: Objects) -> Iterator[str]:
    claims = {(each["metadata"]["namespace"], each["metadata"]["name"]) for each in objects.of("PersistentVolumeClaim")}
    used = {
        (namespace, volume["persistentVolumeClaim"]["claimName"])
        for namespace, _, _, pod in objects.pods()
        for volume in pod["volumes"]
        if "persistentVolumeClaim" in volume
    }
    yield from (f"PersistentVolumeClaim {name} is nobody's" for _, name in sorted(claims - used))
    held = {(v["spec"]["claimRef"]["namespace"], v["spec"]["claimRef"]["name"]) for v in objects.of("PersistentVolume")}
    if held and held != claims:
        yield f"of claims and volumes one is missing: {sorted(held ^ claims)}"
