"""Fixtures every kind of test shares."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pytest
from hypothesis import HealthCheck, settings
from processes import Process, Processes, claimed_domain

if TYPE_CHECKING:  # the unit tests run without ROS
    from ears import Ears

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

ROOT = Path(__file__).resolve().parents[1]
Node = TypeVar("Node", bound="Ears")


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
