"""What the images are made of."""

import json
from pathlib import Path

import pytest
from docker_study import ROOT, docker

DEBIAN, BASE = "debian:bookworm-slim", "sense4hri/base"
LARGEST_BASE_MB = 300
SERVICES = sorted(path.parent.name for path in (ROOT / "services").glob("*/pyproject.toml"))
LICENCES = """
import importlib.metadata, json, re
found = {}
for distribution in importlib.metadata.distributions():
    data = distribution.metadata
    text = " | ".join([data.get("License-Expression") or (data.get("License") or "")[:60],
                       *[c for c in data.get_all("Classifier") or [] if c.startswith("License")]])
    if re.search(r"(?<!L)(?<!Lesser )(A?GPL|General Public)", text.replace("Lesser General", "Lesser-General")):
        found[data["Name"]] = text
print(json.dumps(found))
"""
TOOLS = ("gcc", "g++", "cc", "make", "pip", "uv", "curl", "wget")


def size_mb(image: str) -> float:
    return json.loads(docker("image", "inspect", image))[0]["Size"] / 1e6


def inside(image: str, *command: str) -> str:
    return docker("run", "--rm", "--network", "none", "--entrypoint", command[0], image, *command[1:])


def test_base_image_is_small():
    """The base image is at most 300 MB above its Debian base."""
    above_mb = size_mb(BASE) - size_mb(DEBIAN)
    print(f"base image: {above_mb:.0f} MB above {DEBIAN}")
    assert above_mb <= LARGEST_BASE_MB


@pytest.mark.parametrize("image", [BASE, *(f"sense4hri/{name}" for name in SERVICES)])
def test_image_has_a_user_and_no_tools(image):
    """Every image runs as a user who is not root, owns nothing of its program, and holds no compiler or installer."""
    config = json.loads(docker("image", "inspect", image))[0]["Config"]
    assert config["User"] == "sense4hri"
    assert config["Healthcheck"]["Test"] == ["CMD", "ready"]
    tools = " ".join(TOOLS)
    assert inside(image, "bash", "-c", f"for tool in {tools}; do command -v $tool; done; true").strip() == ""
    found = inside(image, "bash", "-c", r"find / -xdev -regex '.*/\(pip\|pip-.*\|install-service\)' 2>/dev/null; true")
    assert found.strip() == ""
    written = inside(image, "bash", "-c", "find /opt/sense4hri /usr -writable ! -type l 2>/dev/null | head -n 3")
    assert written.strip() == ""


@pytest.mark.parametrize("name", SERVICES)
def test_no_gpl_package_in_the_image(name):
    """No Python package of a service's image is under the GPL; its licences come from the package metadata."""
    assert json.loads(inside(f"sense4hri/{name}", "python", "-c", LICENCES)) == {}


def test_no_build_secret_in_a_layer():
    """Neither certificates nor addresses of the building machine are in the base image."""
    assert inside(BASE, "bash", "-c", "ls -A /run/secrets 2>/dev/null || true").strip() == ""
    history = docker("history", "--no-trunc", BASE)
    assert "PIP_INDEX_URL=http" not in history
    assert Path("/usr/local/share/ca-certificates").as_posix() not in history
