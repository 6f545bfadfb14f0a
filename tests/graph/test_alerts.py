"""An alert on its whole way: a metric, a real Prometheus with the house's rules, a real Alertmanager, a webhook."""

import json
import os
import subprocess
import threading
import urllib.request
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
import yaml
from monitoring import CONFIG, ROOT, Monitoring, known
from processes import poll

START = ROOT / "compose" / "alertmanager" / "start.sh"
SILENT, STREAMING = 3, 2


class Both(ThreadingHTTPServer):
    """A service's /metrics, with one stream whose state the test sets, and the webhook's receiver."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.state, self.told = STREAMING, list[dict[str, Any]]()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def heard(self, status: str) -> bool:
        """True where the webhook has got StreamSilent with this status."""
        alerts = [alert for message in self.told for alert in message["alerts"]]
        return any(a["status"] == status and a["labels"]["alertname"] == "StreamSilent" for a in alerts)


class Answer(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        labels = 'service="driver_polar",sensor_type="ecg",sensor_id="h10_1"'
        self._answer(f"sense4hri_stream_state{{{labels}}} {self.server.state}\n".encode())

    def do_POST(self) -> None:
        self.server.told.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self._answer(b"")

    def _answer(self, body: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/plain; version=0.0.4")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *given: object) -> None: ...


@pytest.fixture
def server() -> Iterator[Both]:
    both = Both()
    yield both
    both.shutdown()
    both.server_close()


def test_a_firing_alert_reaches_the_webhook_and_so_does_its_end(bin_folder, server, tmp_path):
    """A stream that falls silent is told to ALERT_WEBHOOK, with its sentence, and again when it is back."""
    watch = Monitoring(tmp_path, bin_folder, f"http://127.0.0.1:{server.server_port}/hook")
    try:
        watch.watch([server.server_port])
        poll(lambda: watch.query("sense4hri_stream_state == 2"), "the stream is scraped")
        assert watch.firing() == set()
        server.state = SILENT
        poll(lambda: server.heard("firing"), "the webhook is told")
        assert ("StreamSilent", "h10_1") in watch.firing()
        alerts = urllib.request.Request(f"{watch.alertmanager}/api/v2/alerts", headers=known(watch.token))
        with urllib.request.urlopen(alerts, timeout=10) as answer:
            assert "StreamSilent" in {alert["labels"]["alertname"] for alert in json.load(answer)}
        summary = server.told[0]["alerts"][0]["annotations"]["summary"]
        assert summary == "ecg of h10_1 is silent: its link is lost, or the device sends nothing"
        server.state = STREAMING
        poll(lambda: server.heard("resolved"), "the webhook is told of the end")
        assert watch.firing() == set()
    finally:
        watch.close()


def test_configurations_are_what_their_own_tools_take(bin_folder):
    """amtool and promtool find nothing wrong, also with the e-mail example filled in."""
    given = (CONFIG / "alertmanager.yml").read_text()
    with_mail = "\n".join(
        line.replace("  # ", "  ", 1) if line.startswith("  # ") else line for line in given.splitlines()
    )
    assert "email_configs" in with_mail
    for text in (given, with_mail):
        done = subprocess.run(
            [bin_folder / "amtool", "check-config", "/dev/stdin"],
            input=text,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    config = [bin_folder / "promtool", "check", "config", "--syntax-only", CONFIG / "prometheus.yml"]
    rules = [bin_folder / "promtool", "test", "rules", CONFIG / "rules_test.yml"]
    for command in (config, rules):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("address", ["ftp://x/", 'http://x/"', "lab"])
def test_a_wrong_webhook_is_named_at_the_start(tmp_path, address):
    """Status 78 and a sentence with the name of the variable; nothing is started."""
    given = {
        "ALERT_WEBHOOK": address,
        "ALERTMANAGER_CONFIG": str(CONFIG / "alertmanager.yml"),
        "ALERTMANAGER_FOLDER": str(tmp_path),
    }
    done = subprocess.run([START], env=os.environ | given, capture_output=True, text=True, check=False)
    assert done.returncode == 78
    assert done.stderr.startswith("ALERT_WEBHOOK must ")


def test_the_webhook_is_asked_at_the_address_as_it_was_given(tmp_path):
    """Signs that mean something to sed, as the & between two parameters, are part of the address."""
    address = "https://lab.example.org/hook?study=pilot&token=a\\1b"
    (tmp_path / "prometheus-alertmanager").write_text("#!/bin/sh\n")
    (tmp_path / "prometheus-alertmanager").chmod(0o755)
    (tmp_path / "view").write_text("of-this-test")
    given = {
        "ALERT_WEBHOOK": address,
        "ALERTMANAGER_CONFIG": str(CONFIG / "alertmanager.yml"),
        "ALERTMANAGER_FOLDER": str(tmp_path),
        "SENSE4HRI_VIEW_TOKEN_FILE": f"{tmp_path}/view",
        "TMPDIR": str(tmp_path),
        "PATH": f"{tmp_path}:{CONFIG}:{os.environ['PATH']}",
    }
    subprocess.run([START], env=given, check=True)
    receivers = yaml.safe_load((tmp_path / "alertmanager.yml").read_text())["receivers"]
    assert [hook["url"] for one in receivers for hook in one.get("webhook_configs", ())] == [address]
