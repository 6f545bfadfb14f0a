"""The text of a study file that `make study` writes."""

import os
import re
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

HOUSE = Path(__file__).resolve().parent / "compose.yaml"
MOST = 99
"""Participants; addresses of virtual sensors have two digits for them."""
DEVICE = re.compile(r"[0-9A-Fa-f]{8}|[0-9A-Fa-f]{2}(:[0-9A-Fa-f]{2}){5}")
UNKNOWN_ID = "00000000"
COMMANDS = {"check": "what is wrong with it", "demo": "as plain processes", "up": "in containers"}
TMPFS = '    driver_opts: {type: tmpfs, device: tmpfs, o: "uid=10001,mode=755,size=1m"}\n'


class Kind(NamedTuple):
    """One kind of sensor: parameters of its driver, what the session waits for, and who computes features of it."""

    model: str
    advertised: str
    streams: str
    body_location: str
    required: str
    interpreter: str
    about: str


KINDS = {
    "h10": Kind("H10", "Polar H10", "ecg, accelerometer, heart_rate", "chest", "ecg", "interpreter-ecg", "chest strap"),
    "verity": Kind(
        "VeritySense",
        "Polar Sense",
        "ppg, accelerometer, pp_interval",
        "upper arm",
        "ppg",
        "interpreter-ppg",
        "optical arm band",
    ),
    "oh1": Kind(
        "OH1", "Polar OH1", "ppg, accelerometer, pp_interval", "upper arm", "ppg", "interpreter-ppg", "optical arm band"
    ),
}


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
        for kind in wish.kinds:
            sensor_id = f"{kind}_{number}"
            unknown = f"1A2B{3 + wish.kinds.index(kind):X}C{number:02d}" if wish.virtual else UNKNOWN_ID
            found.append(Sensor(sensor_id, human_id, kind, wish.ids.get(sensor_id, unknown)))
    return found


def text(wish: Wish, folder: Path) -> str:
    """Return the study file as it is to be in this folder."""
    house = os.path.relpath(HOUSE, folder)
    parts = [_head(wish), _about(wish), _driver(wish, house), "services:\n", *_services(wish, house), _volumes(wish)]
    return "".join(parts)


def _head(wish: Wish) -> str:
    lines = [*textwrap.wrap(f"{_said(wish)}.", 118), ""]
    lines += [f"  make {verb:<5} STUDY={wish.name:<20} {what}" for verb, what in COMMANDS.items()]
    lines += ["", "Written by `make study`, yours to edit (README.md beside it): a service that is not needed may go."]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines) + f"name: sense4hri-{wish.name}\n\n"


def _said(wish: Wish) -> str:
    """Return what the study is, in a sentence."""
    if wish.replay:
        return "A recorded session, played and computed anew"
    who = f"{len(wish.participants)} participant{'s' * (len(wish.participants) > 1)}"
    what = " and ".join(KINDS[kind].about for kind in wish.kinds)
    real = f"real sensors at this machine's Bluetooth: put the id printed on each in place of {UNKNOWN_ID}"
    return f"{who} with {what}; {'virtual sensors' if wish.virtual else real}"


def _about(wish: Wish) -> str:
    lines = ["x-study:", f"  name: {wish.name}"]
    lines += [f"  task: {wish.task}"] if wish.task else []
    if wish.replay:
        return "\n".join(lines) + "\n\n"
    lines += [f"  participants: [{', '.join(wish.participants)}] # pseudonyms"]
    lines += ["  required_streams: # without these no session starts; those of the robot may stand here too"]
    lines += [
        f"    - /humans/physiological/{each.human_id}/{KINDS[each.kind].required}/{each.sensor_id}/raw"
        for each in sensors(wish)
    ]
    return "\n".join(lines) + "\n\n"


def _driver(wish: Wish, house: str) -> str:
    if wish.replay:
        return ""
    bus, about = (
        ("radio", "beside the virtual sensors' D-Bus") if wish.virtual else ("bluez", "at this machine's Bluetooth")
    )
    return (
        f"x-polar: &polar # a driver {about}\n"
        f"  extends: {{file: {house}, service: driver-polar}}\n  volumes: [{bus}:/run/dbus]\n\n"
    )


def _services(wish: Wish, house: str) -> Iterator[str]:
    for sensor in sensors(wish):
        yield _sensor(sensor)
    if wish.replay:
        yield _replay(house)
    elif wish.virtual:
        yield _bench(wish, house)
    else:
        yield (
            f"  bluetooth: # shows the drivers BlueZ, and nothing else of the system's D-Bus\n"
            f"    extends: {{file: {house}, service: bluetooth}}\n"
            "    volumes: [bluez:/run/dbus, /run/dbus/system_bus_socket:/run/host/system_bus_socket]\n"
        )
    for name in _others(wish):
        yield f"  {name}:\n    extends: {{file: {house}, service: {name}}}\n"


def _sensor(sensor: Sensor) -> str:
    kind = KINDS[sensor.kind]
    which = f"address:={sensor.device}" if ":" in sensor.device else f"name:={kind.advertised} {sensor.device}"
    return (
        f"  {sensor.sensor_id.replace('_', '-')}: # {kind.about} of {sensor.human_id}\n    <<: *polar\n    command: >\n"
        "      python -m driver_polar --ros-args\n"
        f"      -p sensor_id:={sensor.sensor_id}\n      -p human_id:={sensor.human_id}\n      -p model:={kind.model}\n"
        f'      -p "{which}"\n      -p "streams:=[{kind.streams}]"\n      -p "body_location:={kind.body_location}"\n'
    )


def _replay(house: str) -> str:
    return (
        "  replay: # BAG=/recordings/STUDY/PARTICIPANTS/SESSION make demo ...; without it, it waits for POST /play\n"
        f"    extends: {{file: {house}, service: replay}}\n"
        "    command: >\n      python -m replay --ros-args\n      -p 'bag:=\"${BAG:-}\"'\n"
        "      -p what:=raw\n      -p rate:=${RATE:-1.0}\n"
    )


def _bench(wish: Wish, house: str) -> str:
    """Return the service that plays the sensors: hearts of different rates, clocks of different speeds."""
    people = [
        f"{human_id}: {{heart_rate_bpm: {58 + 7 * number % 32}, face: face_{number}}}"
        for number, human_id in enumerate(wish.participants, 1)
    ]
    devices = [
        f"- {{sensor: {each.sensor_id}, model: {KINDS[each.kind].model}, participant: {each.human_id}, "
        f'device_id: {each.device}, address: "{_address(wish, each)}", skew_ppm: {(17.0 * number) % 80 - 40:.1f}}}'
        for number, each in enumerate(sensors(wish), 1)
    ]
    return (
        f"  sensor-bench: # who and what it plays: services/sensor-bench/README.md\n"
        f"    extends: {{file: {house}, service: sensor-bench}}\n    command:\n"
        + "".join(f"      - {word}\n" for word in ("python", "-m", "sensor_bench", "--ros-args", "-p"))
        + "      - socket_path:=/run/dbus/system_bus_socket\n      - -p\n      - |\n        devices:=|\n"
        + "          participants:\n"
        + "".join(f"            {line}\n" for line in people)
        + "          devices:\n"
        + "".join(f"            {line}\n" for line in devices)
    )


def _address(wish: Wish, sensor: Sensor) -> str:
    number = wish.participants.index(sensor.human_id) + 1
    return f"F1:4A:10:00:{wish.kinds.index(sensor.kind):02d}:{number:02d}"


def _others(wish: Wish) -> list[str]:
    """Return the services that a study has besides its sensors."""
    interpreters = sorted({KINDS[kind].interpreter for kind in wish.kinds or KINDS})
    computing = [] if wish.record_only else [*interpreters, "fusion-affect"]
    keeping = [] if wish.replay else ["recorder", "analysis"]
    asked = ["alertmanager", "grafana"] if "prometheus" in wish.extras else []  # run with COMPOSE_PROFILES alone
    return ["clock-sync", *computing, *keeping, "metadata-registry", "session-coordinator", *wish.extras, *asked]


def _volumes(wish: Wish) -> str:
    names = ["recordings", "registry", "session", *(["prometheus"] if "prometheus" in wish.extras else [])]
    named = "".join(f"  {name}:\n" for name in names)
    if wish.replay:
        return f"\nvolumes:\n{named}"
    if wish.virtual:
        return f"\nvolumes:\n{named}  radio: # the virtual sensors' D-Bus\n{TMPFS}"
    bluez = "  bluez: # as plain processes the drivers use this machine's D-Bus"
    return f"\nvolumes:\n{named}{bluez}\n{TMPFS}    x-process: /run/dbus\n"
