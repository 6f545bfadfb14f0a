"""The bench's parameters; the participants and devices that it plays are one strict YAML text among them."""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

import yaml
from sense4hri.schema import Schema, parameter

from sensor_bench.ble.radio import LinkQuality
from sensor_bench.polar.models import MODELS
from sensor_bench.signals.recordings import UNITS, Playback, found_in

T = TypeVar("T")

LONGEST_SOCKET_PATH = 100
ADDRESS = re.compile(r"([0-9A-F]{2}:){5}[0-9A-F]{2}")
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
RANGES = (("battery_percent", 0, 100), ("rssi_dbm", -127, 20), ("rate_factor", 0.9, 1.1), ("skew_ppm", -1e4, 1e4))
DEVICE_ID = re.compile(r"[0-9A-F]{7,8}")


@dataclass(frozen=True)
class Participant:
    """A person: one heart, and what the robot's camera sees of them."""

    heart_rate_bpm: float = 66.0
    respiration_hz: float = 0.25
    pulse_transit_s: float = 0.28
    """From R peak to the pulse's systolic peak at the wrist."""
    face: str = ""
    """Face id on the ROS4HRI side; empty = no camera sees this person."""
    expression: str = "neutral"


@dataclass(frozen=True)
class VirtualDevice:
    """One virtual sensor as the configuration describes it."""

    sensor: str
    model: str
    address: str
    device_id: str
    participant: str
    serial_number: str = ""
    skew_ppm: float = 0.0
    clock_start: str = "2019-01-01T00:00:00"
    """What the device's own clock reads when the bench starts (its own time line, no zone)."""
    rate_factor: float = 1.0
    battery_percent: int = 90
    rssi_dbm: int = -55
    contact: bool = True
    down: bool = False
    ppi_delay_s: float = 25.0
    amplitude_uv: float = 1000.0
    noise_uv: float = 8.0
    link: LinkQuality = field(default_factory=LinkQuality)
    play: Mapping[str, Playback] = field(default_factory=dict)
    """Stream name (ecg, ppg, accelerometer) -> recording to play instead of the simulation."""


@dataclass(frozen=True)
class Cast:
    """Everyone and everything on the bench."""

    participants: Mapping[str, Participant]
    devices: tuple[VirtualDevice, ...]


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
DEVICES_NOTES = """\
One YAML text, because ROS parameters cannot be nested. Keys of a participant:
  heart_rate_bpm 66, respiration_hz 0.25, pulse_transit_s 0.28 (R peak -> systolic peak at the wrist),
  face "" (id of the face the camera sees; empty = none), expression neutral
Keys of a device (the first five are required):
  sensor (the bench's name for it), model (H10, VeritySense, OH1), participant, address, device_id
  (8 hex digits of "Polar H10 1A2B3C01"), serial_number (default: the device_id),
  skew_ppm 0 (its clock gains that on the host), clock_start "2019-01-01T00:00:00" (what its clock reads at first),
  rate_factor 1 (real over nominal sampling rate), battery_percent 90, rssi_dbm -55, contact true, down false,
  ppi_delay_s 25 (first pulse intervals after start), amplitude_uv 1000 and noise_uv 8 (simulated ECG),
  link: {latency_s 0.03, jitter_s 0.01 (mean extra delay), connection_interval_s 0 (grid of arrivals),
         loss 0 (probability that a data frame is never sent)}
  play: {ecg | ppg | accelerometer: FILE}, or instead of FILE: {file, fs_hz, column, unit, gain}; see the README"""


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
        notes=DEVICES_NOTES,
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
    devices = tuple(
        dataclasses.replace(device, play=_playable(device, playbacks)) if device.participant == first else device
        for device in cast.devices
    )
    return Cast(cast.participants, devices)


def _playable(device: VirtualDevice, playbacks: Mapping[str, Playback]) -> Mapping[str, Playback]:
    streams = {stream.name for stream in MODELS[device.model].streams}
    return {name: playback for name, playback in playbacks.items() if name in streams} or device.play


def _build(kind: type[T], given: Any, where: str) -> T:
    """A dataclass from a mapping; every unknown, missing or mistyped key is named."""
    if not isinstance(given, dict):
        raise ValueError(f"{where}: expected keys and values, got {given!r}")
    known = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if unknown := sorted(set(map(str, given)) - set(known)):
        raise ValueError(f"{where}: unknown key {unknown[0]!r}; known are {', '.join(known)}")
    values = {}
    for name, f in known.items():
        if name not in given:
            if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
                raise ValueError(f"{where}: {name} is missing")
            continue
        values[name] = _value(f, given[name], f"{where}.{name}")
    return kind(**values)


def _value(f: "dataclasses.Field[Any]", given: Any, where: str) -> Any:
    if f.type is LinkQuality:
        return _build(LinkQuality, given, where)
    if f.name == "play":
        return _playbacks(given, where)
    if f.type is float and isinstance(given, int) and not isinstance(given, bool):
        return float(given)
    expected = f.type if isinstance(f.type, type) else object
    if type(given) is not expected:
        raise ValueError(f"{where}: expected {expected.__name__}, got {given!r}")
    return given


def _playbacks(given: Any, where: str) -> dict[str, Playback]:
    """`stream: path`, or `stream: {file: path, fs_hz: .., column: .., unit: .., gain: ..}`."""
    if not isinstance(given, dict):
        raise ValueError(f"{where}: expected streams and recordings, got {given!r}")
    return {
        str(stream): _build(Playback, {"file": entry} if isinstance(entry, str) else entry, f"{where}.{stream}")
        for stream, entry in given.items()
    }


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
    participants = {
        _identifier(str(name), "participants"): _build(Participant, values or {}, f"participants.{name}")
        for name, values in given["participants"].items()
    }
    devices = tuple(_build(VirtualDevice, values, f"devices[{i}]") for i, values in enumerate(given["devices"]))
    for i, device in enumerate(devices):
        _check(device, participants, f"devices[{i}]")
    for name in ("sensor", "address", "device_id"):
        values = [getattr(device, name) for device in devices]
        if doubles := {value for value in values if values.count(value) > 1}:
            raise ValueError(f"devices: {name} {sorted(doubles)[0]!r} is used twice")
    return Cast(participants, devices)


def _identifier(name: str, where: str) -> str:
    if not IDENTIFIER.fullmatch(name):
        raise ValueError(f"{where}: {name!r} is no identifier (letters, digits, underscore; a letter first)")
    return name


def _check(device: VirtualDevice, participants: Mapping[str, Participant], where: str) -> None:
    _identifier(device.sensor, f"{where}.sensor")
    if device.model not in MODELS:
        raise ValueError(f"{where}.model: {device.model!r} is not one of {', '.join(MODELS)}")
    if not ADDRESS.fullmatch(device.address):
        raise ValueError(f"{where}.address: {device.address!r} is no upper-case Bluetooth address")
    if not DEVICE_ID.fullmatch(device.device_id):
        raise ValueError(f"{where}.device_id: {device.device_id!r} is not 7 or 8 upper-case hexadecimal digits")
    if device.participant not in participants:
        raise ValueError(f"{where}.participant: {device.participant!r} is not among the participants")
    for name, low, high in RANGES:
        if not low <= getattr(device, name) <= high:
            raise ValueError(f"{where}.{name}: {getattr(device, name)!r} is not within {low}..{high}")
    playable = [stream.name for stream in MODELS[device.model].streams if stream.name in UNITS]
    for name, playback in device.play.items():
        if name not in playable:
            raise ValueError(f"{where}.play: a {device.model} plays {', '.join(playable)}, not {name!r}")
        if not Path(playback.file).exists():
            raise ValueError(f"{where}.play.{name}: no such file: {playback.file}")
    try:
        start = datetime.fromisoformat(device.clock_start)
    except ValueError as error:
        raise ValueError(f"{where}.clock_start: {error}") from error
    if start.year < 2000:
        raise ValueError(f"{where}.clock_start: {device.clock_start!r} is before 2000, where the device's time begins")
