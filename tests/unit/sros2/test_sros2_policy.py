"""The SROS 2 policy: an enclave for every service, and every topic of the contract with who may publish it."""

import fnmatch
import re
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "interfaces" / "sros2"))

import make_policy  # noqa: E402


def test_every_service_has_an_enclave() -> None:
    """And none is there of a service that is not."""
    enclaves = Xml.fromstring(make_policy.policy().partition("\n")[2]).iter("enclave")
    folders = {file.parents[1].name.replace("-", "_") for file in ROOT.glob("services/*/config/default.yaml")}
    assert {enclave.get("path") for enclave in enclaves} == {f"/sense4hri/{name}" for name in folders}


def test_every_topic_of_the_contract_has_its_publisher_and_assignments_one_alone() -> None:
    """Who may publish what the contract's tables name; replay, which plays everything, set aside."""
    text = (ROOT / "interfaces" / "CONTRACT.md").read_text().partition("## 2.")[2].partition("## 3.")[0]
    fields = re.findall(r"^\| `(\w+)` \|", text, re.M)
    topics = re.findall(r"^\| `/([^`]+)` \|", text, re.M)
    own = {node: make_policy.publishes(node) for node in make_policy.nodes() if node != "replay"}
    given = {node: (*names, *make_policy.EVERYBODY) for node, names in own.items()}
    assert {"raw", "features", "health"} <= set(fields)
    for topic in [f"humans/physiological/p1/ecg/h10_1/{field}" for field in fields] + topics:
        name = topic.replace("<human_id>", "p1")
        assert any(fnmatch.fnmatch(name, rule) for rules in given.values() for rule in rules), name
    alone = [node for node, rules in given.items() if any(fnmatch.fnmatch("study/assignments", r) for r in rules)]
    assert alone == ["metadata_registry"]
