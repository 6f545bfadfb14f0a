"""What really happened, for whoever checks the services: clocks, beats, samples. Plain JSON-ready values."""

import dataclasses
from typing import Any

from sensor_bench.bench import Bench
from sensor_bench.config import VirtualDevice
from sensor_bench.polar.peripheral import Peripheral
from sensor_bench.signals.playback import RecordedHeart


def truth(bench: Bench, window_s: float) -> dict[str, Any]:
    """State of all clocks now, counts since the start, beats of the last `window_s` (and none of the future)."""
    host_ns = bench.host.now_ns()
    return {
        "host_ns": host_ns,
        "start_ns": bench.start_ns,
        "wall_minus_host_ns": bench.host.wall_offset_ns(),
        "window_s": window_s,
        "participants": {name: _participant(bench, name, host_ns, window_s) for name in bench.hearts},
        "devices": {
            name: _sensor(bench, peripheral, host_ns, window_s) for name, peripheral in bench.peripherals.items()
        },
    }


def _beats_ns(bench: Bench, participant: str, host_ns: int, window_s: float, delay_s: float = 0.0) -> list[int]:
    now_s = (host_ns - bench.start_ns) * 1e-9
    beats = bench.hearts[participant].beats(max(0.0, now_s - window_s) - delay_s, now_s - delay_s)
    return [bench.start_ns + round((beat.time_s + delay_s) * 1e9) for beat in beats]


def _participant(bench: Bench, name: str, host_ns: int, window_s: float) -> dict[str, Any]:
    heart = bench.hearts[name]
    recorded = isinstance(heart, RecordedHeart)
    return {
        "source": "recording, beats found by neurokit2" if recorded else "simulation",
        "heart_rate_bpm": heart.heart_rate_bpm,
        "respiration_hz": heart.respiration_hz,
        "pulse_transit_s": bench.cast.participants[name].pulse_transit_s,
        "beats_host_ns": _beats_ns(bench, name, host_ns, window_s),
    }


def _device(bench: Bench, peripheral: Peripheral) -> VirtualDevice:
    return next(device for device in bench.cast.devices if device.sensor == peripheral.identity.sensor)


def _sensor(bench: Bench, peripheral: Peripheral, host_ns: int, window_s: float) -> dict[str, Any]:
    """One device; its clock reads `reference_device_ns` at `reference_host_ns` and gains `skew_ppm` on the host.

    `beats_*` are R peaks for a strap, systolic peaks of the pulse for an optical sensor.
    """
    device = _device(bench, peripheral)
    beats_ns = _beats_ns(bench, device.participant, host_ns, window_s, peripheral.firmware.body.pulse_delay_s)
    return {
        "participant": device.participant,
        "connected": peripheral.connection is not None,
        "connections_total": peripheral.connections_total,
        "reference_host_ns": host_ns,
        "reference_device_ns": peripheral.firmware.clock.read_ns(host_ns),
        "skew_ppm": peripheral.firmware.clock.at(host_ns).skew_ppm,
        "clock_resets": peripheral.firmware.clock.resets,
        "clock_segments": [segment._asdict() for segment in peripheral.firmware.clock.segments],
        "beats_host_ns": beats_ns,
        "beats_device_ns": [peripheral.firmware.clock.read_ns(beat_ns) for beat_ns in beats_ns],
        "streams": {
            name: dataclasses.asdict(counts) | {"rate_factor": peripheral.firmware.rate_factor}
            for name, counts in peripheral.firmware.counts.items()
        },
    }


def devices(bench: Bench) -> list[dict[str, Any]]:
    """The virtual devices and the present position of their knobs."""
    return [
        {
            "sensor": peripheral.identity.sensor,
            "model": _device(bench, peripheral).model,
            "name": peripheral.identity.name,
            "address": peripheral.identity.address,
            "connected": peripheral.connection is not None,
            "streaming": [kind.name.lower() for kind in peripheral.firmware.control.running],
            "sdk_mode": peripheral.firmware.control.sdk_mode,
            "knobs": dataclasses.asdict(peripheral.radio.quality)
            | {
                "battery_percent": peripheral.battery_percent,
                "rssi_dbm": peripheral.rssi_dbm,
                "contact": peripheral.firmware.body.wearing.contact,
                "skew_ppm": peripheral.firmware.clock.segments[-1].skew_ppm,
                "heart_rate_bpm": peripheral.firmware.body.heart.heart_rate_bpm,
                "down": peripheral.down,
            },
        }
        for peripheral in bench.peripherals.values()
    ]
