"""The kinds of sensors that `make study` offers: each is a row of its driver's `DEVICES`, which docs/devices.md shows.

What a driver starts with and what it streams are in the row; here is what only a study knows: how it is called on a
command line, where its link goes, and what `sensor-bench` plays in its place.
"""

import functools
import importlib
import re
from collections.abc import Mapping
from enum import Enum
from typing import Any, NamedTuple

from sense4hri.devices import DeviceRow
from study_file import SERVICES

PRINTED = re.compile(r"[0-9A-Za-z]{8}")
"""The id on a sensor whose name ends with it."""
ADDRESS = re.compile(r"[0-9A-Fa-f]{2}(:[0-9A-Fa-f]{2}){5}")
OTHER_ID = re.compile(r"(?!\d+([.:]\d+)?$)[\w./:-][\w ./:-]{0,98}")
"""A name, a port or an address, as it stands in a command; what YAML takes for a number is none."""
UNKNOWN_ID = "00000000"
INTERPRETER = "interpreter-"
MOTION = "accelerometer"
"""Sensor type of interpreter-motion; what a session waits for only where a device has nothing else."""


class Link(Enum):
    """How a driver reaches its device, and so what its container needs."""

    BLUETOOTH = "bluetooth"
    WIRE = "wire"
    NETWORK = "network"
    LSL = "lsl"
    FILE = "file"


class Kind(NamedTuple):
    """One kind of sensor.

    driver: without `driver-`. device: how its row's device begins. words: parameters beside the row's, `{id}` is the
    device's own; they stand in the place of the row's of the same name. unknown: the id before it is put in, `{n}` for
    the participant's number from 0. model: what plays it, "" = nothing does; played: keys of the sensor-bench's device
    besides sensor, model and participant. streams: sensor types where the row says that any may come. mounts: folder
    beside the ready studies -> in the container.
    """

    driver: str
    device: str
    about: str
    link: Link
    words: Mapping[str, str]
    unknown: str
    model: str = ""
    played: str = ""
    streams: tuple[str, ...] = ()
    mounts: Mapping[str, str] = {}

    @property
    def row(self) -> DeviceRow:
        """Its row of docs/devices.md. Raises LookupError where the driver has none."""
        return _row(self.driver, self.device)

    @property
    def parameters(self) -> dict[str, str]:
        """Its driver's parameters, as YAML, `{id}` in the place of the device's own."""
        own = {} if self.streams else {name: _yaml(value) for name, value in self.row.chosen_by.items()}
        return own | dict(self.words)

    @property
    def required(self) -> tuple[str, ...]:
        """The sensor types that a session waits for: those that somebody makes features of."""
        given = self.streams or tuple(self.row.streams)
        found = tuple(each for each in given if (SERVICES / f"{INTERPRETER}{each.replace('_', '-')}").is_dir())
        return found or tuple(each for each in given if each == MOTION)

    @property
    def interpreters(self) -> tuple[str, ...]:
        """Who makes features of them."""
        return tuple(INTERPRETER + ("motion" if each == MOTION else each.replace("_", "-")) for each in self.required)


@functools.cache
def _row(driver: str, device: str) -> DeviceRow:
    rows: tuple[DeviceRow, ...] = importlib.import_module(f"driver_{driver.replace('-', '_')}.config").DEVICES
    found = [row for row in rows if row.device.startswith(device)]
    if not found:
        raise LookupError(f"driver-{driver} has no device {device!r}; it has {', '.join(row.device for row in rows)}")
    return found[0]


def fits(kind: Kind, device: str) -> str:
    """Return what an id of this kind must be, "" where this one is."""
    if kind.link is Link.FILE:
        return "it has none: name the file in the study"
    if kind.link is Link.WIRE and device.startswith("/dev/") and ":" in device:
        return "a path without ':', as in /dev/serial/by-id/..., for Docker takes the rest for another path"
    if kind.unknown == UNKNOWN_ID:
        right = PRINTED.fullmatch(device) or ADDRESS.fullmatch(device)
        return "" if right else "8 digits and letters as printed on it, or A0:9E:1A:00:00:00"
    return (
        ""
        if OTHER_ID.fullmatch(device)
        else f"its name, port or address, as in {kind.unknown.replace('{n}', '0') or 'EEG of p1'}"
    )


def _yaml(value: Any) -> str:
    """Return a parameter's value as one writes it; texts with a colon are quoted."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    return f'\\"{value}\\"' if ": " in str(value) else str(value)


def _polar(device: str, advertised: str, streams: str, body_location: str, about: str) -> Kind:
    words = {"name": f"{advertised} {{id}}", "streams": f"[{streams}]", "body_location": body_location}
    model = {"H10": "H10", "Verity Sense": "VeritySense", "OH1": "OH1"}[device]
    return Kind("polar", f"Polar {device}", about, Link.BLUETOOTH, words, "00000000", model, "device_id: {id}")


def _heart_rate(device: str, model: str, about: str) -> Kind:
    row = f"any {device} with"
    words = {"name": "{id}"}
    return Kind("ble-heart-rate", row, about, Link.BLUETOOTH, words, "HRM 00000000", model, "name: {id}")


def _shimmer(board: str, about: str, model: str = "") -> Kind:
    return Kind("shimmer", f"Shimmer3 {board}", about, Link.WIRE, {"port": "{id}"}, "/dev/rfcomm{n}", model)


def _brainflow(device: str, about: str, link: Link, words: Mapping[str, str], unknown: str, model: str = "") -> Kind:
    return Kind("brainflow", device, about, link, words, unknown, model)


def _eyes(device: str, about: str, name: str, model: str, port: int) -> Kind:
    words = {"model": name, "address": "{id}", "port": str(port)}
    return Kind("pupil-labs", device, about, Link.NETWORK, words, "eyes-{n}.local", model)


def _outlet(about: str, model: str, *streams: str) -> Kind:
    words = {"outlets": "[\\\"name='{id}'\\\"]"}
    return Kind("lsl", "any LSL stream", about, Link.LSL, words, "", model, "name: {id}", streams)


KINDS = {
    "h10": _polar("H10", "Polar H10", "ecg, accelerometer, heart_rate", "chest", "chest strap"),
    "verity": _polar("Verity Sense", "Polar Sense", "ppg, accelerometer, pp_interval", "upper arm", "optical arm band"),
    "oh1": _polar("OH1", "Polar OH1", "ppg, accelerometer, pp_interval", "upper arm", "optical arm band"),
    "strap": _heart_rate("chest strap", "HeartRateStrap", "chest strap of any maker"),
    "watch": _heart_rate("watch or arm band", "HeartRateWatch", "watch of any maker"),
    "oximeter": _heart_rate("pulse oximeter", "PulseOximeter", "pulse oximeter of any maker"),
    "vernier": Kind(
        "vernier",
        "Vernier Go Direct",
        "respiration belt",
        Link.BLUETOOTH,
        {"name": "GDX-RB {id}"},
        "00000000",
        "GDX-RB",
        "device_id: {id}",
    ),
    "bioharness": Kind(
        "bioharness", "BioHarness", "BioHarness", Link.WIRE, {"port": "{id}"}, "/dev/rfcomm{n}", "BioHarness3"
    ),
    "shimmer": _shimmer("GSR+", "Shimmer3 GSR+", "Shimmer3"),
    "shimmer-ecg": _shimmer("ECG", "Shimmer3 ECG"),
    "shimmer-emg": _shimmer("EMG", "Shimmer3 EMG"),
    "shimmer-imu": _shimmer("IMU", "Shimmer3 IMU"),
    "bitalino": Kind(
        "bitalino",
        "BITalino (r)evolution",
        "BITalino",
        Link.WIRE,
        {"port": "{id}", "channels": '[\\"A2: ecg\\", \\"A3: eda\\", \\"A4: pzt\\"]'},
        "/dev/rfcomm{n}",
        "BITalino",
        "ports: {A2: ecg, A3: eda, A4: pzt}",
        ("ecg", "eda", "respiration"),
    ),
    "serial": Kind(
        "serial",
        "any microcontroller",
        "microcontroller",
        Link.WIRE,
        {"port": "{id}", "board": "/boards/board.yaml"},
        "/dev/ttyUSB{n}",
        "Board",
        "",
        ("eda", "respiration", "ppg"),
        {"serial": "/boards"},
    ),
    "muse": _brainflow(
        "Muse 2", "Muse headband", Link.BLUETOOTH, {"mac_address": "{id}"}, "00:00:00:00:00:00", "Muse2"
    ),
    "cyton": _brainflow("OpenBCI Cyton", "OpenBCI Cyton", Link.WIRE, {"serial_port": "{id}"}, "/dev/ttyUSB{n}"),
    "core": _eyes("Pupil Core", "Pupil Core", "Core", "PupilCore", 50020),
    "neon": _eyes("Pupil Labs Neon", "Neon", "Neon", "Neon", 8080),
    "invisible": _eyes("Pupil Labs Invisible", "Invisible", "Invisible", "Invisible", 8080),
    "lsl-eeg": _outlet("EEG over LSL", "LslEeg", "eeg"),
    "lsl-ecg": _outlet("ECG over LSL", "LslEcg", "ecg"),
    "lsl-gaze": _outlet("gaze over LSL", "LslGaze", "eye_tracking"),
    "file": Kind(
        "file",
        "any recording",
        "recorded ECG",
        Link.FILE,
        {"file": "/signals/body.hea", "streams": '[\\"ecg: ecg\\"]'},
        "",
        streams=("ecg",),
        mounts={"nine-modalities": "/signals"},
    ),
}
"""By the name on the command line, which begins the sensor_ids."""
