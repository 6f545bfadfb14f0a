"""Reading, export and report are cut so that nobody carries what he does not need."""

import importlib.machinery
import importlib.util
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"pandas", "pyarrow", "scipy", "pyedflib"}


def image_tool() -> ModuleType:
    """interfaces/image/install-service, which decides what is installed into a service's image."""
    path = ROOT / "interfaces" / "image" / "install-service"
    loader = importlib.machinery.SourceFileLoader("install_service", str(path))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def in_image(service: str) -> set[str]:
    """Every locked package that the image of a service gets."""
    tool = image_tool()
    project = tomllib.loads((ROOT / "services" / service / "pyproject.toml").read_text())["project"]
    wanted = tool.published([tool.normal(text) for text in project["dependencies"]])
    selected = tool.select(wanted, ROOT / "requirements.lock")
    return {tool.normal(line) for line in selected.splitlines() if line[:1] not in " "}


@pytest.mark.parametrize("service", ["recorder", "replay"])
def test_no_analysis_library_is_in_the_image(service):
    """What a recorder or a replay declares, and all that requires, holds no pandas, pyarrow, scipy or pyedflib."""
    found = in_image(service)
    assert {"mcap", "rosbags", "zstandard"} <= found
    assert found & HEAVY == set()


def test_analysis_has_them_all():
    """The same look finds them where they belong, so that it can see them at all."""
    assert in_image("analysis") >= HEAVY
