"""The certificate of a lab, and the page behind nginx where nginx is installed."""

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import tls_checks
from processes import poll

TLS = Path(__file__).resolve().parents[3] / "compose" / "tls"
NGINX = shutil.which("nginx")
PAGE = """
import asyncio, sys
from sense4hri.access import Access
from web_gui.config import Config
from web_gui.model import Study
from web_gui.server import Site, serve

async def main():
    site = Site(Study(), config := Config(port=0), access=Access("0.0.0.0", "may-operate", "may-view"))
    runner, port = await serve(site, config)
    print(port, flush=True)
    await asyncio.Event().wait()

asyncio.run(main())
"""


def certificate(folder: Path, name: str) -> str:
    folder.mkdir(exist_ok=True)
    done = subprocess.run([TLS / "certificate", folder, name], capture_output=True, text=True, check=True)
    return done.stderr


def certifies(folder: Path, option: str, name: str) -> bool:
    """Whether OpenSSL takes the certificate for this name, by the CA beside it."""
    command = ["openssl", "verify", "-CAfile", folder / "ca.crt", option, name, folder / "server.crt"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def test_a_certificate_is_made_once_and_anew_for_another_name(tmp_path: Path) -> None:
    """It holds for its name and not for others; the CA stays the same; keys are their owner's alone."""
    folder = tmp_path / "certs"
    assert "a certificate for lab.example.org" in certificate(folder, "lab.example.org")
    first = (folder / "server.crt").read_bytes()
    authority = (folder / "ca.crt").read_bytes()
    assert certifies(folder, "-verify_hostname", "lab.example.org")
    assert not certifies(folder, "-verify_hostname", "evil.example.org")
    assert certificate(folder, "lab.example.org") == ""
    assert (folder / "server.crt").read_bytes() == first
    for address in ("192.168.1.20", "2001:db8::20"):
        certificate(folder, address)
        assert certifies(folder, "-verify_ip", address)
        assert certificate(folder, address) == ""
    assert (folder / "ca.crt").read_bytes() == authority
    assert all((folder / name).stat().st_mode & 0o077 == 0 for name in ("ca.key", "server.key"))


def test_a_certificate_of_ones_own_is_left_alone(tmp_path: Path) -> None:
    """Without the CA's key beside it nothing in the folder is changed, whatever the name."""
    certificate(tmp_path / "lab", "lab.example.org")
    own = tmp_path / "own"
    own.mkdir()
    for name in ("server.crt", "server.key"):
        shutil.copy(tmp_path / "lab" / name, own)
    before = {path.name: path.read_bytes() for path in own.iterdir()}
    assert certificate(own, "other.example.org") == ""
    assert {path.name: path.read_bytes() for path in own.iterdir()} == before


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
@pytest.mark.parametrize(
    ("given", "name", "page"),
    [
        ("lab.example.org", "lab.example.org", "https://lab.example.org:8443"),
        ("::1", "::1", "https://[::1]:8443"),
        ("[2001:db8::20]", "2001:db8::20", "https://[2001:db8::20]:8443"),
    ],
)
def test_the_page_is_told_with_an_address_that_browsers_take(given: str, name: str, page: str) -> None:
    """`make up TLS=` an IPv6 address, in brackets or not: the certificate's name has none, the page's address has."""
    shown = "include Makefile\nshow: ; @echo $(TLS_NAME) $(PAGE)\n"
    command = ["make", "-s", "-f", "-", "show", f"TLS={given}"]
    told = subprocess.run(command, cwd=TLS.parents[1], input=shown, capture_output=True, text=True, check=True)
    assert told.stdout.split() == [name, page]


@pytest.fixture
def page(tmp_path: Path) -> Iterator[int]:
    """The port of a page that needs tokens."""
    with subprocess.Popen([sys.executable, "-c", PAGE], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield int(process.stdout.readline())
        process.kill()


@pytest.mark.skipif(NGINX is None, reason="no nginx on this machine; tests/containers has it in its image")
def test_the_page_over_https(tmp_path: Path, page: int) -> None:
    """Certified by the lab's CA alone; cookie Secure; the WebSocket goes through; foreign pages do not."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (tmp_path / "certs").mkdir()
    own = {"TLS_NAME": "127.0.0.1", "CERTS": str(tmp_path / "certs"), "PAGE": f"127.0.0.1:{page}", "PORT": str(port)}
    own |= {"SCRATCH": str(tmp_path), "CONFIG": str(TLS / "nginx.conf")}
    with subprocess.Popen([TLS / "start"], env=os.environ | own, stderr=subprocess.PIPE, text=True) as nginx:
        try:
            poll(lambda: answers(port), "nginx answers")
            tls_checks.holds("127.0.0.1", port, tmp_path / "certs" / "ca.crt", "may-operate")
        finally:
            nginx.send_signal(signal.SIGTERM)
        said = nginx.stderr.read() if nginx.stderr else ""
    assert "may-operate" not in said
    assert not any("may-operate" in path.read_text() for path in tmp_path.iterdir() if path.is_file())


def answers(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 1).close()
    except OSError:
        return False
    return True
