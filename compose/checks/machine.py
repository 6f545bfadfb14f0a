"""What a study needs of this machine: programs, adapters, serial ports, files, ports, room on the disk."""

import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from command_words import parameters_of
from sense4hri.serial_port import wrong_with
from study_file import Service, Study

from checks.bluetooth import adapters
from checks.finding import Finding, Places
from checks.parameters import streams_of

BYTES_PER_VALUE = 8.0
BYTES_PER_STREAM_S = 3000.0
BYTES_PER_UNKNOWN_S = 70_000.0  # of a sensor that says what it measures once it is connected: nine modalities take that
"""Of features, health, clocks and what surrounds them; with both, `make check` asks for some more than is written."""
FLOOR_MB = 500
DOMAINS = range(102)
"""Of ROS on Linux, whose ports lie below those that the kernel hands out."""
READ = {"driver_file": ("file",), "driver_serial": ("board",), "sensor_bench": ("input",)}
"""Parameters that name a file which must be there, by package."""
PORTS = range(1, 65536)
GUI_PORT, PORTS_TRIED = 8080, 50
"""Of the page, where none is asked for: the first that is free of so many."""
BUS = "unix:path="
NO_BOARDS = ("SYNTHETIC", "PLAYBACK_FILE", "STREAMING")
"""What BrainFlow has beside those that exist."""


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield what is missing or in the way, however the study is started."""
    yield from _domain(places)
    for service in study.processes:
        yield from _serial_ports(service, places)
        yield from _read(service, places)
    yield from _bluetooth(study, places)


def for_processes(study: Study, recordings: Path, places: Places) -> Iterator[Finding]:
    """Yield what `make demo` cannot do without; the folder of the recordings is made by it."""
    if study.of("sensor_bench") and shutil.which("dbus-daemon") is None:
        yield places.error(
            f"services.{_name(study, 'sensor_bench')}",
            "dbus-daemon is missing: the virtual sensors need it. Debian, Ubuntu: apt-get install dbus-daemon",
        )
    for service in study.processes:
        process = service.process(Path("/volumes"))
        program, folder = process.command[0], process.folder or "/"
        if shutil.which(program) is None:
            yield places.error(f"services.{service.name}.command", f"{program} is not a program of this machine")
        if not folder.startswith("/volumes/") and not os.path.isdir(folder):
            yield places.error(f"services.{service.name}.working_dir", f"{folder!r} is no folder of this machine")
        yield from files(service, places, recordings)
        yield from _bag(service, places)
    yield from _no_bus(study, places)
    yield from _no_folder(study, recordings, places)
    gui = study.of("web_gui")
    port = _last(gui, "port") if gui else None
    if gui and port in PORTS and taken(port):  # what is no port is told as a parameter
        keys = f"services.{gui.name}"
        yield places.error(keys, f"port {port} is taken on this machine: set PORT to a free one, or leave it out")


def room(study: Study, folder: Path, hours: float, places: Places) -> Iterator[Finding]:
    """Yield where the disk of the recordings is too small for so long a study."""
    recorder = study.of("recorder")
    if recorder is None:
        return
    free_mb = shutil.disk_usage(_there(folder)).free / 1e6
    given = recorder.parameters.get("free_floor_mb")
    floor_mb = given if isinstance(given, int | float) else FLOOR_MB  # what is no number is told as a parameter
    needed_mb = bytes_per_s(study) * hours * 3600 / 1e6
    keys = f"services.{recorder.name}"
    if free_mb < floor_mb:
        yield places.error(
            keys, f"{folder}: {free_mb:.0f} MB are free; below {floor_mb:.0f} MB the recorder begins no recording"
        )
    elif free_mb < floor_mb + needed_mb:
        yield places.error(
            keys,
            f"{folder}: {free_mb:.0f} MB are free; {hours:g} h take {needed_mb:.0f} MB, and {floor_mb:.0f} MB stay",
        )


def _no_folder(study: Study, folder: Path, places: Places) -> Iterator[Finding]:
    """Yield where the folder of the recordings can neither be written to nor be made."""
    recorder, there = study.of("recorder"), _there(folder)
    if recorder and not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        text = f"{there} is no folder that can be written to: nothing can be recorded there"
        yield places.error(f"services.{recorder.name}", text)


def _there(path: Path) -> Path:
    """Return the path, or the nearest above it, that is there."""
    return next(each for each in (path, *path.parents) if os.path.exists(each))


def bytes_per_s(study: Study) -> float:
    """Return about how much a second of the study takes on the disk."""
    return sum(map(_bytes_per_s, study.sensors))


def _bytes_per_s(sensor: Service) -> float:
    streams = streams_of(sensor)
    if not streams:
        return BYTES_PER_UNKNOWN_S
    values_per_s = sum(stream.sampling_frequency_hz * len(stream.channel_names) for stream in streams.values())
    return values_per_s * BYTES_PER_VALUE + BYTES_PER_STREAM_S * len(streams)


def page_port() -> int | None:
    """Return the port that the page of plain processes gets where none is asked for; None where all are taken."""
    return next((port for port in range(GUI_PORT, GUI_PORT + PORTS_TRIED) if not taken(port)), None)


def taken(port: int) -> bool:
    """Return whether something listens on this port of the loopback."""
    with closing(socket.socket()) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def _domain(places: Places) -> Iterator[Finding]:
    given = os.environ.get("ROS_DOMAIN_ID", "0")
    if not (given.isascii() and given.isdigit()) or int(given) not in DOMAINS:
        yield places.error("services", f"ROS_DOMAIN_ID is {given!r}, must be 0 to {DOMAINS[-1]}")


def _serial_ports(service: Service, places: Places) -> Iterator[Finding]:
    """Yield links to devices that cannot be opened now: those given to the container, and the driver's `port`."""
    keys = f"services.{service.name}"
    for device in (entry.partition(":")[0] for entry in service.devices):
        if wrong := wrong_with(device):
            yield places.warning(f"{keys}.devices", f"{device}: {wrong}; containers need it to start", device)
    port = _last(service, "port") if service.sensor_id else None
    made = any(port in entry.split(":")[:2] for entry in service.devices) or str(port).startswith("/volumes/")
    if isinstance(port, str) and not made and (wrong := wrong_with(port)):
        yield places.warning(f"{keys}.command", f"{port}: {wrong}", "port:=")


def files(service: Service, places: Places, made: Path | None = None) -> Iterator[Finding]:
    """Yield paths of this machine that are mounted and not there; Docker would make empty folders of them."""
    for target, source in service.mounts.items():
        if source.startswith("/") and not os.path.exists(source) and Path(source) != made:
            keys = f"services.{service.name}.volumes"
            yield places.error(keys, f"{source} is not there; it would be {target} in the container", target)


def _bag(service: Service, places: Places) -> Iterator[Finding]:
    bag = str(_last(service, "bag") or "") if service.package == "replay" else ""
    if bag and not os.path.exists(bag) and not os.path.exists(Path(bag).parent):
        yield places.error(f"services.{service.name}.command", f"bag {bag!r} is not there: nothing to replay", "bag:=")


def _read(service: Service, places: Places) -> Iterator[Finding]:
    """Yield files that a driver reads and that are not there; a driver of a file or a board ends without."""
    for name in READ.get(service.package, ()):
        path = str(_last(service, name) or "")
        if path.startswith("/") and not path.startswith("/volumes/") and not os.path.exists(path):
            text = f"{name} {path!r} is not there; in a container it must be in one of `volumes`"
            yield places.error(f"services.{service.name}.command", text, f"{name}:=")


def _bluetooth(study: Study, places: Places) -> Iterator[Finding]:
    """Yield where a study of real sensors has no Bluetooth adapter; the drivers would wait for one."""
    asked: dict[str, list[Service]] = {}
    for service in study.processes:
        address = service.process(Path("/nowhere")).env.get("DBUS_SYSTEM_BUS_ADDRESS", "")
        here = address.startswith(BUS) and not address.startswith(f"{BUS}/nowhere")
        if service.sensor_id and here and not _without_radio(service):
            asked.setdefault(address, []).append(service)
    for address, services in asked.items():
        found, wrong = adapters(address)
        for service in services:
            wanted = str(service.parameters.get("adapter", ""))
            missing = f"adapter {wanted} is not among {', '.join(found)}" if wanted and wanted not in found else ""
            if wrong or missing:
                yield places.warning(f"services.{service.name}.command", wrong or missing, "adapter:=")


def _without_radio(service: Service) -> bool:
    """True for a board of BrainFlow's that is on a wire, on the network or none at all."""
    elsewhere = any(service.parameters.get(link) for link in ("serial_port", "ip_address"))
    return elsewhere or service.parameters.get("board") in NO_BOARDS


def _no_bus(study: Study, places: Places) -> Iterator[Finding]:
    """Yield drivers whose D-Bus is in a volume in which no plain process makes one: the proxy is a container."""
    made = {volume for each in study.processes if not each.sensor_id for volume in each.mounts.values()}
    for sensor in study.sensors:
        address = sensor.process(Path("/nowhere")).env.get("DBUS_SYSTEM_BUS_ADDRESS", "")
        volume = address.removeprefix(f"{BUS}/nowhere/").partition("/")[0]
        if volume in set(sensor.mounts.values()) - made:
            text = f"nobody makes a D-Bus in volume {volume}; give it x-process: /run/dbus"
            yield places.error(f"services.{sensor.name}.volumes", text, volume)


def _name(study: Study, package: str) -> str:
    service = study.of(package)
    return service.name if service else ""


def _last(service: Service, name: str) -> object:
    """Return a parameter as the plain process has it: with `x-process`, and paths of this machine."""
    return parameters_of(service.name, service.process(Path("/volumes")).command).get(name)
