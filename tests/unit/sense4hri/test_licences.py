"""What the default images install besides ROS, and under which licences."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[3]
GPL = re.compile(r"(?<!L)GPL|(?<!Lesser )General Public License|Affero|UNKNOWN", re.I)
SAYS_NOTHING = {"setuptools": "MIT", "brainflow": "MIT"}


def licence(found):
    """The licence a package declares: SPDX expression, else classifiers, else the first line of the old field."""
    about = found.metadata
    classifiers = [line for line in about.get_all("Classifier") or [] if line.startswith("License ::")]
    said = about.get("License-Expression") or "; ".join(classifiers) or (about.get("License") or "").partition("\n")[0]
    return said or SAYS_NOTHING.get(canonicalize_name(found.name), "UNKNOWN")


def installed():
    """Every package that the services need, by name, with what its distribution says."""
    waiting = []
    for file in [*ROOT.glob("services/*/pyproject.toml"), ROOT / "interfaces" / "sense4hri" / "pyproject.toml"]:
        waiting += tomllib.loads(file.read_text("utf-8"))["project"].get("dependencies", [])
    found = {}
    while waiting:
        wanted = Requirement(waiting.pop())
        name = canonicalize_name(wanted.name)
        if name in found or (wanted.marker is not None and not wanted.marker.evaluate({"extra": ""})):
            continue
        found[name] = metadata.distribution(name)
        waiting += found[name].requires or []
    return found


def test_no_image_has_a_package_under_the_gpl():
    """Whatever the services need declares a licence, and none is the GPL or AGPL (libusb1 is LGPL)."""
    found = {name: licence(package) for name, package in installed().items()}
    assert {"numpy", "pyedflib", "pyarrow", "mcap"} <= set(found)
    assert {name: said for name, said in found.items() if GPL.search(said)} == {}
