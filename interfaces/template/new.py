"""Writes a new service that works: `make new-driver NAME=... KIND=serial|ble|lsl|bare`, `new-interpreter` and so on.

A driver `foo` becomes services/driver-foo; an interpreter's name is the sensor type it reads. Folder, packaging files,
role files as stubs, README, unit test, compose entry and status row, of a driver also its study and its row in
docs/devices.md; then `make env` installs it. A driver's KIND is its link: serial (tty, Unix socket, TCP, Bluetooth
Classic), ble (Bluetooth LE) or lsl (Lab Streaming Layer), each by the kit, or bare, whose transport.py is left to be
written.
"""

import importlib.util
import keyword
import re
import sys
from pathlib import Path

import generate
import package_files
from sense4hri.modalities import MODALITIES

ROOT = package_files.ROOT
FILES = Path(__file__).resolve().parent / "files"
KINDS = ("driver", "interpreter", "service")
LINKS = {
    "serial": {
        "link": "tty, Unix socket, TCP or Bluetooth Classic",
        "address_import": "from sense4hri.serial_port import ADDRESS, ADDRESS_FORM\n",
        "address_rule": '\n        matches=f"virtual|{ADDRESS}",\n        form=f"virtual, {ADDRESS_FORM}",'
        '\n        example="/dev/ttyUSB0",',
        "import_os": "import os\n",
        "emulator_imports": "import threading\nimport time\nimport tty\n"
        "from collections.abc import Iterator\nfrom contextlib import contextmanager\n",
        "emulator_link": '''

@contextmanager
def played(device: VirtualDevice) -> Iterator[str]:
    """Play a device on a pseudo-terminal, for the length of the context; give the path of it."""
    master, slave = os.openpty()
    tty.setraw(slave)
    ended = threading.Event()
    playing = threading.Thread(target=_play, args=(device, master, ended))
    playing.start()
    try:
        yield os.ttyname(slave)
    finally:
        ended.set()
        playing.join()
        os.close(master)
        os.close(slave)


def _play(device: VirtualDevice, master: int, ended: threading.Event) -> None:
    begun_s = time.monotonic()
    while not ended.wait(0.05):
        os.write(master, device.send(time.monotonic() - begun_s))
''',
    },
    "ble": {
        "link": "Bluetooth LE, bluetoothd or a stand-in",
        "dependencies": '"bleak", "dbus-fast", "numpy", "sense4hri"',
        "bluetooth": "yes",
    },
    "lsl": {"link": "Lab Streaming Layer", "dependencies": '"numpy", "pylsl", "sense4hri"'},
    "bare": {
        "link": "none yet",
        "address_import": "",
        "address_rule": '\n        matches=".+",\n        form="an address, or virtual",'
        '\n        example="00:00:00:00:00:00",',
        "import_os": "",
        "emulator_imports": "",
        "emulator_link": "",
    },
}
"""Of a driver, by KIND: what stands for the placeholders of its link; files/driver-<KIND> holds what is its own."""
DEPENDENCIES = {"driver": ("numpy", "sense4hri"), "interpreter": ("numpy", "sense4hri"), "service": ("sense4hri",)}
PUBLISHES = {
    "interpreter": "`features` beside every raw stream of its sensor type.",
    "service": "Nothing yet.",
}
STATUS = {
    "driver": "as `make new-driver` wrote it: the skin conductance of an example device | its emulator",
    "interpreter": "as `make new-interpreter` wrote it: counts what is a number, computes nothing yet | nothing yet",
    "service": "as `make new-service` wrote it: does nothing yet | nothing yet",
}
"""What the status table says of a new service: what it does, what it has seen."""
COMPOSE = """\
  {name}:
    <<: *service
    image: sense4hri/{name}
    build: {{context: .., dockerfile: services/Dockerfile, args: {{SERVICE: {name}}}}}
"""
RUNS = "    command: [python, -m, {package}]\n"
BLUETOOTH = """\
    environment:
      <<: *environment
      DBUS_SYSTEM_BUS_ADDRESS: unix:path=/run/dbus/system_bus_socket
"""


def words_of(kind: str, short: str, link: str = "") -> dict[str, str]:
    """Return what stands for each placeholder. Raises ValueError for a kind, name or link that cannot be."""
    if kind not in KINDS:
        raise ValueError(f"{kind!r} is no kind of service, must be one of {', '.join(KINDS)}")
    if kind == "driver" and link not in LINKS:
        raise ValueError(f"KIND is {link!r}, must be one of {', '.join(LINKS)}")
    if not re.fullmatch(r"(?=.{,40}$)[a-z][a-z0-9]*([-_][a-z0-9]+)*", short):
        form = "small letters, digits and single '-', as in my-sensor, 40 at most"
        raise ValueError(f"NAME is {short!r}, must be {form}")
    if kind != "service" and re.match(rf"{kind}[-_]", short):
        raise ValueError(f"NAME is {short!r}, must go without {kind}-: the service is called {kind}-NAME")
    sensor_type = short.replace("-", "_")
    message = MODALITIES[sensor_type].message if sensor_type in MODALITIES else ""
    if kind == "interpreter" and not message:
        able = ", ".join(each.sensor_type for each in MODALITIES.values() if each.message)
        first = "another kind of signal gets its message first: docs/adding-an-interpreter.md"
        raise ValueError(f"NAME is {short!r}, must be the sensor type it reads, one of {able}; {first}")
    name = short if kind == "service" else f"{kind}-{short.replace('_', '-')}"
    return {
        "name": name,
        "package": name.replace("-", "_"),
        "short": sensor_type,
        "short_name": short.replace("_", "-"),
        "title": (name if kind == "interpreter" else short).replace("-", " ").replace("_", " ").capitalize(),
        "sensor_type": sensor_type,
        "message": message,
        "dependencies": ", ".join(f'"{each}"' for each in DEPENDENCIES[kind]),
        "publishes": PUBLISHES.get(kind, ""),
        "status": STATUS[kind],
    } | LINKS.get(link, {})


def write(kind: str, short: str, link: str = "") -> Path:
    """Write everything a new service needs; return its folder. Raises ValueError where it cannot be, or is there."""
    words = words_of(kind, short, link)
    folder = ROOT / "services" / words["name"]
    if folder.exists():
        raise ValueError(f"services/{words['name']} is there already")
    if kind == "service" and (taken := _taken(words["package"])):
        raise ValueError(f"NAME is {short!r}, must be another: {taken}")
    study = ROOT / "compose" / "studies" / f"{words['short_name']}.yaml"
    if kind == "driver" and study.exists():
        raise ValueError(f"NAME is {short!r}, must be another: its study is there already, {study.relative_to(ROOT)}")
    places = {"pyproject.toml": folder, "README.md": folder}
    for source in sources(kind, link):
        file = source.name.removesuffix(".in")
        target = places.get(file, folder / "src" / words["package"]) / file
        if file == "test.py":
            target = ROOT / "tests" / "unit" / words["name"] / f"test_{words['package']}.py"
        if file == "study.yaml":
            target = study
        put(target, re.sub(r"@(\w+)@", lambda found: words[found[1]], source.read_text()))
    for path, text in package_files.files(folder).items():
        put(path, text)
    enter(words)
    sys.path.insert(0, str(folder / "src"))
    importlib.invalidate_caches()
    for path, text in generate.parameters.files(folder).items():
        put(path, text)
    for path, text in generate.devices.files(ROOT).items():  # it reads what was just written
        put(path, text)
    return folder


def _taken(package: str) -> str:
    """Return why no package of ours can be called so, "" where one can."""
    if keyword.iskeyword(package):
        return f"{package} is a word of Python"
    return f"Python has a package {package} already" if importlib.util.find_spec(package) else ""


def rivals(folder: Path, message: str) -> list[str]:
    """Return the other interpreters that publish this message: with one of them it would be twice on a topic."""
    mains = sorted(ROOT.glob("services/interpreter-*/src/*/__main__.py")) if message else []
    said = f"from sense4hri_msgs.msg import {message}\n"
    return [path.parents[2].name for path in mains if said in path.read_text() and folder not in path.parents]


def sources(kind: str, link: str) -> list[Path]:
    """Return the template's files of a kind: those that all services have, or its own in place of them."""
    folders = [FILES / "common", FILES / kind, *([FILES / f"driver-{link}"] if kind == "driver" else [])]
    return list({path.name: path for folder in folders for path in folder.iterdir()}.values())


def enter(words: dict[str, str]) -> None:
    """Give the service its entry in compose.yaml and its row in the status table."""
    compose, table = ROOT / "compose" / "compose.yaml", ROOT / "services" / "README.md"
    before, mark, after = compose.read_text().rpartition("  prometheus:\n")
    if not mark:
        raise SystemExit(f"{compose}: no line 'prometheus:' to put {words['name']} before")
    compose.write_text(f"{before}{compose_entry(words['name'], words.get('bluetooth') == 'yes')}\n{mark}{after}")
    rows = table.read_text().splitlines(keepends=True)
    last = max(i for i, line in enumerate(rows) if line.startswith("| "))
    rows.insert(last + 1, f"| {words['name']} | {words['status']} |\n")
    table.write_text("".join(rows))


def compose_entry(name: str, bluetooth: bool) -> str:
    """Return what compose.yaml says of a service; of a driver the study says the command, with its sensor."""
    runs = "" if name.startswith("driver-") else RUNS.format(package=name.replace("-", "_"))
    return COMPOSE.format(name=name) + runs + BLUETOOTH * bluetooth


def put(path: Path, text: str) -> None:
    """Write a file, with its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def main() -> int:
    """Write what the command line names; return the exit status."""
    if len(sys.argv) not in (3, 4):
        print("new.py driver|interpreter|service NAME [KIND]", file=sys.stderr)
        return 2
    try:
        folder = write(*sys.argv[1:])
    except ValueError as err:
        print(f"new: {err}", file=sys.stderr)
        return 2
    print(f"new: {folder.relative_to(ROOT)}; README, src and the unit test wait for you; make env installs it")
    if sys.argv[1] == "interpreter":
        message = MODALITIES[sys.argv[2].replace("-", "_")].message
        for each in rivals(folder, message):
            print(f"new: {each} publishes {message} of the same streams: a study may have one of the two")
    return 0


if __name__ == "__main__":
    sys.exit(main())
