"""Devices whose link hands on whole packets: Bluetooth LE, a maker's library, the network."""

import struct
import time
from collections.abc import Callable

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


def two_way(ask: Callable[[float], int], at_s: float, random: np.random.Generator) -> list[tuple[int, int, int]]:
    """Ask for a device's clock twelve times; each way over the network takes what packets take.

    ask: what the clock says at a true time. Returns true times in ns of request and answer, and what was said.
    """
    asked = []
    for _ in range(12):
        there_s, back_s = random.gamma(2.0, 0.003, 2)
        asked.append((round(at_s * SECOND_NS), round((at_s + there_s + back_s) * SECOND_NS), ask(at_s + there_s)))
        at_s += there_s + back_s
    return asked


def pupil_core() -> Played:
    """Sizes of both pupils of a Core, a picture each; its clock is 40 ppm fast and begins anew in the middle.

    What is lost of one eye is NaN, of both a row. Its clock is asked for every 2 s, over a network as slow as the
    pictures': the shortest of twelve round trips counts.
    """
    from driver_pupil_labs.device import Told
    from driver_pupil_labs.exchange import Asked, best
    from driver_pupil_labs.protocol import Gaze, Pupil, decode
    from driver_pupil_labs.streams import Known
    from driver_pupil_labs.transport import CLOCK, EVERY_S, METHOD
    from sensor_bench.clock import DeviceClock
    from sensor_bench.pupil_core.capture import VirtualCapture

    random, tally, known, codec_s, skew = np.random.default_rng(5), Tally(120.0), Known(), 0.0, 40e-6
    network = np.random.default_rng(15)
    begun_ns, sent, lost, missed = 1_700_000_000 * SECOND_NS, 0, 0, 0
    for on_s, pupil_s in ((0.0, 4000.0), (SIGNAL_S / 2, 1.0)):
        clock = DeviceClock(round(on_s * SECOND_NS), round(pupil_s * SECOND_NS), skew * 1e6)
        virtual, told = VirtualCapture(clock), Told(known)
        virtual.begin(on_s + 0.005)  # between a left and a right picture, and so ends the last of the steps
        known.connected()
        last = int(SIGNAL_S * 50 / 2) - 1

        def ask(at_s: float, virtual: VirtualCapture = virtual) -> int:
            return round(float(virtual.answer(list(CLOCK), at_s)) * SECOND_NS)

        for number in range(1, last + 1):
            at_s, kept = on_s + number * 0.02, []
            if number % int(EVERY_S * 50) == 1:
                told.measured = best([Asked(*each) for each in two_way(ask, at_s, network)], begun_ns, METHOD)
                tally.measured(told.measured)
            careful = not 100 < number < last - 100  # what is lost at an end nobody can count
            for topic, payload in virtual.send(at_s):
                picture = topic.endswith(b"3d") and topic.startswith(b"pupil")
                gone = picture and not careful and random.random() < LOSS
                sent, lost = sent + picture, lost + gone
                if not gone:
                    kept.append((topic, payload))
            received_ns = begun_ns + round((at_s + random.gamma(2.0, 0.003)) * SECOND_NS)
            begun_s = time.process_time()
            for topic, payload in kept:
                match decode(topic.decode(), payload):
                    case Gaze() as gaze:
                        told.gaze(gaze, received_ns)
                    case Pupil() as pupil:
                        told.pupil(pupil, received_ns)
            items = list(told.items() if number < last else told.rest())
            codec_s += time.process_time() - begun_s
            for item in items:
                if isinstance(item, Samples) and item.sensor_type == "pupillometry":
                    missed += int(np.isnan(item.chunk.samples[:, :2]).sum())
                    elapsed_ns = ((item.chunk.device_ns or 0) - clock.segments[0].device_ns) / (1 + skew)
                    tally.take(item, begun_ns + round(on_s * SECOND_NS + elapsed_ns))
    came, counted = 2 * tally.came - missed, missed + 2 * tally.lost
    return Played("driver-pupil-labs, Core sizes", sent, lost, came, counted, codec_s, tally.settled_ms())


def pupil_neon() -> Played:
    """Gaze of a Neon, a datagram each: the phone's clock 40 ppm fast, an hour behind from the middle on; RTP wraps.

    Its clock is asked for every 5 s by the time echo, which tells whole ms, over a network as slow as the datagrams'.
    """
    from driver_pupil_labs import companion, rtp
    from driver_pupil_labs.companion_device import ASK_S, Told
    from driver_pupil_labs.companion_link import HALF_MS_NS, METHOD, Came
    from driver_pupil_labs.exchange import Asked, best
    from driver_pupil_labs.streams import Known
    from sense4hri.arrivals import Arrival
    from sensor_bench.clock import DeviceClock
    from sensor_bench.neon.app import Player, VirtualApp

    random, tally, known, codec_s = np.random.default_rng(6), Tally(200.0), Known(), 0.0
    begun_ns, skew, half = 1_700_000_000 * SECOND_NS, 40e-6, int(SIGNAL_S / 0.04)
    app, network = VirtualApp(DeviceClock(0, begun_ns, skew * 1e6)), np.random.default_rng(16)

    def ask(at_s: float) -> int:
        return companion.decode_echo(bytes(8), app.echo(bytes(8), at_s)) + HALF_MS_NS

    for on_s, behind_s in ((0.0, 0.0), (SIGNAL_S / 2, 3600.0)):
        clock = app.clock = DeviceClock(round(on_s * SECOND_NS), begun_ns - round(behind_s * SECOND_NS), skew * 1e6)
        buffer, timeline, player = bytearray(), rtp.Timeline(90_000), Player(app, "gaze", on_s)
        told = Told(1600.0, 1200.0, known)
        known.connected()
        for number in range(1, half + 1):
            at_s = on_s + number * 0.02
            if number % int(ASK_S * 50) == 1:
                exchanges = [Asked(*each) for each in two_way(ask, at_s, network)]
                tally.measured(best(exchanges, begun_ns, METHOD, HALF_MS_NS))
            app.loss = LOSS if 1 < number < half - 4 else 0.0  # what is lost at an end nobody can count
            buffer += player.send(at_s)
            received_ns = begun_ns + round((at_s + random.gamma(2.0, 0.003)) * SECOND_NS)
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
                    elapsed_ns = ((item.chunk.device_ns or 0) - clock.segments[0].device_ns) / (1 + skew)
                    tally.take(item, begun_ns + round(on_s * SECOND_NS + elapsed_ns))
    sent, lost = app.counts.samples_sent, app.counts.samples_lost
    return Played("driver-pupil-labs, Neon gaze", sent, lost, tally.came, tally.lost, codec_s, tally.settled_ms())
