"""Devices on a serial link, whose bytes come as they like: boards, Shimmer, BioHarness."""

import time
from itertools import count
from typing import Any

import numpy as np
from sense4hri.device import Samples
from sense4hri.stamps import SECOND_NS

from devices.played import LOSS, SIGNAL_S, Lossy, Played, Tally

STEP_S = 0.001
"""In which a pure virtual device is asked what it has sent."""


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
        "{format: csv, start: s, fields: [t, n, gsr, belt, ppg], time: {field: t}, streams: {"
        "eda: {rate_hz: 250, unit: uS, range: [0, 100], bits: 14, channels: {eda: {field: gsr, scale: 0.01}}}}}"
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
    frames = air.counts["eda"]
    sent, lost = frames.frames_sent + frames.frames_lost, frames.frames_lost
    return Played("driver-serial, lines at 250 Hz", sent, lost, tally.came, tally.lost, codec_s, tally.settled_ms())


def shimmer_gsr() -> Played:
    """A GSR+ at 128 Hz, its clock 40 ppm fast: it wraps after a minute, and is switched off and on after five."""
    from driver_shimmer import protocol
    from driver_shimmer.config import ShimmerConfig, streams_of
    from driver_shimmer.device import Shimmer
    from driver_shimmer.packets import Packets
    from driver_shimmer.session import Prepared
    from sense4hri.device import Identity
    from sensor_bench.shimmer.body import Body
    from sensor_bench.shimmer.firmware import Memory, VirtualShimmer
    from sensor_bench.signals.hearts import Heart
    from sensor_bench.signals.skin import Skin
    from sensor_bench.signals.sources import Wearing
    from sensor_bench.signals.waveforms import stored

    random, tally, lossy = np.random.default_rng(1), Tally(128.0), Lossy("eda")
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
            items = list(device.items(packets.feed(octets, received_ns), prepared))
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
        "driver-shimmer, GSR+", lossy.sent - unproven, lossy.lost, tally.came, tally.lost, codec_s, tally.settled_ms()
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

    random, tally, lossy = np.random.default_rng(1), Tally(250.0), Lossy("ecg")
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
    return Played("driver-bioharness, ECG", lossy.sent, lossy.lost, tally.came, tally.lost, codec_s, tally.settled_ms())
