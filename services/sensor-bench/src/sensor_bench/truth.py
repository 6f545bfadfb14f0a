"""What really happened, for whoever checks the services: clocks, beats, samples. Times are in ns."""

from dataclasses import asdict, dataclass

from sensor_bench.bench import Bench
from sensor_bench.config import VirtualDevice
from sensor_bench.polar.body import Counts
from sensor_bench.polar.peripheral import Peripheral
from sensor_bench.signals.playback import RecordedHeart


@dataclass(frozen=True)
class Participant:
    """A heart; `beats_host_ns` are its R peaks on the host's clock."""

    source: str
    heart_rate_bpm: float
    respiration_hz: float
    pulse_transit_s: float
    beats_host_ns: list[int]


@dataclass(frozen=True)
class ClockSegment:
    """From `host_ns` on the device's clock reads `device_ns`, and gains `skew_ppm` on the host."""

    host_ns: int
    device_ns: int
    skew_ppm: float


@dataclass(frozen=True)
class StreamCounts:
    """What became of a stream's samples since the bench's start; `rate_factor`: true rate over the nominal one."""

    samples_sent: int
    samples_lost: int
    frames_sent: int
    frames_lost: int
    rate_factor: float


@dataclass(frozen=True)
class Sensor:
    """One device; its clock reads `reference_device_ns` at `reference_host_ns` and gains `skew_ppm` on the host.

    No packet of its link comes sooner than `smallest_delay_s`, as the link is now. `beats_*` are R peaks for a strap,
    systolic peaks of the pulse for an optical sensor.
    """

    participant: str
    connected: bool
    connections_total: int
    reference_host_ns: int
    reference_device_ns: int
    skew_ppm: float
    smallest_delay_s: float
    clock_resets: int
    clock_segments: list[ClockSegment]
    beats_host_ns: list[int]
    beats_device_ns: list[int]
    streams: dict[str, StreamCounts]


@dataclass(frozen=True)
class Truth:
    """State of all clocks now, counts since the start, beats of the last `window_s`, none of the future."""

    host_ns: int
    start_ns: int
    wall_minus_host_ns: int
    window_s: float
    participants: dict[str, Participant]
    devices: dict[str, Sensor]


@dataclass(frozen=True)
class Stand:
    """Where the knobs of one device stand."""

    latency_s: float
    jitter_s: float
    connection_interval_s: float
    loss: float
    battery_percent: int
    rssi_dbm: int
    contact: bool
    skew_ppm: float
    heart_rate_bpm: float
    down: bool


@dataclass(frozen=True)
class Device:
    """A virtual device."""

    sensor: str
    model: str
    name: str
    address: str
    connected: bool
    streaming: list[str]
    sdk_mode: bool
    knobs: Stand


def truth(bench: Bench, window_s: float) -> Truth:
    """What really happened, with the beats of the last window_s."""
    host_ns = bench.host.now_ns()
    return Truth(
        host_ns,
        bench.start_ns,
        bench.host.wall_offset_ns(),
        window_s,
        {name: _participant(bench, name, host_ns, window_s) for name in bench.hearts},
        {name: _sensor(bench, peripheral, host_ns, window_s) for name, peripheral in bench.peripherals.items()},
    )


def _beats_ns(bench: Bench, participant: str, host_ns: int, window_s: float, delay_s: float = 0.0) -> list[int]:
    now_s = (host_ns - bench.start_ns) * 1e-9
    beats = bench.hearts[participant].beats(max(0.0, now_s - window_s) - delay_s, now_s - delay_s)
    return [bench.start_ns + round((beat.time_s + delay_s) * 1e9) for beat in beats]


def _participant(bench: Bench, name: str, host_ns: int, window_s: float) -> Participant:
    heart = bench.hearts[name]
    recorded = isinstance(heart, RecordedHeart)
    return Participant(
        "recording, beats found by neurokit2" if recorded else "simulation",
        heart.heart_rate_bpm,
        heart.respiration_hz,
        bench.cast.participants[name].pulse_transit_s,
        _beats_ns(bench, name, host_ns, window_s),
    )


def _device(bench: Bench, peripheral: Peripheral) -> VirtualDevice:
    return next(device for device in bench.cast.devices if device.sensor == peripheral.identity.sensor)


def _sensor(bench: Bench, peripheral: Peripheral, host_ns: int, window_s: float) -> Sensor:
    device, firmware = _device(bench, peripheral), peripheral.firmware
    clock = firmware.clock
    beats_ns = _beats_ns(bench, device.participant, host_ns, window_s, firmware.body.pulse_delay_s)
    return Sensor(
        participant=device.participant,
        connected=peripheral.connection is not None,
        connections_total=peripheral.connections_total,
        reference_host_ns=host_ns,
        reference_device_ns=clock.read_ns(host_ns),
        skew_ppm=clock.at(host_ns).skew_ppm,
        smallest_delay_s=peripheral.radio.quality.latency_s,
        clock_resets=clock.resets,
        clock_segments=[ClockSegment(*segment) for segment in clock.segments],
        beats_host_ns=beats_ns,
        beats_device_ns=[clock.read_ns(beat_ns) for beat_ns in beats_ns],
        streams={name: _counts(counts, firmware.rate_factor) for name, counts in firmware.counts.items()},
    )


def _counts(counts: Counts, rate_factor: float) -> StreamCounts:
    return StreamCounts(**asdict(counts), rate_factor=rate_factor)


def devices(bench: Bench) -> list[Device]:
    """The virtual devices and the present position of their knobs."""
    return [
        Device(
            peripheral.identity.sensor,
            _device(bench, peripheral).model,
            peripheral.identity.name,
            peripheral.identity.address,
            peripheral.connection is not None,
            [kind.name.lower() for kind in peripheral.firmware.control.running],
            peripheral.firmware.control.sdk_mode,
            _stand(peripheral),
        )
        for peripheral in bench.peripherals.values()
    ]


def _stand(peripheral: Peripheral) -> Stand:
    body = peripheral.firmware.body
    return Stand(
        **asdict(peripheral.radio.quality),
        battery_percent=peripheral.battery_percent,
        rssi_dbm=peripheral.rssi_dbm,
        contact=body.wearing.contact,
        skew_ppm=peripheral.firmware.clock.segments[-1].skew_ppm,
        heart_rate_bpm=body.heart.heart_rate_bpm,
        down=peripheral.down,
    )
