"""Prints the SROS 2 policy of a study: an enclave per service, with what each may publish and ask (docs/sros2.md).

    python interfaces/sros2/make_policy.py > policy.xml

Everybody of the study may read everything, nobody else anything. Who may *say* what is the table below,
by node; names are those of the contract, `*` stands for any part of a name. Never run: see the page.
"""

import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree as Xml

ROOT = Path(__file__).resolve().parents[2]
STREAM = "humans/physiological/*/*/*/"
EVERYBODY = ("rosout", "parameter_events", "diagnostics", "study/ack")
PARAMETERS = ("get_parameters", "list_parameters", "describe_parameters", "get_parameter_types")
SETTING = ("set_parameters", "set_parameters_atomically")
DRIVER = (STREAM + "raw", STREAM + "device", STREAM + "health", STREAM + "clock_measurement", "study/markers")
INTERPRETER = (STREAM + "features",)
PUBLISH = {
    "clock_sync": (STREAM + "clock", "study/clock_probes", "study/host_clocks"),
    "fusion_affect": ("humans/physiological/*/state",),
    "metadata_registry": ("study/sensors", "study/assignments"),
    "session_coordinator": ("study/session", "study/markers"),
    "web_gui": ("study/markers",),
    "recorder": (),
    "replay": ("*",),
    "bridge_lsl": (),
    "sensor_bench": ("humans/faces/*", "humans/persons/*"),
}
SERVE = {
    "metadata_registry": ("study/list_sensors", "study/assign_sensor"),
    "session_coordinator": ("study/start_session", "study/stop_session"),
}
ASK = {"web_gui": ("study/list_sensors", "study/assign_sensor", "study/start_session", "study/stop_session")}
SETS = ("metadata_registry",)
"""Who may set parameters of others: it moves a driver's topics to another person."""


def nodes() -> list[str]:
    """Every service that is a node, by its package's name."""
    projects = [tomllib.loads(file.read_text()) for file in sorted(ROOT.glob("services/*/pyproject.toml"))]
    kinds = {one["project"]["name"]: one.get("tool", {}).get("sense4hri", {}).get("kind") for one in projects}
    return [name for name, kind in kinds.items() if kind != "commands"]


def publishes(node: str) -> tuple[str, ...]:
    """Return what a node may publish beside what everybody may. Raises KeyError for one that nobody has thought of."""
    kinds = {"driver": DRIVER, "interpreter": INTERPRETER}
    return kinds.get(node.partition("_")[0]) or PUBLISH[node]


def policy() -> str:
    """Return the policy, in the form of `ros2 security` (version 0.2.0)."""
    root = Xml.Element("policy", version="0.2.0")
    enclaves = Xml.SubElement(root, "enclaves")
    for node in nodes():
        enclave = Xml.SubElement(enclaves, "enclave", path=f"/sense4hri/{node}")
        profiles = Xml.SubElement(enclave, "profiles")
        # the node of a driver is called driver_<kind>_<sensor_id>, of a clock-sync on another host clock_sync_<host>
        _profile(Xml.SubElement(profiles, "profile", ns="/", node=f"{node}*"), node)
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _profile(profile: Xml.Element, node: str) -> None:
    _rules(profile, "topics", "subscribe", "topic", ("*",))
    _rules(profile, "topics", "publish", "topic", (*EVERYBODY, *publishes(node)))
    own = tuple(f"{node}*/{name}" for name in (*PARAMETERS, *SETTING))
    _rules(profile, "services", "reply", "service", (*own, *SERVE.get(node, ())))
    asked = tuple(f"*/{name}" for name in (*PARAMETERS, *(SETTING if node in SETS else ())))
    _rules(profile, "services", "request", "service", (*asked, *ASK.get(node, ())))


def _rules(profile: Xml.Element, group: str, right: str, kind: str, names: tuple[str, ...]) -> None:
    rules = Xml.SubElement(profile, group, {right: "ALLOW"})
    for name in names:
        Xml.SubElement(rules, kind).text = f"/{name}" if name != "*" else name


if __name__ == "__main__":
    sys.stdout.write(policy())
