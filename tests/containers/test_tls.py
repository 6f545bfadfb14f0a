"""HTTPS before the page of a study in containers, as `make up TLS=127.0.0.1` starts it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import tls_checks
from docker_study import ROOT, Study, docker
from processes import wait_for


@pytest.fixture
def study(monkeypatch: pytest.MonkeyPatch) -> Iterator[Study]:
    monkeypatch.setenv("TLS_NAME", "127.0.0.1")
    monkeypatch.setenv("TLS_PORT", "0")
    monkeypatch.setenv("TLS_ADDRESS", "127.0.0.1")
    study = Study("demo", ROOT / "compose" / "tls.yaml")
    try:
        study.up("web-gui", "tls")
        yield study
    finally:
        study.remove()


def test_the_page_over_https(study: Study, tmp_path: Path) -> None:
    """The certificate is the lab's own, the cookie Secure, the WebSocket goes through, and no log has the token."""
    for service in ("web-gui", "tls"):
        wait_for(lambda name=service: study.healthy(name), 90, service)
    docker("cp", f"{study.container('tls')}:/certs/ca.crt", str(tmp_path / "ca.crt"))
    port = int(study.compose("port", "tls", "8443").strip().rpartition(":")[2])
    tls_checks.holds("127.0.0.1", port, tmp_path / "ca.crt", study.tokens["operate"])
    assert not any(token in study.compose("logs") for token in study.tokens.values())
    host = study.inspect("tls")["HostConfig"]
    assert (host["ReadonlyRootfs"], host["CapDrop"]) == (True, ["ALL"])
