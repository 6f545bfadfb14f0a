"""Parameters of driver-bitalino, and what it declares of its streams."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from sense4hri.device import DriverConfig, Stream
from sense4hri.devices import NO_CLOCK, DeviceRow, Offered
from sense4hri.modalities import modality
from sense4hri.schema import parameter
from sense4hri.serial_port import ADDRESS, ADDRESS_FORM

from driver_bitalino.protocol import RATES
from driver_bitalino.sensors import SENSORS, FloatArray, acceleration, bits_of

CHANNEL = re.compile(rf"A([1-6]) *: *({'|'.join(SENSORS)})(?: +(\S.*))?")
EVERY = tuple(f"A{port}: {name}" for port, name in enumerate(("emg", "ecg", "eda", "eeg", "acc", "lux"), 1))
OTHERS = tuple(f"A{port}: {name}" for port, name in enumerate(("eog", "pzt", "egg", "tmp", "ppg", "raw"), 1))
LOSS = "4-bit number of each frame, exact up to 15 in a row; whole rounds of 16 by the host's clock"
LINK = "Bluetooth Classic (RFCOMM), any serial port, TCP"


def _row(device: str, channels: tuple[str, ...], seen_on: str) -> DeviceRow:
    """The row of a board with these channels."""
    sensors = [SENSORS[entry.partition(": ")[2]] for entry in channels]
    return DeviceRow(
        device=device,
        vendor="PLUX",
        streams={each.sensor_type: Offered(each.unit, min(RATES), max(RATES)) for each in sensors},
        reports=("markers of I1, I2",),
        clock=NO_CLOCK,
        loss=LOSS,
        link=LINK,
        seen_on=seen_on,
        chosen_by={"port": "/dev/rfcomm0", "channels": channels},
    )


DEVICES = (
    _row("BITalino (r)evolution", EVERY, "virtual"),
    _row("BITalino (r)evolution, further sensors", OTHERS, "virtual"),
)


class Channel(NamedTuple):
    """One acquired channel. values: of counts as shares of full scale; bits: of its converter."""

    port: int
    sensor: str
    sensor_type: str
    unit: str
    name: str
    bits: int
    values: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class BitalinoConfig(DriverConfig):
    """Which board, and what is plugged into it."""

    vendor: str = parameter("PLUX", help="who makes the device", settable=True)
    model: str = parameter("BITalino (r)evolution", help="name of the model", settable=True)
    port: str = parameter(
        help="where the board is",
        matches=ADDRESS,
        form=ADDRESS_FORM,
        example="rfcomm://20:16:00:00:00:00",
    )
    sampling_frequency_hz: int = parameter(1000, help="of all channels", unit="Hz", choices=tuple(RATES))
    channels: tuple[str, ...] = parameter(
        ("A2: ecg",),
        help="which sensor is plugged into which port, and its channel's name if it needs one: `A1: emg biceps`",
        matches=CHANNEL.pattern,
        form=f"A1 to A6, a colon, and one of {', '.join(SENSORS)}",
    )
    accelerometer_counts: tuple[int, ...] = parameter(
        (400, 600), help="what an axis of the accelerometer counts at -1 g and at 1 g; turn it slowly to find out"
    )
    digital_inputs: tuple[str, ...] = parameter(
        (), help="inputs of which each change becomes a marker of the study", choices=("I1", "I2")
    )
    battery_threshold: int = parameter(
        0, help="battery at which the board's LED lights: 0 = 3.4 V, 63 = 3.8 V", low=0, high=63
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        ports = [entry[:2] for entry in self.channels]
        if not ports or len(set(ports)) < len(ports):
            raise ValueError(f"channels {list(self.channels)}: at least one port, each at most once")
        if len(self.accelerometer_counts) != 2 or self.accelerometer_counts[0] >= self.accelerometer_counts[1]:
            raise ValueError(f"accelerometer_counts {list(self.accelerometer_counts)}: a smaller and a larger number")
        for sensor_type, names in self._names().items():
            if len(set(names)) < len(names):
                raise ValueError(f"channels {list(self.channels)}: two of {sensor_type} are called {names[0]!r}")

    def _names(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for channel in self.acquired:
            found.setdefault(channel.sensor_type, []).append(channel.name)
        return found

    @cached_property
    def acquired(self) -> tuple[Channel, ...]:
        """The channels in the order in which a frame holds them."""
        entries = [found.groups() for entry in sorted(self.channels) if (found := CHANNEL.fullmatch(entry))]
        types = [SENSORS[sensor].sensor_type for _, sensor, _ in entries]
        return tuple(
            self._channel(position, int(port), sensor, name or "", types.count(SENSORS[sensor].sensor_type) == 1)
            for position, (port, sensor, name) in enumerate(entries)
        )

    def _channel(self, position: int, port: int, word: str, name: str, alone: bool) -> Channel:
        """Return one channel; it is named by its port where nobody names it and others are of its kind."""
        sensor = SENSORS[word]
        usual = modality(sensor.sensor_type).channels
        own = (usual[0] if len(usual) == 1 else sensor.sensor_type) if alone else f"A{port}"
        values = acceleration(*self.accelerometer_counts) if word == "acc" else sensor.of_share
        return Channel(port, word, sensor.sensor_type, sensor.unit, name or own, bits_of(position), values)


def streams_of(config: BitalinoConfig) -> dict[str, Stream]:
    """Return what the driver declares of each raw stream: as many channels as there are sensors of the type."""
    found: dict[str, list[Channel]] = {}
    for channel in config.acquired:
        found.setdefault(channel.sensor_type, []).append(channel)
    return {sensor_type: _stream(config, channels) for sensor_type, channels in found.items()}


def _stream(config: BitalinoConfig, channels: list[Channel]) -> Stream:
    ends = np.array([channel.values(np.array([0.0, 1.0 - 2.0**-channel.bits])) for channel in channels])
    names = tuple(channel.name for channel in channels)
    bits = max(channel.bits for channel in channels)
    return Stream(
        float(config.sampling_frequency_hz), channels[0].unit, float(ends.min()), float(ends.max()), bits, names
    )
