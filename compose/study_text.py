"""The text of a study file that `make study` writes."""

import json
import os
import re
import shlex
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import ros_yaml
import yaml
from sensor_kinds import ADDRESS, KINDS, UNKNOWN_ID, Link

HOUSE = Path(__file__).resolve().parent / "compose.yaml"
MOST = 99
"""Participants; addresses of virtual sensors have two digits for them."""
PLAIN = re.compile(r"[\w./:+-]+")
FIRST_PORT = 51000
"""Of virtual devices on the network: a hundred for each kind."""
COMPUTING = ("clock-sync", "interpreter-", "fusion-")
"""How the names of services begin that compute from what others say."""
STATES_FROM = {"ecg", "ppg"}
"""Sensor types whose features fusion-affect makes states of."""
COMMANDS = {"check": "what is wrong with it", "demo": "as plain processes", "up": "in containers"}
TMPFS = '    driver_opts: {type: tmpfs, device: tmpfs, o: "uid=10001,mode=755,size=1m"}\n'


class Wish(NamedTuple):
    """What the study is to be. kinds: sensors of each participant; ids: printed id or address by sensor_id."""

    name: str
    task: str
    participants: tuple[str, ...]
    kinds: tuple[str, ...]
    ids: Mapping[str, str]
    virtual: bool
    record_only: bool
    replay: bool
    extras: tuple[str, ...]


class Sensor(NamedTuple):
    """One sensor of the study."""

    sensor_id: str
    human_id: str
    kind: str
    device: str


def sensors(wish: Wish) -> list[Sensor]:
    """Return the sensors of all participants; virtual ones have ids, real ones those that were given."""
    found = []
    for number, human_id in enumerate(wish.participants, 1):
        for kind in () if wish.replay else wish.kinds:
            sensor_id = f"{kind.replace('-', '_')}_{number}"
            unknown = (
                _virtual_id(wish, kind, sensor_id, number)
                if wish.virtual
                else KINDS[kind].unknown.replace("{n}", str(number - 1)) or sensor_id
            )
            found.append(Sensor(sensor_id, human_id, kind, wish.ids.get(sensor_id, unknown)))
    return found


def _virtual_id(wish: Wish, kind: str, sensor_id: str, number: int) -> str:
    """Return by what a driver finds a virtual device."""
    index, given = wish.kinds.index(kind), KINDS[kind]
    if given.link is Link.WIRE:
        return f"/run/dbus/{sensor_id}"
    if given.link is Link.NETWORK:
        return "sensor-bench"
    if given.link in (Link.LSL, Link.FILE):
        return sensor_id
    if "mac_address" in given.words:
        return _mac(index, number)
    return given.unknown.replace(UNKNOWN_ID, f"1A2B{3 + index:X}C{number:02d}")


def _mac(index: int, number: int) -> str:
    return f"F1:4A:10:00:{index:02d}:{number:02d}"


def _number(wish: Wish, sensor: Sensor) -> int:
    return wish.participants.index(sensor.human_id) + 1


def _port(wish: Wish, sensor: Sensor) -> int:
    return FIRST_PORT + 100 * wish.kinds.index(sensor.kind) + _number(wish, sensor)


def text(wish: Wish, folder: Path) -> str:
    """Return the study file as it is to be in this folder."""
    house = os.path.relpath(HOUSE, folder)
    parts = [
        _head(wish, folder),
        _about(wish),
        _drivers(wish, house, folder),
        "services:\n",
        *_services(wish, house),
        _volumes(wish),
    ]
    return "".join(parts)


def called(wish: Wish, folder: Path) -> str:
    """Return the word by which `make` finds the study in this folder: its name in compose/studies, else its path."""
    return wish.name if folder == HOUSE.parent / "studies" else shlex.quote(str(folder / f"{wish.name}.yaml"))


def _head(wish: Wish, folder: Path) -> str:
    study = called(wish, folder)
    lines = [*textwrap.wrap(f"{_said(wish)}.", 118), ""]
    lines += [f"  make {verb:<5} STUDY={study:<20} {what}" for verb, what in COMMANDS.items()]
    lines += ["", "Written by `make study`, yours to edit (README.md beside it): a service that is not needed may go."]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines) + f"name: sense4hri-{wish.name}\n\n"


def _said(wish: Wish) -> str:
    """Return what the study is, in a sentence."""
    if wish.replay:
        return "A recorded session, played and computed anew"
    who = f"{len(wish.participants)} participant{'s' * (len(wish.participants) > 1)}"
    what = " and ".join(KINDS[kind].about for kind in wish.kinds)
    real = "real sensors: put the id, port or address of each in place of the one that stands there"
    if all(KINDS[kind].unknown == UNKNOWN_ID for kind in wish.kinds):
        real = f"real sensors at this machine's Bluetooth: put the id printed on each in place of {UNKNOWN_ID}"
    return f"{who} with {what}; {'virtual sensors' if wish.virtual else real}"


def _about(wish: Wish) -> str:
    lines = ["x-study:", f"  name: {_text(wish.name)}"]
    lines += [f"  task: {_text(wish.task)}"] if wish.task else []
    if wish.replay:
        return "\n".join(lines) + "\n\n"
    lines += [f"  participants: [{', '.join(wish.participants)}] # pseudonyms"]
    streams = [
        f"    - /humans/physiological/{each.human_id}/{sensor_type}/{each.sensor_id}/raw"
        for each in sensors(wish)
        for sensor_type in KINDS[each.kind].required
    ]
    none = "" if streams else " []"
    lines += [f"  required_streams:{none} # without these no session starts; those of the robot may stand here too"]
    return "\n".join([*lines, *streams]) + "\n\n"


def plain(words: str) -> bool:
    """Return whether YAML and ROS read these words as the text that they are, without quotes, wherever they stand."""
    try:
        return bool(yaml.safe_load(f"[{words}]") == [words] == ros_yaml.load(f"[{words}]"))
    except yaml.YAMLError:
        return False


def _text(words: str) -> str:
    return (words if plain(words) else json.dumps(words, ensure_ascii=False)).replace("$", "$$")


def _drivers(wish: Wish, house: str, folder: Path) -> str:
    """Return what the entries of the sensors have in common, by driver."""
    found = []
    for driver in dict.fromkeys(KINDS[each.kind].driver for each in sensors(wish)):
        kinds = [KINDS[kind] for kind in wish.kinds if KINDS[kind].driver == driver]
        links, bus = {kind.link for kind in kinds}, "radio" if wish.virtual else "bluez"
        radio = Link.BLUETOOTH in links or (wish.virtual and Link.WIRE in links)
        mounts = [f"{bus}:/run/dbus"] * radio
        mounts += [f"{_beside(folder, source)}:{target}:ro" for kind in kinds for source, target in kind.mounts.items()]
        about = (
            ""
            if not radio
            else " # a driver "
            + ("beside the virtual sensors' D-Bus" if wish.virtual else "at this machine's Bluetooth")
        )
        found.append(f"x-{driver}: &{driver}{about}\n  extends: {{file: {house}, service: driver-{driver}}}\n")
        found += [f"  volumes: [{', '.join(mounts)}]\n"] * bool(mounts) + ["\n"]
    return "".join(found)


def _beside(folder: Path, name: str) -> str:
    """Return the path of a folder beside the ready studies as a mount of a study in this folder."""
    path = os.path.relpath(HOUSE.parent / "studies" / name, folder)
    return path if path.startswith(".") else f"./{path}"


def _services(wish: Wish, house: str) -> Iterator[str]:
    for sensor in sensors(wish):
        yield _sensor(wish, sensor)
    if wish.replay:
        yield _replay(wish, house)
    elif _played(wish):
        yield _bench(wish, house)
    elif _at_bluetooth(wish):
        yield (
            f"  bluetooth: # shows the drivers BlueZ, and nothing else of the system's D-Bus\n"
            f"    extends: {{file: {house}, service: bluetooth}}\n"
            "    volumes: [bluez:/run/dbus, /run/dbus/system_bus_socket:/run/host/system_bus_socket]\n"
        )
    for name in _others(wish):
        yield f"  {name}:\n    extends: {{file: {house}, service: {name}}}\n"


def _played(wish: Wish) -> list[Sensor]:
    """Return the sensors that the sensor-bench plays."""
    return [each for each in sensors(wish) if wish.virtual and KINDS[each.kind].model]


def _at_bluetooth(wish: Wish) -> bool:
    return not wish.virtual and any(KINDS[each.kind].link is Link.BLUETOOTH for each in sensors(wish))


def _sensor(wish: Wish, sensor: Sensor) -> str:
    kind = KINDS[sensor.kind]
    package = f"driver_{kind.driver.replace('-', '_')}"
    lines = [f"  {sensor.sensor_id.replace('_', '-')}: # {kind.about} of {sensor.human_id}", f"    <<: *{kind.driver}"]
    if kind.link is Link.WIRE and sensor.device.startswith("/dev/"):
        lines += [f"    devices: [{sensor.device}]"]
    lines += ["    command: >", f"      python -m {package} --ros-args"]
    lines += [f"      -p sensor_id:={sensor.sensor_id}", f"      -p human_id:={sensor.human_id}"]
    lines += [f"      -p {_word(name, value)}" for name, value in _parameters(wish, sensor).items()]
    if wish.virtual and kind.link is Link.NETWORK:
        lines += ['    x-process: [-p, "address:=127.0.0.1"]']
    return "\n".join(lines) + "\n"


def _parameters(wish: Wish, sensor: Sensor) -> dict[str, str]:
    """Return the parameters of a sensor's driver besides who it is and who wears it."""
    kind, found = KINDS[sensor.kind], {}
    for name, value in kind.parameters.items():
        by_address = name == "name" and ADDRESS.fullmatch(sensor.device)
        own = _text(sensor.device).replace('"', '\\"') if value == "{id}" else sensor.device
        found["address" if by_address else name] = sensor.device if by_address else value.replace("{id}", own)
    if wish.virtual and kind.link is Link.NETWORK:
        found["port"] = str(_port(wish, sensor))
    if wish.virtual and kind.link is Link.LSL:
        found |= {"session": f"{wish.name}-{{domain}}", "known_peers": "[sensor-bench]"}
    return found


def _word(name: str, value: str) -> str:
    """Return `name:=value`, in quotes where a shell or YAML would take it apart."""
    word = f"{name}:={value}"
    return word if PLAIN.fullmatch(value) and name not in ("body_location", "address") else f'"{word}"'


def _replay(wish: Wish, house: str) -> str:
    computing = (name.replace("-", "_") for name in _others(wish) if name.startswith(COMPUTING))
    return (
        "  # BAG=/recordings/STUDY/PARTICIPANTS/SESSION make demo ...; without it, it waits for POST /play.\n"
        "  # A service that is taken out goes from `wait_for` too: nothing is played before all of these are there.\n"
        "  replay:\n"
        f"    extends: {{file: {house}, service: replay}}\n"
        "    command: >\n      python -m replay --ros-args\n      -p 'bag:=\"${BAG:-}\"'\n"
        "      -p what:=raw\n      -p rate:=${RATE:-1.0}\n"
        f"      -p wait_for:='[{', '.join(computing)}]'\n      -p discovery_timeout_s:=60.0\n"
    )


def _bench(wish: Wish, house: str) -> str:
    """Return the service that plays the sensors: hearts of different rates, clocks of different speeds.

    A device on the network listens in its container on all of them, as a plain process on this machine alone.
    """
    words = "".join(f"      - {word}\n" for word in ("python", "-m", "sensor_bench", "--ros-args", "-p"))
    text = (
        f"  sensor-bench: # who and what it plays: services/sensor-bench/README.md\n"
        f"    extends: {{file: {house}, service: sensor-bench}}\n    command:\n{words}"
        f"      - socket_path:=/run/dbus/system_bus_socket\n      - -p\n{_cast(wish, '0.0.0.0')}"
    )
    on_the_network = any(KINDS[each.kind].link is Link.NETWORK for each in _played(wish))
    return text + (f"    x-process:\n      - -p\n{_cast(wish, '127.0.0.1')}" if on_the_network else "")


def _cast(wish: Wish, listens: str) -> str:
    """Return the bench's parameter `devices`. listens: address of devices on the network."""
    people = [
        f"{human_id}: {{heart_rate_bpm: {58 + 7 * number % 32}, face: face_{number}}}"
        for number, human_id in enumerate(wish.participants, 1)
    ]
    devices = [
        _device(wish, each, number, listens) for number, each in enumerate(sensors(wish), 1) if each in _played(wish)
    ]
    return (
        "      - |\n        devices:=|\n          participants:\n"
        + "".join(f"            {line}\n" for line in people)
        + "          devices:\n"
        + "".join(f"            {line}\n" for line in devices)
    )


def _device(wish: Wish, sensor: Sensor, number: int, listens: str) -> str:
    kind = KINDS[sensor.kind]
    keys = [f"sensor: {sensor.sensor_id}", f"model: {kind.model}", f"participant: {sensor.human_id}"]
    keys += [kind.played.replace("{id}", _text(sensor.device))] * bool(kind.played)
    if kind.link is Link.BLUETOOTH:
        keys.append(f'address: "{_mac(wish.kinds.index(sensor.kind), _number(wish, sensor))}"')
    if kind.link is Link.WIRE:
        keys.append(f"at: {sensor.device}")
    if kind.link is Link.NETWORK:
        keys += [f"port: {_port(wish, sensor)}", f"address: {listens}"]
    if kind.link is Link.LSL:
        keys.append(f'session: "{wish.name}-{{domain}}"')
    if kind.driver == "polar":
        keys.append(f"skew_ppm: {(17.0 * number) % 80 - 40:.1f}")
    return f"- {{{', '.join(keys)}}}"


def _others(wish: Wish) -> list[str]:
    """Return the services that a study has besides its sensors."""
    kinds = [KINDS[kind] for kind in wish.kinds]
    states = ["fusion-affect"] if any(STATES_FROM & {*kind.required} for kind in kinds) else []
    interpreters = sorted({name for kind in kinds for name in kind.interpreters})
    computing = [] if wish.record_only else [*interpreters, *states]
    keeping = ["recorder", "analysis", "metadata-registry", "session-coordinator"]
    asked = ["alertmanager", "grafana"] if "prometheus" in wish.extras else []  # run with COMPOSE_PROFILES alone
    return ["clock-sync", *computing, *([] if wish.replay else keeping), *wish.extras, *asked]


def _volumes(wish: Wish) -> str:
    kept = ["recordings"] if wish.replay else ["recordings", "registry", "session"]
    names = [*kept, *(["prometheus"] if "prometheus" in wish.extras else [])]
    named = "".join(f"  {name}:\n" for name in names)
    if _played(wish):
        return f"\nvolumes:\n{named}  radio: # the virtual sensors' D-Bus\n{TMPFS}"
    if not _at_bluetooth(wish):
        return f"\nvolumes:\n{named}"
    bluez = "  bluez: # as plain processes the drivers use this machine's D-Bus"
    return f"\nvolumes:\n{named}{bluez}\n{TMPFS}    x-process: /run/dbus\n"
