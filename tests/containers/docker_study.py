"""A study under `docker compose`, on free ports and under a name of its own, with an ear inside its network."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import study_file
import study_tokens
from monitoring import known
from wall_clock import WallClock

ROOT = Path(__file__).resolve().parents[2]
DOCKER = str(ROOT / "compose" / "docker.sh")
LISTENER = Path(__file__).with_name("listen.py")
COMMAND_S = 120.0
CLOCK_TICKS = os.sysconf("SC_CLK_TCK")


def docker(*arguments: str, seconds: float = COMMAND_S, check: bool = True, **environment: str) -> str:
    """Run a Docker command and return what it printed; AssertionError with its complaint where it fails."""
    done = subprocess.run(
        [DOCKER, *arguments], text=True, capture_output=True, timeout=seconds, check=False, env=os.environ | environment
    )
    assert not check or done.returncode == 0, f"docker {' '.join(arguments)}: {done.stderr}{done.stdout}"
    return done.stdout


class Study:
    """The study of this name, up from `start` to `stop`; volumes are removed by `remove`.

    more: further compose files that change it. machine: which of several it is. profiles: what is asked for of what
    runs when asked.
    """

    def __init__(self, name: str, *more: Path, machine: str = "", profiles: str = "") -> None:
        self.project = f"sense4hri-test-{os.getpid()}{machine}"
        file = study_file.find(name)
        (ROOT / "build").mkdir(exist_ok=True)
        own = study_tokens.folder(name, Path(tempfile.mkdtemp(prefix="tokens-", dir=ROOT / "build")))
        files = [file, study_tokens.overlay(study_tokens.taking(file, machine), own), *more]
        self._files = [word for file in files for word in ("-f", str(file))]
        self.tokens = {role: (own / role).read_text().strip() for role in study_tokens.ROLES}
        self._kept = own.parent
        ports = ("GUI_PORT", "REGISTRY_PORT", "PROMETHEUS_PORT", "ALERTMANAGER_PORT", "SESSION_PORT")
        self._settings = dict.fromkeys(ports, "0") | {"COMPOSE_PROFILES": profiles}
        self._listener: subprocess.Popen[str] | None = None
        self.started_s = 0.0
        self.seen: dict[str, dict[str, Any]] = {}
        self.first_s: dict[str, float] = {}  # topic -> wall time at which something of it was there

    def compose(self, *arguments: str, seconds: float = COMMAND_S) -> str:
        """Run docker compose on this study."""
        return docker("compose", "-p", self.project, *self._files, *arguments, seconds=seconds, **self._settings)

    def begin(self, service: str, *command: str) -> subprocess.Popen[str]:
        """Run a command in a service's container; its output is piped."""
        line = [DOCKER, "compose", "-p", self.project, *self._files, "exec", "-T", service, *command]
        return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def start(self, *services: str) -> None:
        """Up, as a researcher would, all services or these, and listen."""
        self.started_s = time.time()
        self.up(*services)
        command = [DOCKER, "run", "--rm", "--init", "--name", f"{self.project}-listener"]
        command += ["--network", f"{self.project}_default", "-v", f"{LISTENER}:/listen.py:ro"]
        command += ["--env", f"ROS_DOMAIN_ID={os.environ.get('ROS_DOMAIN_ID', '0')}"]  # compose.yaml takes the same
        command += ["sense4hri/base", "python", "/listen.py"]
        self._listener = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read, args=[self._listener.stdout], daemon=True)
        self._reader.start()

    def up(self, *services: str) -> None:
        """Start all services, or these."""
        self.compose("up", "--detach", "--no-build", "--pull", "never", *services)

    def _end_listener(self) -> None:
        docker("rm", "--force", f"{self.project}-listener", check=False)
        if self._listener is not None:
            self._listener.wait(30)
            self._reader.join(30)
            self._listener = None

    def _read(self, lines: IO[str]) -> None:
        with lines:
            for line in lines:
                self.seen = json.loads(line)
                for topic in [topic for topic, entry in self.seen.items() if entry["count"]]:
                    self.first_s.setdefault(topic, time.time())

    def stop(self) -> None:
        """Down, as a researcher would; the volumes stay."""
        self._end_listener()
        self.compose("down", "--timeout", "10")

    def remove(self) -> None:
        """Whatever is left of it."""
        self._end_listener()
        self.compose("down", "--volumes", "--timeout", "2")
        shutil.rmtree(self._kept, ignore_errors=True)

    def container(self, service: str) -> str:
        """The id of a service's container, running or not."""
        return self.compose("ps", "--all", "--quiet", service).strip()

    def healthy(self, service: str) -> bool:
        """True where its health check has passed."""
        return self.inspect(service)["State"]["Health"]["Status"] == "healthy"

    def services(self) -> list[str]:
        """Names of all services of the study."""
        return sorted(self.compose("config", "--services").split())

    def inspect(self, service: str) -> dict[str, Any]:
        """What Docker knows about a service's container."""
        return json.loads(docker("inspect", self.container(service)))[0]

    def published(self, service: str, port: int) -> str:
        """The http:// address on this machine of a service's port."""
        return f"http://{self.compose('port', service, str(port)).strip()}"

    def newest_s(self, topic: str) -> float:
        """header.stamp of the newest message on the topic, in s; 0 where nothing came."""
        return float(self.seen.get(topic, {}).get("stamp_s", 0.0))

    def count(self, topic: str) -> int:
        """Messages that came on the topic."""
        return int(self.seen.get(topic, {}).get("count", 0))

    def processes(self, service: str) -> list[int]:
        """Process ids, on this machine, of what a service runs below Docker's init."""
        rows = docker("top", self.container(service), "-eo", "pid,args").splitlines()[1:]
        return [int(row.split()[0]) for row in rows if "docker-init" not in row.split()[1]]

    def kill(self, service: str) -> None:
        """SIGKILL all of a service's container at once, as a power cut would; Docker is told to start it again."""
        docker("kill", self.container(service))
        docker("start", self.container(service))

    def knobs(self, sensor: str, **values: Any) -> None:
        """Turn the bench's knobs of one sensor, from inside the bench's container."""
        request = (
            "import sys, urllib.request as u;"
            "token = open('/run/secrets/operate').read().strip();"
            "told = {'Content-Type': 'application/json', 'Authorization': f'Bearer {token}'};"
            "u.urlopen(u.Request(sys.argv[1], sys.argv[2].encode(), told), timeout=30).read()"
        )
        url = f"http://127.0.0.1:9464/devices/{sensor}/knobs"
        docker("exec", self.container("sensor-bench"), "python", "-S", "-c", request, url, json.dumps(values))

    def copy_volume(self, volume: str, target: Path) -> None:
        """Copy a named volume of the study to this machine."""
        name = f"{self.project}-copy"
        docker("create", "--name", name, "-v", f"{self.project}_{volume}:/volume:ro", "sense4hri/base")
        try:
            docker("cp", f"{name}:/volume", str(target))
        finally:
            docker("rm", "--force", name)


def on_clock(folder: Path, services: Iterable[str]) -> tuple[WallClock, Path]:
    """Make a wall clock, and the compose file with which these services follow it, in a folder to be made."""
    folder.mkdir(mode=0o755)
    clock = WallClock(folder)
    environment = {name: value.replace(str(folder), "/wall_clock") for name, value in clock.env.items()}
    changed = {"environment": environment, "volumes": [f"{folder}:/wall_clock:ro"]}
    override = folder / "wall_clock.yaml"
    override.write_text(json.dumps({"services": dict.fromkeys(services, changed)}))
    return clock, override


def resident_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0


def cpu_s(pid: int) -> float:
    """CPU time a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / CLOCK_TICKS


def get(url: str, token: str = "") -> tuple[int, bytes]:
    """Status and body of a GET, with a token where one is given."""
    return _got(url, {"Authorization": f"Bearer {token}"} if token else {})


def watched(url: str, token: str) -> tuple[int, bytes]:
    """Status and body of a GET of Prometheus or Alertmanager, with a token as its password where one is given."""
    return _got(url, known(token) if token else {})


def _got(url: str, headers: dict[str, str]) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=30) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as err:
        with err:
            return err.code, err.read()


def post(url: str, fields: dict[str, Any], token: str = "") -> int:
    """Status of a POST of JSON, with a token where one is given."""
    headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {token}"} if token else {})
    try:
        with urllib.request.urlopen(
            urllib.request.Request(url, json.dumps(fields).encode(), headers), timeout=30
        ) as answer:
            return answer.status
    except urllib.error.HTTPError as err:
        with err:
            return err.code
