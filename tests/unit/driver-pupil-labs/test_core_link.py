"""Pupil Core over real sockets: its clock, its markers, and what becomes of it when Capture is closed."""

import asyncio
from contextlib import aclosing, asynccontextmanager, closing

import msgpack
import numpy as np
import pytest
import zmq
from driver_pupil_labs.config import PupilConfig
from driver_pupil_labs.device import Core
from driver_pupil_labs.exchange import Asked, best
from driver_pupil_labs.protocol import MODELLED
from driver_pupil_labs.transport import CaptureLink, Heard
from listened import until
from sense4hri.device import ClockMeasurement, Declared, Identity, Marked, Samples
from sense4hri.errors import DeviceLost
from sensor_bench.clock import DeviceClock, HostClock
from sensor_bench.pupil_core.capture import VirtualCapture
from sensor_bench.pupil_core.server import CaptureServer

DEADLINE_S = 20.0


@asynccontextmanager
async def running(address: str = "127.0.0.1", **more):
    host = HostClock()
    clock = DeviceClock(host.now_ns(), 7_000_000_000_000, skew_ppm=50.0)
    server = CaptureServer(VirtualCapture(clock, host.now_ns(), **more), host, address)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


def core(port: int, address: str = "127.0.0.1") -> Core:
    return Core(PupilConfig(sensor_id="core_1", address=address, port=port), {})


def test_it_streams_and_measures_the_clock():
    """Who it is, the clock within its own uncertainty of the truth, declarations before samples."""

    async def listen():
        async with running() as server, aclosing(core(server.port).stream()) as items:
            got = await until(items, lambda item: isinstance(item, Samples))
            return got, server.capture.clock

    got, clock = asyncio.run(listen())
    assert Identity(firmware_version="Pupil Capture 3.5.1") in got
    measured = next(item for item in got if isinstance(item, ClockMeasurement))
    host_ns = measured.device_ns + measured.offset_ns
    assert abs(clock.read_ns(host_ns) - measured.device_ns) < measured.uncertainty_s * 1e9 + 50_000
    assert isinstance(got[-2], Declared | ClockMeasurement)


def test_an_address_of_ipv6_is_reached():
    """`::1`, as it stands in the study: requests and what is published."""

    async def listen():
        async with running("::1") as server, aclosing(core(server.port, "::1").stream()) as items:
            return await until(items, lambda item: isinstance(item, Samples))

    assert isinstance(asyncio.run(listen())[-1], Samples)


def test_markers_of_the_study_are_recorded_by_capture_at_their_time():
    """An annotation with the marker's name, its value and Pupil time."""

    async def listen():
        async with running() as server:
            device = core(server.port)
            async with aclosing(device.stream()) as items:
                measured = (await until(items, lambda item: isinstance(item, ClockMeasurement)))[-1]
                event_ns = measured.device_ns + measured.offset_ns + 1_000_000_000
                device.hear(Marked(event_ns, None, "stimulus", "left"))
                await until(items, lambda _: server.capture.annotations)
                return measured.device_ns, server.capture.annotations

    device_ns, annotations = asyncio.run(listen())
    assert len(annotations) == 1
    said = msgpack.unpackb(annotations[0])
    assert (said["topic"], said["label"], said["value"]) == ("annotation", "stimulus", "left")
    assert said["timestamp"] == pytest.approx(device_ns * 1e-9 + 1.0, abs=1e-6)


def test_a_capture_that_is_closed_is_lost_and_found_again_with_its_new_clock():
    """Closed: DeviceLost within seconds. Opened again: Pupil time has begun anew, and is passed on as it is."""

    async def listen():
        async with running() as server:
            port = server.port
            async with aclosing(core(port).stream()) as items:
                await until(items, lambda item: isinstance(item, Samples))
                await server.stop()
                with pytest.raises(DeviceLost, match="does not answer"):
                    await until(items, lambda item: False)
        host = HostClock()
        again = CaptureServer(VirtualCapture(DeviceClock(host.now_ns(), 10**9), host.now_ns()), host, port=port)
        await again.start()
        try:
            async with aclosing(core(port).stream()) as items:
                return await until(items, lambda item: isinstance(item, Samples))
        finally:
            await again.stop()

    assert asyncio.run(listen())[-1].chunk.device_ns < 60 * 10**9


def test_pictures_without_a_model_are_spared_and_none_of_the_model_is_missed():
    """Once told so Capture sends no `pupil.*.2d` any more; the other pictures of each eye go on one by one."""

    async def read(link, seconds):
        got = []
        async with asyncio.timeout(DEADLINE_S):
            while len({each.topic for each in got}) < 2 or time_of(got[-1]) - time_of(got[0]) < seconds:
                came = await asyncio.to_thread(link.read) or []
                got += [each for each in came if isinstance(each, Heard) and each.topic.startswith("pupil.")]
        return got

    async def listen():
        async with running() as server:
            with closing(CaptureLink("127.0.0.1", server.port)) as link:
                before = await read(link, 0.5)
                link.hear_models_only()
                return before, await read(link, 2.0)

    before, after = asyncio.run(listen())
    assert {each.topic for each in before} == {"pupil.0.2d", "pupil.1.2d", *MODELLED}
    assert {each.topic for each in after[-200:]} == set(MODELLED)
    for topic in MODELLED:
        times_s = [time_of(each) for each in before + after if each.topic == topic]
        np.testing.assert_allclose(np.diff(times_s), 1 / 120, atol=1e-4)


def time_of(heard: Heard) -> float:
    return msgpack.unpackb(heard.payload, strict_map_key=False)["timestamp"]


def test_a_model_that_is_switched_off_leads_to_sizes_in_px(monkeypatch):
    """What it sent is a silence then, though 2d pictures go on; connected again sizes are in px."""
    monkeypatch.setattr("driver_pupil_labs.device.SILENCE_S", 1.0)

    def sizes(item):
        return isinstance(item, Samples) and item.sensor_type == "pupillometry"

    async def listen():
        async with running() as server:
            device = core(server.port)
            async with aclosing(device.stream()) as items:
                await until(items, sizes)
                server.capture.model = False
                with pytest.raises(DeviceLost, match="no picture of an eye"):
                    await until(items, lambda item: False)
            async with aclosing(device.stream()) as items:
                return [item for item in await until(items, sizes) if isinstance(item, Declared)]

    assert asyncio.run(listen())[-1].streams["pupillometry"].unit == "px"


def test_what_came_before_capture_was_lost_is_read_first():
    """Its version came before it said nonsense when asked for its time: the read that fails is the one after."""

    came = []

    async def read(link):
        while True:
            came.extend(await asyncio.to_thread(link.read) or [])

    async def listen():
        async with running() as server:
            server.capture.answer = lambda parts, time_s: b"3.5.1" if parts == [b"v"] else b"nonsense"
            with closing(CaptureLink("127.0.0.1", server.port)) as link, pytest.raises(DeviceLost, match="nonsense"):
                await read(link)

    asyncio.run(listen())
    assert Identity(firmware_version="Pupil Capture 3.5.1") in came


def test_nobody_there_is_said_with_the_address():
    """No Capture at that address: DeviceLost that names it."""

    async def listen():
        async with running() as server:
            port = server.port
        async with aclosing(core(port).stream()) as items:
            await until(items, lambda item: False)

    with pytest.raises(DeviceLost, match="Pupil Capture at 127"):
        asyncio.run(listen())


def test_the_shortest_round_trip_counts():
    """Of several exchanges the one that was quickest, at the middle of its round trip."""
    measured = best([Asked(1000, 9000, 70), Asked(10_000, 10_400, 9100), Asked(20_000, 29_000, 0)], 0, "")
    assert (measured.device_ns, measured.offset_ns) == (9100, 10_200 - 9100)
    assert measured.uncertainty_s == pytest.approx(200e-9)


def test_what_a_clock_is_read_to_is_part_of_the_uncertainty():
    """A clock that is told in whole ms may be half a ms off, however quick the answer is."""
    assert best([Asked(0, 400, 9100)], 0, "", 500_000).uncertainty_s == pytest.approx(500_200e-9)


def test_a_wall_clock_that_was_set_between_two_exchanges_spoils_none_of_them():
    """Round trips are of the monotonic clock; the offset is to the wall clock as it goes now."""
    measured = best([Asked(1000, 1400, 500), Asked(20_000, 29_000, 0)], 7_000_000, "")
    assert (measured.received_ns, measured.offset_ns) == (7_029_000, 7_001_200 - 500)


@pytest.mark.parametrize("answer", [["\u00b2"], ["9" * 5000], ["50021", "and more"]])
def test_a_server_that_is_no_capture_is_lost(answer):
    """It is said what it answered, also where that looks like digits to Python, or comes in several parts."""
    with zmq.Context() as context, context.socket(zmq.REP) as server:
        port = server.bind_to_random_port("tcp://127.0.0.1")
        with closing(CaptureLink("127.0.0.1", port)) as link:
            link.read()
            assert server.recv_multipart() == [b"SUB_PORT"]
            server.send_multipart([part.encode() for part in answer])
            with pytest.raises(DeviceLost, match="no Pupil Capture"):
                _read_until_lost(link)


def _read_until_lost(link: CaptureLink) -> None:
    for _ in range(20):
        link.read()
