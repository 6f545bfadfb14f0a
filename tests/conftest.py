"""Fixtures every kind of test shares."""

import os
import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pytest
from processes import Process, Processes, claimed_domain

if TYPE_CHECKING:  # the unit tests run without ROS
    from ears import Ears

ROOT = Path(__file__).resolve().parents[1]
Node = TypeVar("Node", bound="Ears")
LAST_WORDS = 6000
"""Characters of each log."""


def pytest_pycollect_makemodule(module_path: Path) -> None:
    """Before a file with drawn examples is imported, have them drawn alike on any machine.

    Importing hypothesis takes longer than many files take to run, so those do without it that draw none.
    """
    if "hypothesis" in module_path.read_text(encoding="utf-8"):
        _draw_alike()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Where nothing is drawn, put the plugin of hypothesis away, which imports hypothesis for its last words."""
    plugins = session.config.pluginmanager
    if "hypothesis" not in sys.modules and plugins.has_plugin("hypothesispytest"):
        plugins.unregister(name="hypothesispytest")


@cache
def _draw_alike() -> None:
    from hypothesis import HealthCheck, settings

    slow = [HealthCheck.too_slow]
    settings.register_profile("any machine", derandomize=True, deadline=None, suppress_health_check=slow)
    settings.load_profile("any machine")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Beside a failure stand the machine's load, the ROS domain and what the processes of the test said last."""
    report = yield
    if report.failed:
        fixtures = list(getattr(item, "funcargs", {}).values())
        environment = next((each.environment for each in fixtures if hasattr(each, "environment")), os.environ)
        load = ", ".join(f"{load:.1f}" for load in os.getloadavg())
        report.sections.append(("Machine", f"ROS_DOMAIN_ID={environment.get('ROS_DOMAIN_ID')}, load {load}"))
        for log in sorted(_logs(fixtures)):
            report.sections.append((f"Log {log.name}", log.read_text(errors="replace")[-LAST_WORDS:]))
    return report


def _logs(fixtures: Iterable[object]) -> set[Path]:
    """Logs in the folders that a test has been given, as such or as the `folder` of what it uses."""
    places = [each if isinstance(each, Path) else getattr(each, "folder", None) for each in fixtures]
    return {log for place in places if isinstance(place, Path) for log in place.glob("*.log")}


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings beside the project; the test is skipped where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no real recordings: ../shared/data is absent")
    return folder


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain of the test's own: no other test, nor a robot on the network, is heard."""
    with claimed_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
        monkeypatch.delenv("METRICS_PORT", raising=False)
        yield domain


@pytest.fixture
def start(request: pytest.FixtureRequest, ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """start("interpreter_ecg", env={}, **parameters) runs a module, or a script beside the test, until its end."""
    processes = Processes(tmp_path, request.path.parent)
    yield processes.start
    processes.close()


@pytest.fixture
def opened(ros_domain: int) -> Iterator[Callable[[Node], Node]]:
    """opened(Ears("name")) returns the node and closes it after the test, the last one first."""
    nodes: list[Ears] = []

    def keep(node: Node) -> Node:
        nodes.append(node)
        return node

    yield keep
    for node in reversed(nodes):
        node.close()


@pytest.fixture
def ears(opened: "Callable[[Ears], Ears]") -> "Ears":
    """A node of the test's own that listens."""
    from ears import Ears

    return opened(Ears())
