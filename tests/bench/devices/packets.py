"""Devices whose link hands on whole packets: Bluetooth LE, a maker's library, the network."""

import struct
import time

import numpy as np
from sense4hri.device import Samples
from sense4hri.stamps import SECOND_NS

from devices.played import LOSS, SIGNAL_S, Played, Tally


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
    return Played("driver-polar, H10 ECG", sent, lost, tally.came, tally.lost, codec_s, tally.settled_ms())


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


def pupil_neon() -> Played:
    """Gaze of a Neon, a datagram each: the phone's clock 40 ppm fast; RTP's numbers and ticks wrap."""
    from driver_pupil_labs import rtp
    from driver_pupil_labs.companion_device import Told
    from driver_pupil_labs.companion_link import Came
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
        arrivals = []
        for channel, octets in rtp.take(buffer):
            if channel:
                timeline.reported(rtp.report(octets))
                continue
            packet = rtp.packet(octets)
            came = Came("gaze", timeline.time_ns(packet.ticks), packet.payload, timeline.count(packet.sequence))
            arrivals.append(Arrival(received_ns, came))
        items = list(told.take(arrivals))
        codec_s += time.process_time() - begun_s
        for item in items:
            if isinstance(item, Samples) and item.sensor_type == "eye_tracking":
                tally.take(item)
    counts = app.counts
    return Played(
        "driver-pupil-labs, Neon gaze", counts.samples_sent, counts.samples_lost, tally.came, tally.lost, codec_s
    )
