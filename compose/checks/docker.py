"""What a study needs of Docker: an Engine that answers, a file that Compose reads, its images and published ports."""

import os
import re
import stat
import subprocess
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import compose_yaml
from study_file import Service, Study

from checks.finding import Finding, Places
from checks.machine import files, taken

SCRIPT = Path(__file__).resolve().parents[1] / "docker.sh"
ANSWER_S = 20.0
OURS = "sense4hri/"
USER = 10001
"""Under which the images' programs run."""
MOST_PORT = 65535
MOST_LOOKED_AT = 10_000
PORT = re.compile(
    r"(?:(?P<address>[\d.]+|\[[0-9a-fA-F:]+\]):)?(?P<first>\d+)(?:-(?P<last>\d+))?:[\d-]+(?:/(?P<protocol>\w+))?"
)
EVERY_ADDRESS = ("", "0.0.0.0")
NAMED = re.compile(r"services\.[\w.-]+|(?<=service \")[^\"]+")


class Published(NamedTuple):
    """A port of this machine. address: on which of its addresses."""

    address: str
    port: int
    protocol: str

    def meets(self, other: "Published") -> bool:
        """Return whether only one of the two can be had."""
        same = self.address == other.address or {self.address, other.address} & {*EVERY_ADDRESS}
        return bool(same) and (self.port, self.protocol) == (other.port, other.protocol)


def answers() -> bool:
    """Return whether a Docker Engine answers."""
    try:
        return bool(_docker("version", "--format", "{{.Server.Version}}"))
    except OSError:
        return False


def root() -> Path:
    """Return the folder of Docker's volumes, "/" where it does not say."""
    return Path(_docker("info", "--format", "{{.DockerRootDir}}").strip() or "/")


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield images that are not built, mounts that are not there, and ports that somebody else has."""
    yield from _images(study, places)
    for service in study.services:
        yield from files(service, places)
    for service in (*study.services, *study.on_request):
        yield from _closed(service, places)
    yield from _kept(study, places)
    yield from _ports(study, places)


def unread(file: Path, places: Places) -> Iterator[Finding]:
    """Yield what Compose says of a file that it does not read."""
    if said := refusal(file):
        named = NAMED.search(said)
        keys = f"services.{named[0].removeprefix('services.')}" if named else "services"
        yield places.error(keys, f"docker compose does not read it: {said}")


def refusal(file: Path) -> str:
    """Return why Compose does not read a file, "" where it does."""
    command = [str(SCRIPT), "compose", "-f", str(file), "--profile", "*", "config", "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=ANSWER_S, check=False)
    except subprocess.TimeoutExpired:
        return f"it did not answer within {ANSWER_S:g} s"
    return (done.stderr.strip() or "no reason given") if done.returncode else ""


def _closed(service: Service, places: Places) -> Iterator[Finding]:
    """Yield mounts to be read that other users may not read: a checkout made under umask 077 is its owner's alone.

    A container runs as a user of its own (`user:`, or its image's).
    """
    for target in sorted(service.read_only & service.mounts.keys()):
        source = service.mounts[target]
        if source.startswith("/") and (closed := next(_unreadable(Path(source)), None)):
            text = f"{closed} may be read by its owner alone, not by the user in the container: chmod -R a+rX {source}"
            yield places.warning(f"services.{service.name}.volumes", text, target)


def _unreadable(path: Path) -> Iterator[Path]:
    """Yield files and folders, of the first MOST_LOOKED_AT below this one, that others may not read."""
    below = (Path(folder, name) for folder, folders, names in os.walk(path) for name in (*folders, *names))
    for each in islice(chain([path], below), MOST_LOOKED_AT):
        mode = each.stat().st_mode if each.exists() else 0
        needed = 0o5 if stat.S_ISDIR(mode) else 0o4 if stat.S_ISREG(mode) else 0
        if needed & ~mode:
            yield each


def _kept(study: Study, places: Places) -> Iterator[Finding]:
    """Yield the folder of this machine, `RECORDINGS`, in which the recorder's user may not write."""
    for recorder in (service for service in study.services if service.package == "recorder"):
        for source in (recorder.mounts[target] for target in sorted(recorder.mounts.keys() - recorder.read_only)):
            if source.startswith("/") and not _writable(Path(source)):
                text = f"user {USER} must be able to write in {source}: install -d -o {USER} -g {USER} {source}"
                yield places.error(f"services.{recorder.name}", text)


def _writable(folder: Path) -> bool:
    """Return whether the user of the images may make files in a folder."""
    if not folder.is_dir():
        return False
    status = folder.stat()
    needed = 0o300 if status.st_uid == USER else 0o030 if status.st_gid == USER else 0o003
    return status.st_mode & needed == needed


def _images(study: Study, places: Places) -> Iterator[Finding]:
    """Yield one line for all of the house's that are not built, as one command builds them, and one for each other."""
    built = set(_docker("images", "--format", "{{.Repository}}:{{.Tag}}").split())
    missing = [service for service in study.services if service.image and _tagged(service.image) not in built]
    ours = dict.fromkeys(service.image for service in missing if service.image.startswith(OURS))
    if ours:
        text = f"not built yet: {', '.join(ours)}; make up builds them, and so does make images; make demo needs none"
        yield places.error("services", text)
    for service in missing:
        if service.image not in ours:
            text = f"image {service.image} is not on this machine; Docker will fetch it"
            yield places.warning(f"services.{service.name}", text)


def _tagged(image: str) -> str:
    return image if ":" in image.rpartition("/")[2] else f"{image}:latest"


def _ports(study: Study, places: Places) -> Iterator[Finding]:
    """Yield ports of this machine that two services want, or that are taken by something that is not this study."""
    seen: dict[Published, str] = {}
    own = _own_ports(study.file)
    for service in study.services:
        keys = f"services.{service.name}.ports"
        for wanted in (each for given in service.ports for each in _published(given)):
            port = wanted.port
            if port > MOST_PORT:
                yield places.error(keys, f"port {port}: must be 1 to {MOST_PORT}", str(port))
            elif other := next((name for each, name in seen.items() if wanted.meets(each)), ""):
                yield places.error(keys, f"port {port} is that of {other} already", str(port))
            elif wanted.protocol == "tcp" and port not in own and taken(port):
                yield places.error(keys, f"port {port} is taken on this machine", str(port))
            seen[wanted] = service.name


def _published(given: Any) -> Iterator[Published]:
    """Yield the ports of this machine of an entry of `ports`; none where Docker chooses, or where it is no port."""
    if isinstance(given, dict):
        address = f"{given['host_ip']}:" if given.get("host_ip") else ""
        given = f"{address}{given.get('published', '')}:{given.get('target')}/{given.get('protocol', 'tcp')}"
    if found := PORT.fullmatch(str(given)):
        first = int(found["first"])
        for port in range(first, int(found["last"] or first) + 1):
            if port:
                yield Published(found["address"] or "", port, found["protocol"] or "tcp")


def _own_ports(file: Path) -> set[int]:
    """Return the ports that containers of this study have already: `make up` again is no conflict."""
    project = compose_yaml.load(file, os.environ).get("name", "")
    label = f"label=com.docker.compose.project={project}"
    return {int(port) for port in re.findall(r":(\d+)->", _docker("ps", "--filter", label, "--format", "{{.Ports}}"))}


def _docker(*words: str) -> str:
    """Return what a command of Docker prints, "" where it fails or takes too long."""
    try:
        done = subprocess.run([str(SCRIPT), *words], capture_output=True, text=True, timeout=ANSWER_S, check=False)
    except subprocess.TimeoutExpired:
        return ""
    return done.stdout if done.returncode == 0 else ""
