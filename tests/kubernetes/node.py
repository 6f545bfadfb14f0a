"""The test cluster of k8s/cluster/node.sh from outside of its namespaces: its kubectl, its images, its files."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from cluster_cache import CACHE, KUBECTL
from processes import wait_for

ROOT = Path(__file__).resolve().parents[2]
DOCKER = ROOT / "compose" / "docker.sh"
PAUSE = 'CMD ["bash", "-c", "trap exit TERM; sleep infinity & wait"]'
"""Of the container that holds a pod's addresses; one that ignored SIGTERM would keep a deleted pod for a minute."""

POST = """
import http.client, sys
address, path, token, body = sys.argv[1:]
told = {"Content-Type": "application/json", "Authorization": f"Bearer {token}"}
link = http.client.HTTPConnection(address, 9464, timeout=30)
link.request("POST", path, body, told)
print(link.getresponse().status)
"""


class Node:
    """One cluster, from `start` to `close`; folder: empty, for logs, removed by `close`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._launcher: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Begin it; returns once its API server and its Docker answer."""
        with (self.folder / "node.log").open("wb") as log:
            script = ROOT / "k8s" / "cluster" / "node.sh"
            self._launcher = subprocess.Popen([script, CACHE, self.folder], stdout=log, stderr=log)
        wait_for(lambda: self._answers(self.docker("version", check=False)), 60, "the node's Docker answers")
        wait_for(lambda: self._answers(self.kubectl("get", "--raw", "/readyz", check=False)), 180, "the API is ready")

    def _answers(self, done: "subprocess.CompletedProcess[str]") -> bool:
        assert self._launcher is not None
        assert self._launcher.poll() is None, f"the node has ended:\n{self.log('node')}"
        return done.returncode == 0

    @property
    def _init(self) -> str:
        """The process whose namespaces are the node's."""
        assert self._launcher is not None
        pid = self._launcher.pid
        return wait_for(lambda: Path(f"/proc/{pid}/task/{pid}/children").read_text().split(), 20, "the node begins")[0]

    def path(self, inside: str) -> Path:
        """Where a path of the node is seen from here."""
        return Path(f"/proc/{self._init}/root{inside}")

    def log(self, name: str, lines: int = 20) -> str:
        """The end of the log of one of its programs."""
        return "\n".join((self.folder / f"{name}.log").read_text(errors="replace").splitlines()[-lines:])

    def inside(
        self, *command: str | Path, check: bool = True, seconds: float = 120.0
    ) -> "subprocess.CompletedProcess[str]":
        """Run a command in the node's namespaces of files and network; its output is text."""
        line = ["nsenter", f"--target={self._init}", "--net", "--mount", *command]
        return _run(line, check, seconds)

    def kubectl(
        self, *words: str | Path, check: bool = True, seconds: float = 120.0
    ) -> "subprocess.CompletedProcess[str]":
        return self.inside(KUBECTL, "--kubeconfig", self.folder / "admin.conf", *words, check=check, seconds=seconds)

    def docker(self, *words: str, check: bool = True, seconds: float = 120.0) -> "subprocess.CompletedProcess[str]":
        return _run([DOCKER, "--host", f"unix://{self.path('/run/docker.sock')}", *words], check, seconds)

    def load(self, images: set[str], base: str) -> None:
        """Copy images from the Docker Engine that answers here, all their layers once, and make the pause image."""
        with subprocess.Popen([DOCKER, "save", *sorted(images)], stdout=subprocess.PIPE) as saving:
            self.docker_from(saving, "load", "--quiet")
        assert saving.returncode == 0, f"docker save {' '.join(sorted(images))} failed: make images"
        made = self.docker("create", base).stdout.strip()
        self.docker("commit", "--change", PAUSE, made, "sense4hri/pause:1")
        self.docker("rm", made)

    def docker_from(self, source: "subprocess.Popen[bytes]", *words: str) -> None:
        """Run a Docker command that reads what another process writes."""
        line = [DOCKER, "--host", f"unix://{self.path('/run/docker.sock')}", *words]
        done = subprocess.run(line, stdin=source.stdout, capture_output=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr.decode()

    def with_kubectl(self) -> dict[str, str]:
        """The environment in which `kubectl` is that of this node."""
        words = f"nsenter --target={self._init} --net {KUBECTL} --kubeconfig {self.folder}/admin.conf"
        wrapper = self.folder / "outside" / "kubectl"
        wrapper.parent.mkdir(exist_ok=True)
        wrapper.write_text(f'#!/bin/sh\nexec {words} "$@"\n')
        wrapper.chmod(0o755)
        return {**os.environ, "PATH": f"{wrapper.parent}:{os.environ['PATH']}"}

    def get(self, kind: str, namespace: str, *words: str) -> list[dict[str, Any]]:
        """The objects of a kind."""
        done = self.kubectl("--namespace", namespace, "get", kind, *words, "--output", "json")
        return json.loads(done.stdout)["items"]

    def ask(self, namespace: str, service: str, path: str) -> str:
        """The body of a GET of a service's metrics port, by way of the API server; "" where nobody answers."""
        url = f"/api/v1/namespaces/{namespace}/services/{service}:9464/proxy{path}"
        return self.kubectl("get", "--raw", url, check=False).stdout

    def post(self, namespace: str, service: str, path: str, fields: dict[str, Any], token: str) -> int:
        """The status of a POST of JSON at the address of a service; the API server would keep the token to itself."""
        (found,) = self.get("services", namespace, "--field-selector", f"metadata.name={service}")
        words = (found["spec"]["clusterIP"], path, token, json.dumps(fields))
        return int(self.inside(sys.executable, "-S", "-c", POST, *words).stdout)

    def close(self) -> None:
        """End everything at once, and remove what it has left."""
        if self._launcher is not None:
            self._launcher.send_signal(signal.SIGKILL)
            self._launcher.wait()
        groups = [*Path("/sys/fs/cgroup").glob(f"*/{self.folder.name}")]
        wait_for(lambda: not any(map(_runs, groups)), 30, "all of the node's processes have ended")
        for group in (below for top in groups for below in (*top.glob("*/"), top)):
            with contextlib.suppress(FileNotFoundError):  # hierarchies may be mounted together
                group.rmdir()
        shutil.rmtree(self.folder)


def _runs(group: Path) -> bool:
    """True while a process is left in a cgroup or below."""
    return any(file.read_text() for file in group.rglob("cgroup.procs"))


def _run(line: list[str | Path], check: bool, seconds: float) -> "subprocess.CompletedProcess[str]":
    done = subprocess.run(line, capture_output=True, text=True, timeout=seconds, check=False)
    assert not check or done.returncode == 0, f"{' '.join(map(str, line))}: {done.stderr}{done.stdout}"
    return done
