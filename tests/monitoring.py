"""A real Prometheus with the house's rules, and a real Alertmanager, as processes: for tests and benches.

The programs are Debian's: those installed, else those of its packages, unpacked once into build/prometheus.
"""

import base64
import json
import os
import secrets
import shutil
import socket
import subprocess
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from processes import poll

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "compose" / "prometheus"
UNPACKED = ROOT / "build" / "prometheus"
PACKAGES = ("prometheus", "prometheus-alertmanager")
PROGRAMS = ("prometheus", "promtool", "prometheus-alertmanager", "amtool")


def programs() -> Path | None:
    """Return the folder of the programs, unpacked where they are not installed; None where apt has them not either."""
    installed = shutil.which(PROGRAMS[2])
    if installed and all(shutil.which(name) for name in PROGRAMS):
        return Path(installed).parent
    folder = UNPACKED / "usr" / "bin"
    if all((folder / name).exists() for name in PROGRAMS) or _unpack():
        return folder
    return None


def _unpack() -> bool:
    UNPACKED.mkdir(parents=True, exist_ok=True)
    got = subprocess.run(["apt-get", "-qq", "download", *PACKAGES], cwd=UNPACKED, capture_output=True, check=False)
    packages = sorted(UNPACKED.glob("*.deb"))
    if got.returncode != 0 or len(packages) < len(PACKAGES):
        return False
    return all(subprocess.run(["dpkg-deb", "-x", deb, UNPACKED], check=False).returncode == 0 for deb in packages)


def known(token: str, user: str = "study") -> dict[str, str]:
    """Return the header of who asks Prometheus, Alertmanager or Grafana as this user with this password."""
    return {"Authorization": f"Basic {base64.b64encode(f'{user}:{token}'.encode()).decode()}"}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Monitoring:
    """Prometheus with rules.yml as it is, started as in its image; it scrapes itself and what `watch` says.

    webhook: address that alerts are sent to, by an Alertmanager at the address `alertmanager`. Both ask for `token`,
    whose file and theirs are in a folder: one that is made, or the one given; "" is that of a study without tokens.
    """

    def __init__(self, folder: Path, bin_folder: Path, webhook: str = "", token: str | None = None) -> None:
        self.folder, self._bin = folder, bin_folder
        self.token = secrets.token_urlsafe(32) if token is None else token
        if self.token:
            (folder / "view").write_text(f"{self.token}\n")
        self._targets = folder / "targets.json"
        self.watch([])
        self.children: list[subprocess.Popen[bytes]] = []
        self.alertmanager = self._alertmanager(webhook) if webhook else ""
        listens = f"127.0.0.1:{free_port()}"
        self.address = f"http://{listens}"
        (folder / "prometheus.yml").write_text(yaml.safe_dump(self._config(listens)))
        shutil.copy(CONFIG / "rules.yml", folder)
        given = {"CONFIG": f"{folder}/prometheus.yml", "FOLDER": f"{folder}/tsdb", "LISTEN": listens}
        self._start(CONFIG / "start.sh", {f"PROMETHEUS_{name}": value for name, value in given.items()})
        try:
            poll(lambda: self._get("/-/ready"), "Prometheus is ready")
        except BaseException:
            self.close()
            raise

    def _config(self, own: str) -> dict[str, Any]:
        """prometheus.yml with what is here in place of names that only Docker's DNS knows, and of the token's file."""
        text = (CONFIG / "prometheus.yml").read_text()
        config: dict[str, Any] = yaml.safe_load(text.replace("/run/secrets/view", f"{self.folder}/view"))
        (services, itself), (managers,) = config["scrape_configs"], config["alerting"]["alertmanagers"]
        del services["dns_sd_configs"], managers["dns_sd_configs"]
        services["file_sd_configs"] = [{"files": [str(self._targets)], "refresh_interval": "5s"}]
        itself["static_configs"] = [{"targets": [own]}]
        managers["static_configs"] = [
            {"targets": [self.alertmanager.removeprefix("http://")] * bool(self.alertmanager)}
        ]
        return config

    def _alertmanager(self, webhook: str) -> str:
        listens = f"127.0.0.1:{free_port()}"
        given = {
            "ALERT_WEBHOOK": webhook,
            "ALERTMANAGER_CONFIG": str(CONFIG / "alertmanager.yml"),
            "ALERTMANAGER_FOLDER": str(self.folder),
            "ALERTMANAGER_LISTEN": listens,
        }
        self._start(ROOT / "compose" / "alertmanager" / "start.sh", given, self._templates())
        return f"http://{listens}"

    def _templates(self) -> list[str]:
        """Return what comes before the command: Debian's Alertmanager looks for its templates in /usr/share alone."""
        where = Path("/usr/share/prometheus/alertmanager")
        if where.exists():
            return []
        there = f"mount -t tmpfs none /usr/share && mkdir -p {where.parent} && cp -r {UNPACKED}{where} {where.parent}"
        return ["unshare", "--map-root-user", "--mount", "sh", "-c", f'{there} && exec "$0" "$@"']

    def watch(self, ports: Iterable[int]) -> None:
        """Scrape these ports of this machine from now on."""
        fresh = self._targets.with_suffix(".new")
        fresh.write_text(json.dumps([{"targets": [f"127.0.0.1:{port}" for port in ports]}]))
        fresh.rename(self._targets)

    def firing(self) -> set[tuple[str, str]]:
        """Name of every alert that fires, and which sensor, service or instance it is about."""
        answer = self._get("/api/v1/alerts")
        alerts = json.loads(answer)["data"]["alerts"] if answer else []
        return {(one["labels"]["alertname"], about(one["labels"])) for one in alerts if one["state"] == "firing"}

    def query(self, expression: str) -> list[dict[str, Any]]:
        return self.answer(f"/api/v1/query?{urllib.parse.urlencode({'query': expression})}")["result"]

    def answer(self, path: str) -> Any:
        """Return what Prometheus answers to a path of its API."""
        return json.loads(self._get(path))["data"]

    def _get(self, path: str) -> str:
        try:
            asked = urllib.request.Request(f"{self.address}{path}", headers=known(self.token))
            with urllib.request.urlopen(asked, timeout=5) as answer:
                return answer.read().decode()
        except (urllib.error.URLError, OSError):
            return ""

    def _start(self, script: Path, given: Mapping[str, str], before: Sequence[str] = ()) -> None:
        """Start what a script of the images starts. given: its variables."""
        here = {
            "PATH": f"{self._bin}:{CONFIG}:{os.environ['PATH']}",
            "SENSE4HRI_VIEW_TOKEN_FILE": f"{self.folder}/view",
            "TMPDIR": str(self.folder),
        }
        with (self.folder / f"{script.parent.name}.log").open("w") as log:
            child = subprocess.Popen([*before, script], stdout=log, stderr=log, env={**os.environ, **here, **given})
        self.children.append(child)

    def close(self) -> None:
        for child in self.children:
            child.terminate()
        for child in self.children:
            try:
                child.wait(10)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def about(labels: Mapping[str, str]) -> str:
    """Whom an alert is about."""
    return labels.get("sensor_id") or labels.get("service") or labels.get("instance", "")
