"""The bench's parameters; the participants and devices that it plays are one strict YAML text among them."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from sense4hri.schema import Schema, parameter

from sensor_bench.device import DeviceKeys, check_identifier
from sensor_bench.keys import build
from sensor_bench.kinds import BY_MODEL, KINDS
from sensor_bench.room import Participant
from sensor_bench.signals.recordings import found_in

LONGEST_SOCKET_PATH = 100


@dataclass(frozen=True)
class Cast:
    """Everyone and everything on the bench."""

    participants: Mapping[str, Participant]
    devices: tuple[DeviceKeys, ...]


DEFAULT_DEVICES = """
participants:
  p1: {heart_rate_bpm: 64, face: face_a, expression: neutral}
  p2: {heart_rate_bpm: 82, face: face_b, expression: happy}
devices:
  - {sensor: h10_1, model: H10, participant: p1, address: "F1:4A:10:00:00:01", device_id: 1A2B3C01,
     skew_ppm: 38.0, rate_factor: 1.00131, rssi_dbm: -52, battery_percent: 88}
  - {sensor: verity_1, model: VeritySense, participant: p1, address: "F1:4A:10:00:00:02", device_id: 1A2B3C02,
     skew_ppm: -21.0, rate_factor: 0.9962, rssi_dbm: -61, battery_percent: 74, clock_start: "2026-01-01T08:00:00"}
  - {sensor: h10_2, model: H10, participant: p2, address: "F1:4A:10:00:00:03", device_id: 1A2B3C03,
     skew_ppm: -55.0, rate_factor: 0.99925, rssi_dbm: -58, battery_percent: 61}
  - {sensor: verity_2, model: VeritySense, participant: p2, address: "F1:4A:10:00:00:04", device_id: 1A2B3C04,
     skew_ppm: 14.0, rate_factor: 0.9958, rssi_dbm: -66, battery_percent: 93, clock_start: "2026-01-01T08:00:00"}
"""
COMMON_NOTES = """\
One YAML text, because ROS parameters cannot be nested. Keys of a participant:
  heart_rate_bpm 66, respiration_hz 0.25, pulse_transit_s 0.28 (R peak -> systolic peak at the wrist),
  face "" (id of the face the camera sees; empty = none), expression neutral
Keys of every device, all required: sensor (the bench's name for it), model (says which kind it is), participant.
Keys of a Bluetooth LE device: address (required), battery_percent 90, rssi_dbm -55, contact true, down false,
  link: {latency_s 0.03, jitter_s 0.01 (mean extra delay), connection_interval_s 0 (grid of arrivals),
         loss 0 (probability that a data frame is never sent)}
Keys of a device on a wire: at (required: a path for a Unix socket, pty:path, socket://host:port), down false,
  byte_errors 0 (probability of each byte), link: {latency_s 0.03, jitter_s 0.01, loss 0 (of each frame)}
Beside these, each kind has its own:
"""
LINE = 116


def devices_notes() -> str:
    """Return the keys of the `devices` text, in lines: those that all have, then each kind's own."""
    own: dict[str, list[str]] = {}
    for kind in KINDS:
        own.setdefault(kind.notes, []).extend(kind.models)
    lines = [f"{', '.join(models)}: {notes}" for notes, models in own.items() if notes]
    return COMMON_NOTES + "\n".join(textwrap.fill(line, LINE, subsequent_indent="  ") for line in lines)


@dataclass(frozen=True)
class BenchConfig(Schema):
    """The ROS parameters of the bench."""

    socket_path: str = parameter(
        "/tmp/sense4hri-bench/bus",
        help="Unix socket of the private D-Bus, for clients DBUS_SYSTEM_BUS_ADDRESS=unix:path=<this>; "
        "in use by another bench: status 78",
        matches=f"/.{{1,{LONGEST_SOCKET_PATH - 1}}}",
        form=f"an absolute path of at most {LONGEST_SOCKET_PATH} characters",
    )
    adapter: str = parameter("hci0", help="name of the virtual Bluetooth adapter", matches=r"hci\d+", form="like hci0")
    adapter_present: bool = parameter(True, help="the adapter is plugged in at the start")
    adapter_powered: bool = parameter(True, help="the adapter is switched on at the start")
    device_timeout_s: float = parameter(
        30.0, help="a device not seen that long is forgotten, as bluetoothd does", unit="s", low=0.1
    )
    seed: int = parameter(1, help="all randomness (rhythm, noise, jitter, loss) comes from this", low=0)
    input: str = parameter(
        "",
        help="a recording for the first participant's devices to play: a WFDB header, a Polar Sensor Logger export, or "
        "columns of numbers in a file named like rest_100hz.csv; empty = none; `play` below says more exactly",
    )
    ros4hri: bool = parameter(
        True,
        help="play faces, expressions and persons as hri_face_detect, hri_emotion_recognizer and hri_person_manager do",
    )
    expression_interval_s: float = parameter(0.5, help="period of /humans/faces/<face>/expression", unit="s", low=0.01)
    stamp_expressions: bool = parameter(False, help="stamp the expressions; the real recogniser never does")
    truth_window_s: float = parameter(600.0, help="GET /truth lists the beats of that long past", unit="s", low=1)
    devices: str = parameter(
        DEFAULT_DEVICES,
        help="who and what is on the bench: by default two participants, each with an H10 and a Verity Sense",
        notes=devices_notes(),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.input and not Path(self.input).is_file():
            raise ValueError(f"input: no such file: {self.input}")
        self.cast()

    def cast(self) -> Cast:
        """Everyone on the bench, the first participant's devices playing `input` where it is given."""
        try:
            cast = parse(self.devices)
        except ValueError as error:
            raise ValueError(f"devices: {error}") from error
        return with_input(cast, self.input) if self.input else cast


def with_input(cast: Cast, path: str) -> Cast:
    """Let the first participant's devices play what they can of one recording; ValueError if it is none."""
    try:
        playbacks = found_in(path)
    except ValueError as error:
        raise ValueError(f"input: {error}") from error
    first = next(iter(cast.participants))
    devices = tuple(device.playing(playbacks) if device.participant == first else device for device in cast.devices)
    return Cast(cast.participants, devices)


def parse(text: str) -> Cast:
    """Read the `devices` parameter; ValueError names the place."""
    try:
        given = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML: {error}") from error
    if not isinstance(given, dict) or set(given) != {"participants", "devices"}:
        raise ValueError("expected exactly the keys participants and devices")
    if not isinstance(given["participants"], dict) or not isinstance(given["devices"], list):
        raise ValueError("participants must be a table, devices a list")
    participants = {str(name): _participant(str(name), values) for name, values in given["participants"].items()}
    devices = tuple(_device(values, participants, f"devices[{i}]") for i, values in enumerate(given["devices"]))
    for name in dict.fromkeys(name for device in devices for name in device.unique):
        values = [getattr(device, name) for device in devices if name in device.unique]
        if doubles := {value for value in values if values.count(value) > 1}:
            raise ValueError(f"devices: {name} {sorted(doubles)[0]!r} is used twice")
    return Cast(participants, devices)


def _participant(name: str, values: Any) -> Participant:
    check_identifier(name, "participants")
    return build(Participant, values or {}, f"participants.{name}")


def _device(values: Any, participants: Mapping[str, Participant], where: str) -> DeviceKeys:
    """The keys of one device, as its model's kind wants them."""
    if not isinstance(values, dict):
        raise ValueError(f"{where}: expected keys and values, got {values!r}")
    if "model" not in values:
        raise ValueError(f"{where}: model is missing")
    kind = BY_MODEL.get(str(values["model"]))
    if kind is None:
        raise ValueError(f"{where}.model: {values['model']!r} is not one of {', '.join(BY_MODEL)}")
    device = build(kind.keys, values, where)
    if device.participant not in participants:
        raise ValueError(f"{where}.participant: {device.participant!r} is not among the participants")
    try:
        device.check()
    except ValueError as error:
        raise ValueError(f"{where}.{error}") from error
    return device
