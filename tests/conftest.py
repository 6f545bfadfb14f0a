"""Fixtures every kind of test shares."""

import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pytest
from processes import Process, Processes

if TYPE_CHECKING:  # the unit tests run without ROS
    from ears import Ears

ROOT = Path(__file__).resolve().parents[1]
FIRST_DOMAIN, DOMAINS = 30, 60
Node = TypeVar("Node", bound="Ears")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings beside the project; the test is skipped where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no real recordings: ../shared/data is absent")
    return folder


@pytest.fixture
def claim_domain() -> Iterator[Callable[[], int]]:
    """claim_domain() is a ROS domain that no other test has, until the end of this one."""
    claims: list[socket.socket] = []

    def claim() -> int:
        for number in range(DOMAINS):
            domain = FIRST_DOMAIN + (os.getpid() + number) % DOMAINS
            claims.append(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            try:
                claims[-1].bind(f"\0sense4hri-test-domain-{domain}")
            except OSError:
                claims.pop().close()
                continue
            return domain
        pytest.fail("no free ROS domain")

    yield claim
    for held in claims:
        held.close()


@pytest.fixture
def ros_domain(claim_domain: Callable[[], int], monkeypatch: pytest.MonkeyPatch) -> int:
    """A ROS domain of the test's own: no other test, nor a robot on the network, is heard."""
    domain = claim_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    monkeypatch.delenv("METRICS_PORT", raising=False)
    return domain


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
