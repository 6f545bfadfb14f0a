"""What every driver keeps of its device: ten emulated minutes with loss, a restart and a wrap; cost; coming back.

    .venv/bin/python tests/bench/run.py devices            # ten seconds for each codec, a minute for each study

A new driver: a function that returns `Played`, entered in `PLAYED`. It feeds the emulator's bytes, one per cent of them
lost, to the driver's codec at once, and every `Samples` that comes out to a `Tally`, which counts as the kit does.
The second part needs no entry: each driver's own study (compose/studies/<name>.yaml) is started, its CPU measured, its
device switched off and on again over the bench.
"""

import json
import struct
import tempfile
import time
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from bench_nine_modalities import Study
from bench_scaling import cpu_s
from clock_sync.estimator import ClockEstimator
from sense4hri.chunk import Break, Chunk
from sense4hri.device import Samples
from sense4hri.holes import Holes
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS

SIGNAL_S, LOSS = 600.0, 0.01
CODEC_TIMES, TIME_P95_MS, CPU_PERCENT, BACK_S = 20.0, 2.0, 2.0, 5.0
SETTLED_S = 120.0
"""From then on the clock model is judged."""
STREAMING = 2.0
"""Of the metric `state`."""
STEP_S = 0.001
"""In which a pure virtual device is asked what it has sent."""
SETTLE_S, MEASURE_S, AWAY_S, LONGEST_BACK_S = 10.0, 20.0, 3.0, 30.0


class Tally:
    """Counts the samples of one stream as the kit's outlet does, and follows its clock as clock-sync does."""

    def __init__(self, nominal_hz: float) -> None:
        self.came = self.lost = self.restarts = 0
        self._clock, self._holes = SampleClock(nominal_hz), Holes(nominal_hz) if nominal_hz > 0 else None
        self._estimator = ClockEstimator()
        self.errors_ms: list[float] = []

    def take(self, samples: Samples, true_ns: int | None = None) -> None:
        """Count. true_ns: host time at which the newest sample was taken, where the device has a clock."""
        cut = samples.times_ns is not None and self._holes is not None
        for chunk in self._holes.cut(samples.chunk, samples.times_ns) if cut else [samples.chunk]:
            self._place(chunk)
        self.lost += samples.lost or 0
        if true_ns is not None and samples.chunk.device_ns is not None:
            self._estimator.packet(samples.sensor_type, samples.chunk.device_ns, samples.chunk.received_ns)
            error_ns = self._estimator.model().ros_ns(samples.chunk.device_ns) - true_ns
            self.errors_ms.append(error_ns * 1e-6)

    def _place(self, chunk: Chunk) -> None:
        timed = self._clock.place(chunk)
        self.came += len(chunk.samples)
        self.lost += timed.lost if timed.break_ is Break.GAP else 0
        self.restarts += timed.break_ is Break.RESET


@dataclass(frozen=True)
class Played:
    """What became of ten emulated minutes.

    sent, lost: samples that the device took, and that were taken from its bytes. came, counted: what the driver handed
    on, and said was missing. codec_s: CPU of the codec. errors_ms: of the clock model at every frame from the second
    minute on; empty where there is no clock.
    """

    device: str
    sent: int
    lost: int
    came: int
    counted: int
    codec_s: float
    errors_ms: list[float] = field(default_factory=list)


def polar_h10() -> Played:
    """ECG of an H10: frames of 73 samples, its clock 40 ppm fast, reset to 2019 after five minutes."""
    from driver_polar import protocol, reports

    random, tally, step_ns = np.random.default_rng(1), Tally(130.0), round(SECOND_NS / 130)
    sent = lost = 0
    begun_ns, codec_s = 1_700_000_000 * SECOND_NS, 0.0
    for index in range(1, int(SIGNAL_S * 130 / 73) + 1):
        taken_ns = index * 73 * step_ns
        restarted = taken_ns > SIGNAL_S / 2 * SECOND_NS
        device_ns = round((taken_ns - restarted * SIGNAL_S / 2 * SECOND_NS) * (1 + 40e-6)) + 599_616_000 * SECOND_NS
        octets = struct.pack("<BQB", 0, device_ns, 0) + random.bytes(219)
        sent += 73
        if 1 < index < int(SIGNAL_S * 130 / 73) and not _near_restart(taken_ns, step_ns) and random.random() < LOSS:
            lost += 73
            continue
        true_ns = begun_ns + taken_ns
        received_ns = true_ns + round(random.gamma(2.0, 0.003) * SECOND_NS)
        begun_s = time.process_time()
        items = list(reports.of_frame(protocol.decode(protocol.parse(octets), 1.0), "ecg", ("ecg",), received_ns))
        codec_s += time.process_time() - begun_s
        for item in items:
            if isinstance(item, Samples):
                tally.take(item, true_ns)
    settled = tally.errors_ms[int(SETTLED_S / SIGNAL_S * len(tally.errors_ms)) :]
    return Played("driver-polar, H10 ECG", sent, lost, tally.came, tally.lost, codec_s, settled)


def bitalino() -> Played:
    """Four channels at 1 kHz; the board is switched off and on after five minutes. No clock."""
    from driver_bitalino.config import BitalinoConfig, streams_of
    from driver_bitalino.device import Decoder
    from driver_bitalino.protocol import set_rate, start
    from sense4hri.arrivals import Arrival
    from sensor_bench.bitalino.firmware import Board, Panel
    from sensor_bench.bitalino.ports import NOTHING
    from sensor_bench.wired import Frames

    config = BitalinoConfig(sensor_id="b_1", port="/dev/x", channels=("A1: ecg", "A2: eda", "A3: emg", "A4: pzt"))
    random, tally, air, codec_s = np.random.default_rng(2), Tally(1000.0), Frames(2), 0.0
    for half in range(2):
        board, decoder = Board([NOTHING] * 6, Panel(), air, 0.0, 1.0), Decoder(config, streams_of(config))
        board.receive(set_rate(1000) + start((1, 2, 3, 4)), 0.0)
        items: list[Any] = []
        for tick in count(1):
            if tick > SIGNAL_S * 50 / 2 and items:
                break  # nothing waits for a message
            air.loss = LOSS if 10 < tick < SIGNAL_S * 50 / 2 - 10 else 0.0  # what is lost at an end nobody can count
            at_s = half * SIGNAL_S / 2 + tick / 50 + random.gamma(2.0, 0.003)
            arrival = Arrival(1_700_000_000 * SECOND_NS + round(at_s * SECOND_NS), board.send(tick / 50))
            begun_s = time.process_time()
            items = list(decoder.items(arrival))
            codec_s += time.process_time() - begun_s
            for item in items:
                if isinstance(item, Samples) and item.sensor_type == "ecg":
                    tally.take(item)
    frames = air.counts["analog"]
    sent, lost = frames.frames_sent + frames.frames_lost, frames.frames_lost
    return Played("driver-bitalino, 4 x 1 kHz", sent, lost, tally.came, tally.lost, codec_s)


def microcontroller() -> Played:
    """Lines of five numbers at 250 Hz; a clock in ms, 40 ppm fast, that wraps after a minute; reset after five."""
    from driver_serial.description import parse
    from driver_serial.device import Clock, Decoder
    from sense4hri.arrivals import Arrival
    from sensor_bench.board.firmware import Sketch
    from sensor_bench.wired import Frames

    described = parse(
        "{format: csv, fields: [t, n, gsr, belt, ppg], time: {field: t}, streams: {eda: {rate_hz: 250, unit: uS, "
        "range: [0, 100], bits: 14, channels: {eda: {field: gsr, scale: 0.01}}}}}"
    )
    still = dict.fromkeys(("eda", "breath", "pulse"), lambda first, number, fs_hz: np.zeros(number))
    random, tally, air, codec_s, skew = np.random.default_rng(3), Tally(250.0), Frames(3), 0.0, 40.0
    now_ns, begun_ns = [0], 1_700_000_000 * SECOND_NS
    decoder = Decoder(described, Clock(described.time, lambda: now_ns[0]))
    for half, first_tick in enumerate((2**32 - 60_000, 0)):
        how = {"rate_hz": 250.0, "first_tick": first_tick, "skew_ppm": skew, "waits": False}
        board, off_s = Sketch(still, air, 0.0, **how), half * SIGNAL_S / 2
        items: list[Any] = []
        for tick in count(1):
            if tick > SIGNAL_S * 50 / 2 and items:
                break
            air.loss = LOSS if 10 < tick < SIGNAL_S * 50 / 2 - 10 else 0.0
            now_ns[0] = round((off_s + tick / 50 + random.gamma(2.0, 0.003)) * SECOND_NS)
            arrival = Arrival(begun_ns + now_ns[0], board.send(tick / 50))
            begun_s = time.process_time()
            items = list(decoder.items(arrival))
            codec_s += time.process_time() - begun_s
            for item in items:
                device_s = item.chunk.device_ns / SECOND_NS - first_tick / 1000
                true_s = round(device_s / (1 + skew * 1e-6) * 250) / 250 + off_s
                tally.take(item, begun_ns + round(true_s * SECOND_NS))
    settled = tally.errors_ms[int(SETTLED_S / SIGNAL_S * len(tally.errors_ms)) :]
    frames = air.counts["eda"]
    sent, lost = frames.frames_sent + frames.frames_lost, frames.frames_lost
    return Played("driver-serial, lines at 250 Hz", sent, lost, tally.came, tally.lost, codec_s, settled)


def _near_restart(taken_ns: int, step_ns: int) -> bool:
    """What is lost beside a restart nobody can count."""
    return abs(taken_ns - SIGNAL_S / 2 * SECOND_NS) < 2 * 73 * step_ns


def brainflow_cyton() -> Played:
    """EEG of a Cyton as BrainFlow hands it out, ten a poll: 8 bits, 586 wraps, begun anew in the middle."""
    from driver_brainflow.config import BrainflowConfig, sources_of
    from driver_brainflow.protocol import Reader
    from driver_brainflow.transport import description

    random, tally, fs_hz = np.random.default_rng(4), Tally(250.0), 250.0
    table, sources = description("CYTON")["default"], sources_of(BrainflowConfig(sensor_id="it_1", board="CYTON"))
    halves, codec_s, lost = (0, int(SIGNAL_S * fs_hz / 2)), 0.0, 0
    for begun in halves:
        reader = Reader("CYTON", "default", table, sources, recorded=False)
        kept = np.flatnonzero(random.random(halves[1]) >= LOSS)
        kept = np.union1d(kept, [0, halves[1] - 1])  # what is lost beside a restart nobody can count
        lost += halves[1] - len(kept)
        for part in np.array_split(kept, len(kept) // 10):
            rows = random.normal(size=(table["num_rows"], len(part)))
            rows[table["package_num_channel"]] = part % 256
            rows[table["timestamp_channel"]] = 1.7e9 + (begun + part) / fs_hz
            rows[table["marker_channel"]] = 0
            received_ns = round((1.7e9 + (begun + part[-1]) / fs_hz + 0.01) * SECOND_NS)
            begun_s = time.process_time()
            items = list(reader.items(rows, received_ns, received_ns / SECOND_NS))
            codec_s += time.process_time() - begun_s
            for item in items:
                if isinstance(item, Samples) and item.sensor_type == "eeg":
                    tally.take(item)
    return Played("driver-brainflow, Cyton EEG", 2 * halves[1], lost, tally.came, tally.lost, codec_s)


def vernier_belt() -> Played:
    """Force of a Go Direct belt, two samples a frame: 8 bits of counter, 11 wraps, begun anew in the middle."""
    from driver_vernier.config import Config, streams_of
    from driver_vernier.device import Device
    from driver_vernier.protocol import Frames, Losses
    from sensor_bench.vernier.firmware import measurement

    config, dice, tally = Config(sensor_id="it_1", name="0K1002A1"), np.random.default_rng(12), Tally(10.0)
    device = Device(config, streams_of(config), None)
    in_half, codec_s, lost = int(SIGNAL_S * 10 / 2 / 2), 0.0, 0
    for half in range(2):
        frames, losses = Frames(), Losses()
        for number in range(in_half):
            if number > 1 and number < in_half - 1 and dice.random() < LOSS:
                lost += 2
                continue
            octets = measurement(half * 1000 + number, 6, [[10.0, 15.0], [11.0, 15.0]])
            begun_s = time.process_time()
            items = [
                item
                for part in (octets[:20], octets[20:])
                for frame in frames.take(part)
                for item in device.items(frame, losses, number * SECOND_NS // 5)
            ]
            codec_s += time.process_time() - begun_s
            for item in items:
                if isinstance(item, Samples):
                    tally.take(item)
    return Played("driver-vernier, belt", 4 * in_half, lost, tally.came, tally.lost, codec_s)


class _Lossy:
    """Loses packets of a pure virtual device, none while `careful`, and counts the samples of one stream."""

    def __init__(self, stream: str) -> None:
        self.sent = self.lost = 0
        self.careful = False
        self._random, self._stream = np.random.default_rng(2), stream

    def carry(self, packet: bytes, **samples: int) -> bytes:
        """The packet, or nothing."""
        count = samples.get(self._stream, 0)
        gone = not self.careful and self._random.random() < LOSS
        self.sent += count
        self.lost += count * gone
        return b"" if gone else packet


def _settled(tally: Tally) -> list[float]:
    return tally.errors_ms[int(SETTLED_S / SIGNAL_S * len(tally.errors_ms)) :]


def shimmer_gsr() -> Played:
    """A GSR+ at 128 Hz, its clock 40 ppm fast: it wraps after a minute, and is switched off and on after five."""
    from driver_shimmer import protocol
    from driver_shimmer.config import ShimmerConfig, streams_of
    from driver_shimmer.device import Shimmer
    from driver_shimmer.packets import Packets
    from driver_shimmer.session import Prepared
    from sense4hri.arrivals import Silence
    from sense4hri.device import Identity
    from sensor_bench.shimmer.body import Body
    from sensor_bench.shimmer.firmware import Memory, VirtualShimmer
    from sensor_bench.signals.hearts import Heart
    from sensor_bench.signals.skin import Skin
    from sensor_bench.signals.sources import Wearing
    from sensor_bench.signals.waveforms import stored

    random, tally, lossy = np.random.default_rng(1), Tally(128.0), _Lossy("eda")
    body, now_s, codec_s, begun_ns = Body(Heart(1), Skin(1), stored(), Wearing()), 0.0, 0.0, 1_700_000_000 * SECOND_NS
    config = ShimmerConfig(sensor_id="shimmer_1", port="/dev/rfcomm0", streams=("eda", "ppg"))
    device = Shimmer(config, streams_of(config), lambda: None, lambda: round(now_s * SECOND_NS))  # type: ignore
    for on_s, ticks in ((0.0, 2**24 - 60 * protocol.TICKS_HZ), (SIGNAL_S / 2, 0)):
        virtual = VirtualShimmer(body, Memory(), lossy.carry, on_s, 40.0, ticks)
        virtual.receive(protocol.set_rate(config.divider) + protocol.set_sensors(config.sampled), 0.0)
        layout = protocol.Layout(protocol.decode_inquiry(virtual.receive(b"\x01", 0.0)[2:]).channels)
        prepared, packets = Prepared(Identity(), 0.0, layout, {}, (), ()), Packets(layout.length, config.divider)
        virtual.receive(b"\x07", 0.0)
        while now_s < on_s + SIGNAL_S / 2 - 0.01:
            now_s += STEP_S
            lossy.careful = not on_s + 1 < now_s < on_s + SIGNAL_S / 2 - 1
            if not (octets := virtual.send(now_s - on_s)):
                continue
            received_ns = begun_ns + round((now_s + random.gamma(2.0, 0.003)) * SECOND_NS)
            begun_s = time.process_time()
            items = list(device.items(packets.feed(octets, received_ns), prepared, Silence([], 1.0)))
            codec_s += time.process_time() - begun_s
            for item in items:
                if isinstance(item, Samples) and item.sensor_type == "eda":
                    taken_s = virtual.true_s(round((item.chunk.device_ns or 0) * protocol.TICKS_HZ / SECOND_NS))
                    tally.take(item, begun_ns + round(taken_s * SECOND_NS))
        for item in device.rest(prepared):
            if isinstance(item, Samples) and item.sensor_type == "eda":
                tally.take(item)
    unproven = 2  # the last packet of each half: none follows that would vouch for it
    return Played(
        "driver-shimmer, GSR+", lossy.sent - unproven, lossy.lost, tally.came, tally.lost, codec_s, _settled(tally)
    )


def bioharness_ecg() -> Played:
    """ECG of a BioHarness, its calendar 40 ppm fast: over midnight, and switched off and on after five minutes."""
    import datetime

    from driver_bioharness import protocol
    from driver_bioharness.config import BioHarnessConfig, streams_of
    from driver_bioharness.device import BioHarness
    from sensor_bench.bioharness.firmware import VirtualBioHarness, Worn
    from sensor_bench.signals.hearts import Heart
    from sensor_bench.signals.waveforms import stored

    random, tally, lossy = np.random.default_rng(1), Tally(250.0), _Lossy("ecg")
    now_s, codec_s, begun_ns, buffer = 0.0, 0.0, 1_700_000_000 * SECOND_NS, bytearray()
    config = BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0")
    device = BioHarness(config, streams_of(config), lambda: None)  # type: ignore
    for on_s, begins in ((0.0, "2026-01-01T23:58:00"), (SIGNAL_S / 2, "2026-01-01T08:00:00")):
        at = datetime.datetime.fromisoformat(begins)
        virtual = VirtualBioHarness(Heart(1), stored(), Worn(), lossy.carry, at, on_s, 40.0)
        virtual.receive(b"".join(protocol.encode(switch, b"\x01") for switch in (0x15, 0x16, 0x19, 0x1E, 0xBD)), 0.0)
        while now_s < on_s + SIGNAL_S / 2 - 0.01:
            now_s += STEP_S
            lossy.careful = not on_s + 1 < now_s < on_s + SIGNAL_S / 2 - 1
            virtual.receive(protocol.encode(protocol.Kind.LIFESIGN), now_s - on_s)
            if not (octets := virtual.send(now_s - on_s)):
                continue
            received_ns = begun_ns + round((now_s + random.gamma(2.0, 0.003)) * SECOND_NS)
            buffer += octets
            begun_s = time.process_time()
            items = [item for each in protocol.take(buffer) for item in device.items(each, received_ns)]
            codec_s += time.process_time() - begun_s
            for item in items:
                if isinstance(item, Samples) and item.sensor_type == "ecg":
                    taken_s = virtual.true_s(item.chunk.device_ns or 0)
                    tally.take(item, begun_ns + round(taken_s * SECOND_NS))
    return Played("driver-bioharness, ECG", lossy.sent, lossy.lost, tally.came, tally.lost, codec_s, _settled(tally))


def pupil_neon() -> Played:
    """Gaze of a Neon, a datagram each: the phone's clock 40 ppm fast; RTP's numbers and ticks wrap."""
    from driver_pupil_labs import rtp
    from driver_pupil_labs.companion_device import Told
    from sense4hri.arrivals import Arrival
    from sensor_bench.clock import DeviceClock
    from sensor_bench.neon.app import Player, VirtualApp

    begun_ns, buffer, timeline = 1_700_000_000 * SECOND_NS, bytearray(), rtp.Timeline(90_000)
    app = VirtualApp(DeviceClock(0, begun_ns, 40.0), loss=LOSS)
    player, told, tally, codec_s = Player(app, "gaze", 0.0), Told(1600.0, 1200.0), Tally(200.0), 0.0
    for number in range(1, int(SIGNAL_S / 0.02) + 4):
        app.loss = LOSS if 1 < number < SIGNAL_S / 0.02 - 4 else 0.0  # what is lost at an end nobody can count
        buffer += player.send(number * 0.02)
        received_ns = begun_ns + number * 20_000_000
        begun_s = time.process_time()
        items = []
        for channel, octets in rtp.take(buffer):
            if channel:
                timeline.reported(rtp.report(octets))
                continue
            packet = rtp.packet(octets)
            items += told.take(Arrival(received_ns, ("gaze", timeline.time_ns(packet.ticks), packet.payload)))
        codec_s += time.process_time() - begun_s
        if number == int(SIGNAL_S / 0.02) + 3:  # what is still held
            items += told.take(Arrival(received_ns + SECOND_NS, ("eye_events", 0, struct.pack("!i", 5))))
        for item in items:
            if isinstance(item, Samples) and item.sensor_type == "eye_tracking":
                tally.take(item)
    counts = app.counts
    return Played(
        "driver-pupil-labs, Neon gaze", counts.samples_sent, counts.samples_lost, tally.came, tally.lost, codec_s
    )


PLAYED: tuple[Callable[[], Played], ...] = (
    polar_h10,
    brainflow_cyton,
    bitalino,
    microcontroller,
    vernier_belt,
    shimmer_gsr,
    bioharness_ecg,
    pupil_neon,
)


def codec_rows(played: Played) -> list[dict[str, Any]]:
    """Rows of one driver's ten emulated minutes."""
    counts = f"{played.came} + {played.counted} of {played.sent}, {played.lost} lost"
    exact = played.came + played.counted == played.sent and played.counted == played.lost
    times = SIGNAL_S / max(played.codec_s, 1e-9)
    rows = [
        _row(f"{played.device}: came + counted, {LOSS:.0%} lost, restart", "all, exactly", counts, exact),
        _row(f"{played.device}: codec", f">= {CODEC_TIMES:g}x", f"{times:.0f}x real time", times >= CODEC_TIMES),
    ]
    if played.errors_ms:
        p95 = float(np.percentile(np.abs(played.errors_ms), 95))
        what = f"{played.device}: device time after clock-sync, p95"
        rows.append(_row(what, f"<= {TIME_P95_MS:g} ms", f"{p95:.2f} ms", p95 <= TIME_P95_MS))
    return rows


def live_rows(name: str) -> list[dict[str, Any]]:
    """CPU of a driver in its own study, and how soon it streams again once its device is back."""
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder), name)
        try:
            drivers = [each for each in study.study.sensors if each.sensor_id]
            for driver in drivers:
                _until_more(study.port(driver.name), -1)
            time.sleep(SETTLE_S)
            first = {each.name: cpu_s(study.children[each.name].pid) for each in drivers}
            time.sleep(MEASURE_S)
            used = [100 * (cpu_s(study.children[each.name].pid) - first[each.name]) / MEASURE_S for each in drivers]
            back = [back_s(study, each.name, each.sensor_id) for each in drivers if study.study.of("sensor_bench")]
        finally:
            study.end()
    percent, what = max(used), f"driver-{name} in its study"
    rows = [
        _row(f"{what}: CPU per device", f"<= {CPU_PERCENT:g} % of a core", f"{percent:.1f} %", percent <= CPU_PERCENT)
    ]
    if back:
        rows.append(_row(f"{what}: streams again", f"<= {BACK_S:g} s", f"{max(back):.1f} s", max(back) <= BACK_S))
    return rows


def back_s(study: Study, driver: str, sensor: str) -> float:
    """Switch a device off and on again; return the seconds until its driver has new samples, inf without any."""
    bench, port = study.port(study.study.of("sensor_bench").name), study.port(driver)
    _knob(bench, sensor, down=True)
    time.sleep(AWAY_S)
    before = _samples(port)
    _knob(bench, sensor, down=False)
    return _until_more(port, before)


def _until_more(port: int, before: float) -> float:
    begun_s = time.monotonic()
    while not _samples(port) > before:
        if time.monotonic() - begun_s > LONGEST_BACK_S:
            return float("inf")
        time.sleep(0.05)
    return time.monotonic() - begun_s


def _samples(port: int) -> float:
    """Return how many samples a driver has published; of one that only reports, 1 while it streams."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as answer:
        lines = answer.read().decode().splitlines()
    values = {name: [float(line.rpartition(" ")[2]) for line in lines if line.startswith(f"sense4hri_{name}{{")]
              for name in ("samples_total", "state")}  # fmt: skip
    return sum(values["samples_total"]) or float(STREAMING in values["state"])


def _knob(port: int, sensor: str, **knobs: Any) -> None:
    body, headers = json.dumps(knobs).encode(), {"Content-Type": "application/json"}
    request = urllib.request.Request(f"http://127.0.0.1:{port}/devices/{sensor}/knobs", body, headers)
    urllib.request.urlopen(request, timeout=20).close()


def _row(what: str, target: str, measured: str, ok: bool | None) -> dict[str, Any]:
    return {"what": what, "target": target, "measured": measured, "ok": ok}


def studies() -> list[str]:
    """Names of the studies that play one driver's devices; of driver-polar it is the demo."""
    root = Path(__file__).resolve().parents[2]
    drivers = sorted(path.name.removeprefix("driver-") for path in (root / "services").glob("driver-*"))
    return [name for name in drivers if name != "polar" and (root / "compose" / "studies" / f"{name}.yaml").is_file()]


def rows() -> list[dict[str, Any]]:
    """Rows of every driver: what it keeps, what it costs, how soon it is back."""
    return [row for play in PLAYED for row in codec_rows(play())] + [
        row for name in studies() for row in live_rows(name)
    ]


if __name__ == "__main__":
    for row in rows():
        print(row["what"], "|", row["target"], "|", row["measured"], "|", row["ok"])
