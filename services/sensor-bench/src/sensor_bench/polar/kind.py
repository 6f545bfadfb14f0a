"""Polar sensors as a kind of the bench: the keys of a device, and what it is made of."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from re import compile as pattern
from typing import ClassVar, Self

from sensor_bench.ble.peripheral import BleKeys
from sensor_bench.clock import DeviceClock
from sensor_bench.device import Kind
from sensor_bench.polar.body import Body, Identity
from sensor_bench.polar.control import ControlPoint
from sensor_bench.polar.firmware import Firmware
from sensor_bench.polar.models import MODELS, Stream
from sensor_bench.polar.peripheral import Peripheral, polar_ns
from sensor_bench.polar.pmd import Setting
from sensor_bench.room import Room
from sensor_bench.signals.playback import PlaybackSource
from sensor_bench.signals.recordings import UNITS, Playback, load
from sensor_bench.signals.sources import EcgSource, MotionSource, PpgSource, Source, Wearing
from sensor_bench.signals.waveforms import stored

DEVICE_ID = pattern(r"[0-9A-F]{7,8}")
EARTH_FIELD_GAUSS = (0.2, 0.05, -0.42)


@dataclass(frozen=True, kw_only=True)
class PolarKeys(BleKeys):
    """One Polar sensor as the configuration describes it."""

    device_id: str
    serial_number: str = ""
    skew_ppm: float = 0.0
    clock_start: str = "2019-01-01T00:00:00"
    """What the device's own clock reads when the bench starts (its own time line, no zone)."""
    rate_factor: float = 1.0
    ppi_delay_s: float = 25.0
    amplitude_uv: float = 1000.0
    noise_uv: float = 8.0
    play: Mapping[str, Playback] = field(default_factory=dict)
    """Stream name (ecg, ppg, accelerometer) -> recording to play instead of the simulation."""

    unique: ClassVar[tuple[str, ...]] = (*BleKeys.unique, "device_id")
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        *BleKeys.ranges,
        ("rate_factor", 0.9, 1.1),
        ("skew_ppm", -1e4, 1e4),
    )

    def check(self) -> None:
        super().check()
        if not DEVICE_ID.fullmatch(self.device_id):
            raise ValueError(f"device_id: {self.device_id!r} is not 7 or 8 upper-case hexadecimal digits")
        playable = [stream.name for stream in MODELS[self.model].streams if stream.name in UNITS]
        for name, playback in self.play.items():
            if name not in playable:
                raise ValueError(f"play: a {self.model} plays {', '.join(playable)}, not {name!r}")
            if not Path(playback.file).exists():
                raise ValueError(f"play.{name}: no such file: {playback.file}")
        try:
            start = datetime.fromisoformat(self.clock_start)
        except ValueError as error:
            raise ValueError(f"clock_start: {error}") from error
        if start.year < 2000:
            raise ValueError(f"clock_start: {self.clock_start!r} is before 2000, where the device's time begins")

    def recordings(self) -> Mapping[str, Playback]:
        return self.play

    def playing(self, recordings: Mapping[str, Playback]) -> Self:
        streams = {stream.name for stream in MODELS[self.model].streams}
        playable = {name: playback for name, playback in recordings.items() if name in streams}
        return dataclasses.replace(self, play=playable or self.play)


def make(room: Room, keys: PolarKeys) -> Peripheral:
    """A sensor on its participant."""
    model = MODELS[keys.model]
    wearing = Wearing(keys.contact)
    body = Body(
        room.hearts[keys.participant],
        wearing,
        _sources(room, keys, wearing),
        pulse_delay_s=0.0 if model.has_rr else room.participants[keys.participant].pulse_transit_s,
    )
    firmware = Firmware(
        body,
        ControlPoint(model),
        room.host,
        DeviceClock(room.start_ns, polar_ns(keys.clock_start), keys.skew_ppm),
        room.start_ns,
        keys.rate_factor,
        keys.ppi_delay_s,
    )
    return Peripheral(room, keys, Identity(keys.device_id, keys.serial_number or keys.device_id, model), firmware)


def _sources(room: Room, keys: PolarKeys, wearing: Wearing) -> dict[str, Source]:
    heart, waveforms = room.hearts[keys.participant], stored()
    transit_s = room.participants[keys.participant].pulse_transit_s

    def seed(stream: str) -> int:
        return room.seed_of(keys.sensor, stream)

    made: dict[str, Source] = {}
    for stream in MODELS[keys.model].streams:
        unit = stream.factor or 1.0
        if stream.name in keys.play:
            made[stream.name] = _playback(keys, stream)
        elif stream.name == "ecg":
            made["ecg"] = EcgSource(heart, wearing, waveforms, seed("ecg"), keys.amplitude_uv, keys.noise_uv)
        elif stream.name == "ppg":
            made["ppg"] = PpgSource(heart, wearing, waveforms, seed("ppg"), transit_s)
        elif stream.name == "accelerometer":
            # in a compressed frame counts are g over the factor, in a raw one milli-g
            scale = 1.0 if stream.factor else 1000.0
            at_rest = tuple(scale * g for g in (-0.12, -0.95, 0.28))
            made["accelerometer"] = MotionSource(
                heart, seed("accelerometer"), at_rest, breath=0.012 * scale, noise=0.004 * scale, unit=unit
            )
        elif stream.name == "gyroscope":
            made["gyroscope"] = MotionSource(heart, seed("gyroscope"), (0.3, -0.2, 0.1), 0.8, 0.3, unit)
        elif stream.name == "magnetometer":
            made["magnetometer"] = MotionSource(heart, seed("magnetometer"), EARTH_FIELD_GAUSS, 0.001, 0.004, unit)
    return made


def _playback(keys: PolarKeys, stream: Stream) -> PlaybackSource:
    counts_per_unit = 1.0
    if stream.name == "accelerometer":
        counts_per_unit = 1.0 / stream.factor if stream.factor else 1000.0
    rates_hz = [rate * keys.rate_factor for rate in stream.offer[Setting.RATE]]
    recording = load(keys.play[stream.name], stream.name)
    return PlaybackSource(recording, counts_per_unit, stream.channels, stream.sample_bytes, rates_hz)


POLAR = Kind(
    tuple(MODELS),
    PolarKeys,
    make,
    'device_id (required: 8 hex digits of "Polar H10 1A2B3C01"), serial_number (default: the device_id), '
    'skew_ppm 0 (its clock gains that on the host), clock_start "2019-01-01T00:00:00" (what its clock reads at first), '
    "rate_factor 1 (real over nominal sampling rate), ppi_delay_s 25 (first pulse intervals after start), "
    "amplitude_uv 1000 and noise_uv 8 (simulated ECG), "
    "play {ecg | ppg | accelerometer: FILE}, or instead of FILE: {file, fs_hz, column, unit, gain}; see the README",
)
