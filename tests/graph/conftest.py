"""The virtual sensors, and the demo, that several files of this folder use."""

from collections.abc import Callable, Iterator
from pathlib import Path

import monitoring
import pytest
from demo_process import Demo
from sensor_bench_process import SILENT_DOMAIN, BenchProcess


@pytest.fixture(scope="module")
def bench_process(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchProcess]:
    """One bench, without its ROS side, for all tests of a file; with that file's `DEVICES` where it has them."""
    devices = {"devices": request.module.DEVICES} if hasattr(request.module, "DEVICES") else {}
    running = BenchProcess(tmp_path_factory.mktemp("bench"), SILENT_DOMAIN, ros4hri=False, **devices)
    try:
        yield running.until_ready()
        assert running.stop() == 0, running.log()
    finally:
        running.end()


@pytest.fixture
def bench(bench_process: BenchProcess, monkeypatch: pytest.MonkeyPatch) -> Iterator[BenchProcess]:
    """That bench at the D-Bus that bleak looks for; its links ended and its knobs turned back after each test."""
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", bench_process.address)
    yield bench_process
    bench_process.restore()


@pytest.fixture(scope="session")
def bin_folder() -> Path:
    found = monitoring.programs()
    if found is None:
        pytest.skip("no Prometheus and Alertmanager, installed or from Debian's packages")
    return found


@pytest.fixture
def demo(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Demo]]:
    """demo(*options) starts `make demo` with its recordings in tmp_path."""
    running: list[Demo] = []

    def begin(*options: str) -> Demo:
        running.append(Demo(tmp_path / "recordings", *options))
        return running[-1]

    yield begin
    for one in running:
        one.end()
