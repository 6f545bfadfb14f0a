"""Neon and Invisible: their packets, their clock, and what becomes of them over real sockets."""

import asyncio
import json
import math
import re
import select
import socket
import sys
import time
from contextlib import aclosing, asynccontextmanager

import numpy as np
import pytest
from driver_pupil_labs import companion, companion_device, companion_link, imu, rtp, stamped
from driver_pupil_labs.companion_device import Companion, Told
from driver_pupil_labs.companion_link import Came
from driver_pupil_labs.config import PupilConfig
from driver_pupil_labs.eyes import Row
from driver_pupil_labs.streams import MOST, Known, Rows
from hypothesis import given
from hypothesis import strategies as some
from listened import until
from sense4hri.arrivals import Arrival
from sense4hri.device import MESSAGE_S, ClockMeasurement, Declared, Identity, Marked, Samples, Status
from sense4hri.errors import DeviceLost, FrameError
from sensor_bench.clock import DeviceClock, HostClock
from sensor_bench.neon.app import Player, VirtualApp, imu_message
from sensor_bench.neon.server import AppServer

DEADLINE_S = 20.0
EYES = {"eye_tracking": ("px", 200.0), "pupillometry": ("mm", 200.0)}
IMU = {"accelerometer": ("m/s^2", 110.0), "gyroscope": ("rad/s", 110.0), "orientation": ("1", 110.0)}
GAZE = bytes.fromhex("4448000044160000ff")  # without sizes
UNIX_NS = 1_700_000_000_000_000_000


def listen(app: VirtualApp, seconds: float):
    """Return the readings of gaze with their times, and the timeline, of so many seconds."""
    player, buffer, timeline, found = Player(app, "gaze", 0.0), bytearray(), rtp.Timeline(90_000), []
    for at_s in np.arange(0.02, seconds, 0.02):
        buffer += player.send(float(at_s))
        for channel, octets in rtp.take(buffer):
            if channel:
                timeline.reported(rtp.report(octets))
                continue
            packet = rtp.packet(octets)
            timeline.count(packet.sequence)
            found.append((timeline.time_ns(packet.ticks), companion.decode_gaze(packet.payload)))
    return found, timeline


def test_times_and_losses_are_exact_across_the_wrap_of_numbers_and_ticks():
    """Every datagram once, at the phone's UNIX time; what was lost is missing by the numbers and by the stamps."""
    app = VirtualApp(DeviceClock(0, UNIX_NS, 80.0), loss=0.01)
    found, timeline = listen(app, 60.0)
    times_ns = np.array([time_ns for time_ns, _ in found])
    assert len(found) + app.counts.samples_lost == app.counts.samples_sent
    periods = (times_ns - UNIX_NS) / (1 + 80e-6) / 5e6
    assert np.abs(periods - np.rint(periods)).max() * 5e6 < 30_000  # ns; a tick is 11 us
    missing = (np.rint(np.diff(times_ns) / 5e6) - 1).sum()
    assert missing == timeline.lost_total > 50
    assert app.counts.samples_lost - timeline.lost_total in (0, 1)  # the last one nobody has missed yet


def test_sizes_are_in_mm_and_an_invisible_has_none():
    """Left and right where they belong; 9 octets of an Invisible are gaze alone."""
    found, _ = listen(VirtualApp(DeviceClock(0, UNIX_NS)), 1.0)
    left, right = found[10][1].sizes_mm
    assert left - right == pytest.approx(0.1, abs=1e-5)
    assert 3 < right < 5
    found, _ = listen(VirtualApp(DeviceClock(0, UNIX_NS), model="Invisible"), 1.0)
    assert found[0][1].sizes_mm is None


def test_eyelids_are_apertures_in_mm_where_the_app_computes_them():
    """Left and right, behind the two angles of each; closed in a blink together with pupils of no size."""
    found, _ = listen(VirtualApp(DeviceClock(0, UNIX_NS), eyelids=True), 1.0)
    assert found[10][1].apertures_mm == (9.0, 8.5)
    assert found[10][1].sizes_mm[0] > 3
    found, _ = listen(VirtualApp(DeviceClock(0, UNIX_NS)), 0.1)
    assert found[0][1].apertures_mm is None


def test_what_was_taken_is_gone_from_the_buffer():
    """Who stops reading after the first answer is not given it again; the next request has its own."""
    buffer = bytearray(b"RTSP/1.0 200 OK\r\n\r\n$\0\0\x01zRTSP/1.0 454 Session Not Found\r\n\r\n")
    assert next(rtp.take(buffer)).status == 200
    assert next(rtp.take(buffer)) == (0, b"z")
    assert next(rtp.take(buffer)).status == 454
    assert not buffer


@given(cut=some.integers(1, 50), flip=some.integers(0, 5000))
def test_any_cut_gives_the_same_packets_and_damage_is_a_frame_error(cut, flip):
    """How TCP cuts the octets does not matter; a flipped bit raises nothing but FrameError."""
    octets = Player(VirtualApp(DeviceClock(0, UNIX_NS)), "gaze", 0.0).send(0.2)
    buffer, found = bytearray(), []
    for at in range(0, len(octets), cut):
        buffer += octets[at : at + cut]
        found += list(rtp.take(buffer))
    assert found == list(rtp.take(bytearray(octets)))
    damaged = bytearray(octets)
    damaged[flip % len(damaged)] ^= 1 << (flip % 8)
    try:
        for came in rtp.take(damaged):
            if isinstance(came, tuple) and not isinstance(came, rtp.Answer):
                rtp.report(came[1]) if came[0] % 2 else companion.decode_gaze(rtp.packet(came[1]).payload)
    except FrameError:
        return


@pytest.mark.parametrize(
    "octets", [b"", b"\0" * 10, b"\0" * 16, b"\0\0\0\x04" + b"\0" * 15, b"\0\0\0\x63" + b"\0" * 16]
)
def test_what_has_no_known_length_is_refused(octets):
    """Of gaze and of eye events alike."""
    with pytest.raises(FrameError):
        companion.decode_gaze(octets)
    with pytest.raises(FrameError):
        companion.decode_event(octets)


@pytest.mark.parametrize(
    "octets",
    [
        b"RTSP/1.0 200 OK\r\nContent-Length: \xb2\r\n\r\n",
        b"RTSP/1.0 200 OK\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n",
        b"RTSP/1.0 \xb2 OK\r\n\r\n",
        b"RTSP/1.0 " + b"2" * 5000 + b" OK\r\n\r\n",
    ],
)
def test_an_answer_whose_numbers_are_none_is_refused(octets):
    """What Latin-1 calls a digit is no number, nor are thousands of digits."""
    with pytest.raises(FrameError, match="RTSP answer"):
        list(rtp.take(bytearray(octets)))


@pytest.mark.parametrize("digits", ["0", "9" * 5000, "4294967296"])
def test_a_clock_that_no_packet_can_have_is_refused(digits):
    """Its rate is a number of 32 bits above 0."""
    with pytest.raises(FrameError, match="clock"):
        rtp.clock_hz(f"a=rtpmap:96 com.pupillabs.gaze1/{digits}".encode())


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[]",
        b"[" * 100_000,
        b'{"result": 5}',
        b'{"result": [{"model": "Phone"}]}',
        b'{"result": []}',
        b'{"result": [{"model": "Phone", "data": {"battery_level": 1' + b"0" * 400 + b"}}]}",
        b'{"result": [{"model": "Phone", "data": {"time_echo_port": Infinity}}]}',
        b'{"result": [{"model": "Phone", "data": {"time_echo_port": 70000}}]}',
        b'{"result": [{"model": "Phone", "data": {}}, {"model": "Hardware", "data": {"module_serial": "\\ud800"}}]}',
    ],
)
def test_a_status_that_is_none_is_refused(body):
    """Whatever else answers on that port; no text and no number of it is one that somebody behind stumbles over."""
    with pytest.raises(FrameError, match="no status"):
        companion.decode_status(body)


@pytest.mark.parametrize(
    "odd",
    [{"port": 70_000}, {"port": 0}, {"ip": "x" * 100}, {"ip": "a\0b"}, {"params": "\ud800"}, {"params": "a\r\nb"}],
)
def test_a_sensor_that_nobody_can_reach_is_refused(odd):
    """A port beyond 65535, a host that is no address, a path that would break the request."""
    told = {"sensor": "gaze", "ip": "192.168.1.5", "port": 8086, "params": "camera=gaze", "connected": True}
    parts = [("Phone", {}), ("Sensor", told | {"conn_type": "DIRECT"} | odd)]
    body = json.dumps({"result": [{"model": model, "data": data} for model, data in parts]}).encode()
    with pytest.raises(FrameError, match="no status"):
        companion.decode_status(body)


def test_a_datagram_byte_by_byte():
    """The README's frame."""
    octets = bytes.fromhex("44480000 44160000 ff 40600000") + bytes(24) + bytes.fromhex("405ccccd") + bytes(24)
    look = companion.decode_gaze(octets)
    assert (look.x, look.y, look.worn) == (800.0, 600.0, True)
    assert look.sizes_mm == pytest.approx((3.5, 3.45))


@asynccontextmanager
async def running(**more):
    host = HostClock()
    clock = DeviceClock(host.now_ns(), host.now_ns() + 300_000_000, 50.0)
    server = AppServer(VirtualApp(clock, host.now_ns(), **more), host)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


def device(port: int, model: str = "Neon") -> Companion:
    return Companion(PupilConfig(sensor_id="neon_1", model=model, address="127.0.0.1", port=port), {})


def test_a_neon_streams_is_measured_keeps_markers_and_is_lost_when_its_app_is_closed():
    """Identity, battery, contact, a clock within its uncertainty, both streams, our marker as an event; then lost."""

    async def listen():
        async with running() as server:
            neon = device(server.port)
            async with aclosing(neon.stream()) as items:
                got = await until(items, lambda item: isinstance(item, Samples))
                measured = next(item for item in got if isinstance(item, ClockMeasurement))
                event_ns = measured.device_ns + measured.offset_ns
                neon.hear(Marked(event_ns, None, "stimulus", "left"))
                await until(items, lambda _: server.app.events)
                await server.stop()
                with pytest.raises(DeviceLost, match="has ended the stream"):
                    await until(items, lambda _: False)
            return got, measured, server.app

    got, measured, app = asyncio.run(listen())
    assert Identity(serial_number="841684") in got
    assert {item.battery_percent for item in got if isinstance(item, Status)} == {77.0, None}
    assert Status(contact=1.0) in got
    assert abs(app.clock.read_ns(measured.device_ns + measured.offset_ns) - measured.device_ns) < 1e9 * (
        measured.uncertainty_s
    )
    streams = [item for item in got if isinstance(item, Declared)][-1].streams
    told = {name: (each.unit, each.sampling_frequency_hz) for name, each in streams.items()}
    assert told == EYES | {name: each for name, each in IMU.items() if name in streams}
    assert app.events == [{"name": "stimulus=left", "timestamp": measured.device_ns}]


def test_a_look_that_is_not_answered_ends_no_stream(monkeypatch):
    """The app that gives no status and no echo while gaze comes is not lost: battery and clock are left out."""
    asked = []

    async def fails(*_):
        asked.append(1)
        raise DeviceLost("slow")

    async def listen():
        async with running() as server, aclosing(device(server.port).stream()) as items:
            await anext(items)
            monkeypatch.setattr(companion_link, "status", fails)
            return await until(items, lambda item: isinstance(item, Samples) and len(asked) > 1)

    monkeypatch.setattr(companion_device, "ASK_S", 0.1)
    assert not [item for item in asyncio.run(listen()) if isinstance(item, ClockMeasurement)]
    assert len(asked) > 1


@pytest.mark.parametrize("name", ["phone..lab", "x" * 64, "."])
def test_a_name_that_no_computer_can_have_is_said(name):
    """A slip in the study's address is a device that is not there, and no traceback."""
    with pytest.raises(DeviceLost, match=re.escape(name)):
        asyncio.run(companion_link.status(name, 8080))


def test_nobody_there_is_said_with_the_address():
    """No app at that address: DeviceLost that names it."""

    async def listen():
        async with running() as server:
            port = server.port
        async with aclosing(device(port).stream()) as items:
            await until(items, lambda _: False)

    with pytest.raises(DeviceLost, match=r"Companion app at 127\.0\.0\.1"):
        asyncio.run(listen())


@given(time_s=some.floats(0, 100))
def test_the_imu_says_how_the_head_nods(time_s):
    """Gravity and rate of turn in canonical units, the quaternion's scalar first, at the phone's own time to the ns."""
    motion = imu.decode_motion(imu_message(time_s, UNIX_NS + 1))
    angle = math.radians(10) * math.sin(math.pi * time_s)
    assert motion.time_ns == UNIX_NS + 1
    assert motion.acceleration == pytest.approx((0, 9.80665 * math.sin(angle), 9.80665 * math.cos(angle)), abs=1e-5)
    assert motion.turn == pytest.approx((math.radians(10) * math.pi * math.cos(math.pi * time_s), 0, 0), abs=1e-6)
    assert motion.orientation == pytest.approx((math.cos(angle / 2), math.sin(angle / 2), 0, 0), abs=1e-6)


@given(cut=some.integers(0, 60), flip=some.integers(0, 500))
def test_a_spoilt_packet_of_the_imu_is_a_frame_error_or_another_value(cut, flip):
    """Whatever comes, nothing but FrameError is raised."""
    octets = bytearray(imu_message(1.3, UNIX_NS))[: max(1, 64 - cut)]
    octets[flip % len(octets)] ^= 1 << (flip % 8)
    try:
        assert len(imu.decode_motion(bytes(octets)).orientation) == 4
    except FrameError:
        return


def test_a_neon_s_imu_is_three_streams_at_its_own_rate():
    """Declared once their rate is known, each sample at the phone's time."""

    async def listen():
        async with running() as server, aclosing(device(server.port).stream()) as items:
            return await until(items, lambda item: isinstance(item, Samples) and item.sensor_type == "orientation")

    got = asyncio.run(listen())
    declared = [item.streams for item in got if isinstance(item, Declared)][-1]
    assert {name: (declared[name].unit, declared[name].sampling_frequency_hz) for name in IMU} == IMU
    samples = next(item for item in got if isinstance(item, Samples) and item.sensor_type == "accelerometer")
    assert np.linalg.norm(samples.chunk.samples, axis=1) == pytest.approx(9.80665, abs=1e-4)


def test_what_carries_its_own_time_waits_for_no_report(monkeypatch):
    """A packet of the IMU or an eye event before the first sender report is taken; of gaze nobody knows the time.

    Gaze whose time nobody ever learns is as good as none: lost.
    """
    monkeypatch.setattr(rtp, "report", lambda octets: None)
    monkeypatch.setattr(companion_device, "SILENCE_S", 4.0)
    got = []

    async def listen():
        async with running() as server, aclosing(device(server.port).stream()) as items:
            await until(items, got.append)

    with pytest.raises(DeviceLost, match="no gaze for 4 s"):
        asyncio.run(asyncio.wait_for(listen(), DEADLINE_S))
    assert {item.sensor_type for item in got if isinstance(item, Samples)} == set(IMU)


def test_a_neon_s_links_are_waited_for_together_and_not_for_each_packet(monkeypatch):
    """Three links with 310 packets a second are read at most at every MESSAGE_S, at the same moments."""
    reads_s, read = [], stamped.read
    monkeypatch.setattr(stamped, "read", lambda link: reads_s.append(time.monotonic()) or read(link))

    async def listen():
        async with running() as server, aclosing(device(server.port).stream()) as items:
            await until(items, lambda item: isinstance(item, Samples) and item.sensor_type == "orientation")

    asyncio.run(listen())
    frames = {int(at_s / MESSAGE_S) for at_s in reads_s}
    assert 10 < len(reads_s) <= 3 * len(frames)


def until_stamped(link, sender):
    """The kernel stamps from some moment on after the first socket of the machine has asked it to (net/core/dev.c)."""
    deadline_s, told = time.monotonic() + DEADLINE_S, []
    while not told:
        assert time.monotonic() < deadline_s, "the kernel stamps nothing"
        sender.sendall(b"-")
        select.select([link], [], [], DEADLINE_S)
        _, told, _, _ = link.recvmsg(1, socket.CMSG_SPACE(stamped.TIME.size))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems stamp nothing")
def test_what_is_read_late_is_stamped_as_it_came():
    """The receipt is that of the last octets, as the kernel took them, and not that of the read."""

    async def connect():
        with socket.create_server(("127.0.0.1", 0)) as server:
            link = await stamped.connected(*server.getsockname())
            return link, server.accept()[0]

    link, sender = asyncio.run(connect())
    with link, sender:
        assert stamped.read(link) is None
        until_stamped(link, sender)
        sender.sendall(b"ab")
        before_ns = time.time_ns()
        sender.sendall(b"cd")
        select.select([link], [], [], DEADLINE_S)
        while len(link.recv(4, socket.MSG_PEEK)) < 4:
            pass
        after_ns = time.time_ns()
        received_ns, octets = stamped.read(link)
    assert octets == b"abcd"
    assert before_ns <= received_ns <= after_ns


def test_a_reconnect_withdraws_no_stream_of_a_neon():
    """The IMU's streams are known later than gaze: from the first word of the new connection on all are declared."""
    known, declared = Known(), []
    for connection in range(2):
        known.connected()
        told, found = Told(1600, 1200, known), []
        for at in range(800):
            time_ns = UNIX_NS + connection * 10**10 + at * 5_000_000
            came = [Came("gaze", time_ns, GAZE, 0)]
            came += [Came("imu", 0, imu_message(at / 200, time_ns), 0)] if at > 400 else []
            found += told.take([Arrival(time_ns, each) for each in came])
        declared.append([set(item.streams) for item in found if isinstance(item, Declared)])
    everything = {"eye_tracking", *IMU}
    assert declared == [[{"eye_tracking"}, everything], [everything, everything]]


def test_one_packet_that_makes_no_sense_costs_that_packet():
    """Told as a frame error; the link stays, and what comes after it is taken."""
    head = bytes.fromhex("0060000100000000 00000000")  # RTP of version 0

    async def listen():
        async with running() as server:
            player = Player.send
            spoilt = iter([b"$\0" + len(head).to_bytes(2, "big") + head])
            with pytest.MonkeyPatch.context() as patched:
                patched.setattr(Player, "send", lambda self, time_s: player(self, time_s) + next(spoilt, b""))
                async with aclosing(device(server.port).stream()) as items:
                    return await until(items, lambda item: isinstance(item, Samples))

    got = asyncio.run(listen())
    assert ["no RTP packet" in str(item) for item in got if isinstance(item, FrameError)] == [True]


def test_missing_packets_are_told_where_no_stamps_show_them():
    """Of gaze without a rhythm by the packets' numbers; of eye events as an error that counts them."""
    told, events, steps = Told(1600, 1200), [], np.cumsum(np.resize([2, 31, 5, 80], 60)) * 1_000_000
    for number, step_ns in enumerate(steps.tolist()):
        came = Came("gaze", UNIX_NS + step_ns, GAZE, 3 if number == 50 else 0)
        events += told.take([Arrival(UNIX_NS + step_ns, came)])
    lost = [item.lost for item in events if isinstance(item, Samples)]
    assert (sum(lost), len(lost) > 50) == (3, True)
    keep_alive = (5).to_bytes(4, "big")
    (error,) = told.take([Arrival(UNIX_NS + int(steps[-1]), Came("eye_events", UNIX_NS, keep_alive, 2))])
    assert "2 packets of eye events are missing" in str(error)


def test_nothing_is_held_back_where_the_host_s_clock_was_set_back():
    """By an hour, in the middle of three seconds: gaze goes on as it came."""
    told, came = Told(1600, 1200), 0
    for number in range(600):
        at_ns = UNIX_NS + number * 5_000_000
        received_ns = at_ns - (3600 * 10**9 if number >= 300 else 0)
        items = list(told.take([Arrival(received_ns, Came("gaze", at_ns, GAZE, 0))]))
        came += sum(len(item.chunk.samples) for item in items if isinstance(item, Samples))
    assert came > 570


def test_a_phone_whose_clock_is_set_back_at_first_is_listened_to_anew():
    """A stream whose first second goes back by an hour is declared a second later, and nothing is held back for it."""
    rows = Rows("eyelids", ("mm", 0.0, 20.0, 32, ("aperture_left", "aperture_right")))
    times_ns = [10**18 + at * 5_000_000 - (3600 * 10**9 if at > 50 else 0) for at in range(400)]
    told = []
    for at, time_ns in enumerate(times_ns):
        rows.push(Row(time_ns, time_ns, (9.0, 9.0)))
        told += [at] * rows.listen()
    assert told == [251]
    assert rows.stream.sampling_frequency_hz == 200.0


def test_a_clock_that_stands_still_holds_no_more_than_so_much():
    """Rows that tell no rate are left out, each time with their number; once the time goes on they are declared."""
    rows = Rows("eyelids", ("mm", 0.0, 20.0, 32, ("aperture_left", "aperture_right")))
    errors = []
    for _ in range(2 * (MOST + 1)):
        try:
            rows.push(Row(10**18, 1, (9.0, 9.0)))
        except FrameError as err:
            errors.append(str(err))
        assert not rows.listen()
        assert len(rows._rows) <= MOST
    assert errors == [f"eyelids: {MOST} readings within 1 s of the device's time: it stands still"] * 2
    for at in range(300):
        rows.push(Row(10**18 + at * 5_000_000, 1, (9.0, 9.0)))
        rows.listen()
    assert rows.stream.sampling_frequency_hz == 200.0
