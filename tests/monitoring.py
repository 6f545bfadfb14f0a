"""A real Prometheus with the house's rules, and a real Alertmanager, as processes: for tests and benches.

The programs are Debian's: those installed, else those of its packages, unpacked once into build/prometheus.
"""

import json
import os
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


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Monitoring:
    """Prometheus with rules.yml as it is; it scrapes what `watch` says. webhook: address that alerts are sent to."""

    def __init__(self, folder: Path, bin_folder: Path, webhook: str = "") -> None:
        self._folder, self._bin = folder, bin_folder
        self._targets = folder / "targets.json"
        self.watch([])
        self._ended: list[subprocess.Popen[bytes]] = []
        managers = [f"127.0.0.1:{self._alertmanager(webhook)}"] if webhook else []
        port = free_port()
        self._address = f"http://127.0.0.1:{port}"
        (folder / "prometheus.yml").write_text(yaml.safe_dump(self._config(managers)))
        shutil.copy(CONFIG / "rules.yml", folder)
        self._start(
            "prometheus",
            f"--config.file={folder}/prometheus.yml",
            f"--storage.tsdb.path={folder}/tsdb",
            f"--web.listen-address=127.0.0.1:{port}",
        )
        try:
            poll(lambda: self._get("/-/ready"), "Prometheus is ready")
        except BaseException:
            self.close()
            raise

    def _config(self, managers: list[str]) -> dict[str, Any]:
        """prometheus.yml with addresses in place of the names that only Docker's DNS knows."""
        config: dict[str, Any] = yaml.safe_load((CONFIG / "prometheus.yml").read_text())
        config["scrape_configs"] = [
            {"job_name": "sense4hri", "file_sd_configs": [{"files": [str(self._targets)], "refresh_interval": "5s"}]}
        ]
        config["alerting"] = {"alertmanagers": [{"static_configs": [{"targets": managers}]}]}
        return config

    def _alertmanager(self, webhook: str) -> int:
        port = free_port()
        given = {
            "ALERT_WEBHOOK": webhook,
            "ALERTMANAGER_CONFIG": str(CONFIG / "alertmanager.yml"),
            "ALERTMANAGER_FOLDER": str(self._folder),
            "ALERTMANAGER_LISTEN": f"127.0.0.1:{port}",
            "PATH": f"{self._bin}:{os.environ['PATH']}",
        }
        self._start(str(ROOT / "compose" / "alertmanager" / "start.sh"), env=given, before=self._templates())
        return port

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
            with urllib.request.urlopen(f"{self._address}{path}", timeout=5) as answer:
                return answer.read().decode()
        except (urllib.error.URLError, OSError):
            return ""

    def _start(
        self, program: str, *words: str, env: Mapping[str, str] | None = None, before: Sequence[str] = ()
    ) -> None:
        path = program if "/" in program else str(self._bin / program)
        log = (self._folder / f"{Path(program).name}.log").open("w")
        with log:
            child = subprocess.Popen([*before, path, *words], stdout=log, stderr=log, env={**os.environ, **(env or {})})
        self._ended.append(child)

    def close(self) -> None:
        for child in self._ended:
            child.terminate()
        for child in self._ended:
            try:
                child.wait(10)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def about(labels: Mapping[str, str]) -> str:
    """Whom an alert is about."""
    return labels.get("sensor_id") or labels.get("service") or labels.get("instance", "")
