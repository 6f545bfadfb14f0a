"""sensor_bench as a process, seen through unmodified bleak, HTTP and ROS."""

import asyncio
import itertools
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bleak import BleakClient, BleakScanner
from bleak.exc import BleakError, BleakGATTProtocolError
from dbus_fast import BusType, Message, MessageType
from dbus_fast.aio import MessageBus
from hri_msgs.msg import Expression, IdsList
from processes import DEADLINE_S, poll
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_bench_process import READY_S, SILENT_DOMAIN, BenchProcess
from std_msgs.msg import String

CONTROL = "fb005c81-02e7-f387-1cad-8acd2d8df0c8"
DATA = "fb005c82-02e7-f387-1cad-8acd2d8df0c8"
HEART_RATE = "2a37"
BATTERY = "2a19"
START_ECG = bytes.fromhex("02 00 00 01 82 00 01 01 0e 00")
START_PPG = bytes.fromhex("02 01 00 01 37 00 01 01 16 00 04 01 04")
STOP_ECG = bytes.fromhex("03 00")
H10_1, VERITY_1, H10_2 = "F1:4A:10:00:00:01", "F1:4A:10:00:00:02", "F1:4A:10:00:00:03"
TEST_S = 250.0


@pytest.fixture
def running() -> Iterator[Callable[[BenchProcess], BenchProcess]]:
    """running(BenchProcess(...)) returns a bench of the test's own, ready, and ends it after the test."""
    benches: list[BenchProcess] = []

    def keep(bench: BenchProcess) -> BenchProcess:
        benches.append(bench)
        return bench.until_ready()

    yield keep
    for bench in benches:
        bench.end()


class Strap:
    """A connection with all notifications in queues."""

    def __init__(self, client: BleakClient) -> None:
        self.client = client
        self.control: asyncio.Queue[bytes] = asyncio.Queue()
        self.data: asyncio.Queue[bytes] = asyncio.Queue()

    async def begin(self, *commands: bytes) -> "Strap":
        await self.client.start_notify(CONTROL, lambda _, value: self.control.put_nowait(bytes(value)))
        await self.client.start_notify(DATA, lambda _, value: self.data.put_nowait(bytes(value)))
        for command in commands:
            assert (await self.command(command))[3] == 0
        return self

    async def command(self, command: bytes) -> bytes:
        await self.client.write_gatt_char(CONTROL, command, response=True)
        return await asyncio.wait_for(self.control.get(), DEADLINE_S)

    async def frames(self, count: int) -> list[bytes]:
        return [await asyncio.wait_for(self.data.get(), DEADLINE_S) for _ in range(count)]

    async def frame_with(self, true: Callable[[bytes], bool]) -> bytes:
        """The next frame of which this is true; those on their way before it are passed over."""
        deadline = time.monotonic() + DEADLINE_S
        while not true(frame := (await self.frames(1))[0]):
            assert time.monotonic() < deadline
        return frame


def device_ns(frame: bytes) -> int:
    return int.from_bytes(frame[1:9], "little")


def play(work: Any) -> Any:
    return asyncio.run(asyncio.wait_for(work, TEST_S))


async def until(condition: Any, seconds: float = DEADLINE_S) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.02)


async def found(address: str) -> Any:
    device = await BleakScanner.find_device_by_address(address, timeout=DEADLINE_S)
    assert device is not None, f"{address} does not advertise"
    return device


def connection(device: Any, **options: Any) -> BleakClient:
    """A client that is patient with a busy machine: bleak's own gives up after 10 s."""
    return BleakClient(device, timeout=DEADLINE_S, **options)


async def scan(enough: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """What a scan sees (device and advertisement by address), once it has seen enough."""
    deadline = time.monotonic() + DEADLINE_S
    while not enough(seen := await BleakScanner.discover(timeout=1.0, return_adv=True)):
        assert time.monotonic() < deadline, seen
    return seen


def test_all_four_devices_advertise_and_rssi_and_battery_follow_the_knobs(bench):
    """A scan sees the four devices with their names and signal strengths; a knob changes what the next scan sees."""

    async def use() -> None:
        seen = await scan(lambda seen: len(seen) >= 4)
        assert {device.name for device, _ in seen.values()} == {
            "Polar H10 1A2B3C01",
            "Polar Sense 1A2B3C02",
            "Polar H10 1A2B3C03",
            "Polar Sense 1A2B3C04",
        }
        assert seen[H10_1][1].rssi == -52
        await asyncio.to_thread(bench.knobs, "h10_1", rssi_dbm=-83, battery_percent=12)
        seen = await scan(lambda seen: H10_1 in seen and seen[H10_1][1].rssi != -52)
        assert seen[H10_1][1].rssi == -83
        async with connection(seen[H10_1][0]) as client:
            assert await client.read_gatt_char(BATTERY) == b"\x0c"
            assert await client.read_gatt_char("2a25") == b"1A2B3C01"
            changed: asyncio.Queue[bytes] = asyncio.Queue()
            await client.start_notify(BATTERY, lambda _, value: changed.put_nowait(bytes(value)))
            await asyncio.to_thread(bench.knobs, "h10_1", battery_percent=11)
            assert await asyncio.wait_for(changed.get(), DEADLINE_S) == b"\x0b"

    play(use())


def test_a_broken_link_is_noticed_and_the_same_strap_streams_again(bench):
    """After a link drop the client is told, reconnects, starts ECG with status 0, and the device clock has run on."""

    async def use() -> None:
        gone = asyncio.Event()
        async with connection(await found(H10_1), disconnected_callback=lambda _: gone.set()) as client:
            strap = await Strap(client).begin(START_ECG)
            before = await strap.frames(3)
            assert all(len(frame) == 229 and frame[0] == 0 and frame[9] == 0 for frame in before)
            steps_s = [(device_ns(b) - device_ns(a)) * 1e-9 for a, b in itertools.pairwise(before)]
            assert steps_s == pytest.approx([73 / (130 * 1.00131)] * 2, rel=1e-3)
            assert await strap.command(START_ECG) == bytes.fromhex("f0 02 00 06 00")
            await asyncio.to_thread(bench.knobs, "h10_1", drop=True)
            await asyncio.wait_for(gone.wait(), DEADLINE_S)
            assert not client.is_connected
        async with connection(await found(H10_1)) as client:
            strap = await Strap(client).begin(START_ECG)
            after = await strap.frames(3)
            assert 0.5e9 < device_ns(after[0]) - device_ns(before[-1]) < TEST_S * 1e9
            assert (await strap.command(STOP_ECG))[3] == 0

    before = bench.truth("h10_1")
    play(use())
    after = bench.truth("h10_1")
    assert after["connections_total"] == before["connections_total"] + 2
    assert after["streams"]["ecg"]["samples_sent"] >= before["streams"]["ecg"]["samples_sent"] + 6 * 73


def test_two_devices_stream_at_once_and_one_broken_link_leaves_the_other_alone(bench):
    """An H10 and a Verity Sense stream in one client; the H10's link breaks and the Verity's frames go on."""

    async def use() -> None:
        strap_device, band_device = await found(H10_1), await found(VERITY_1)
        async with connection(band_device) as band_client:
            async with connection(strap_device) as strap_client:
                strap, band = await asyncio.gather(
                    Strap(strap_client).begin(START_ECG), Strap(band_client).begin(START_PPG)
                )
                ecg, ppg = await asyncio.gather(strap.frames(2), band.frames(2))
                assert {frame[0] for frame in ecg} == {0}
                assert {(frame[0], frame[9]) for frame in ppg} == {(1, 0x80)}
                await asyncio.to_thread(bench.knobs, "h10_1", drop=True)
                await until(lambda: not strap_client.is_connected)
            after = await band.frames(4)
            assert band_client.is_connected
            steps_s = [(device_ns(b) - device_ns(a)) * 1e-9 for a, b in itertools.pairwise([ppg[-1], *after])]
            assert max(steps_s) < 65 / 54.5

    play(use())


def test_link_knobs_delay_and_lose_frames_and_the_truth_counts_them(bench):
    """Latency shows between sample and arrival, loss as missing device time; /truth says how many samples were lost."""

    async def use() -> None:
        async with connection(await found(H10_2)) as client:
            strap = Strap(client)
            await strap.begin(START_ECG)
            await asyncio.to_thread(bench.knobs, "h10_2", latency_s=0.4, jitter_s=0.0)
            await strap.frames(3)
            frame, arrived_ns = (await strap.frames(1))[0], time.time_ns()
            clock = await asyncio.to_thread(bench.truth, "h10_2")
            elapsed_ns = (device_ns(frame) - clock["reference_device_ns"]) / (1 + clock["skew_ppm"] * 1e-6)
            delay_s = (arrived_ns - clock["reference_host_ns"] - elapsed_ns) * 1e-9
            assert 0.399 <= delay_s < 60.0  # a few ms more on an idle machine, seconds on a busy one
            await asyncio.to_thread(bench.knobs, "h10_2", loss=1.0)
            await until(lambda: bench.truth("h10_2")["streams"]["ecg"]["frames_lost"] >= 2)
            await asyncio.to_thread(bench.knobs, "h10_2", loss=0.0, latency_s=0.0)
            stamps = [device_ns(frame)]
            await strap.frame_with(lambda f: stamps.append(device_ns(f)) or stamps[-1] - stamps[-2] > 1e9)
            stamps += [device_ns(f) for f in await strap.frames(2)]
            steps = [round((b - a) * 1e-9 * 130 * 0.99925) for a, b in itertools.pairwise(stamps)]
            lost = bench.truth("h10_2")["streams"]["ecg"]["samples_lost"]
            assert sum(steps) - 73 * len(steps) == lost

    play(use())


def test_a_clock_reset_a_cut_frame_and_a_stop_by_the_device_reach_the_client(bench):
    """clock_reset sends the device's stamps back to 2019, garbled_frames cuts a frame, stop_stream is indicated."""

    async def use() -> None:
        async with connection(await found(H10_1)) as client:
            strap = await Strap(client).begin(START_ECG)
            before = device_ns((await strap.frames(1))[0])
            await asyncio.to_thread(bench.knobs, "h10_1", clock_reset=True)
            reset = await strap.frame_with(lambda frame: device_ns(frame) < before)
            assert device_ns(reset) > 599_616_000_000_000_000
            await asyncio.to_thread(bench.knobs, "h10_1", garbled_frames=1)
            assert len(await strap.frame_with(lambda frame: len(frame) != 229)) == 23
            assert [len(frame) for frame in await strap.frames(2)] == [229, 229]
            await asyncio.to_thread(bench.knobs, "h10_1", stop_stream="ecg")
            assert await asyncio.wait_for(strap.control.get(), DEADLINE_S) == bytes([1, 0])

    play(use())


def test_bluez_refuses_what_bluetoothd_refuses(bench):
    """Notify-only reads are not permitted, a second StartDiscovery of one sender is in progress, MTU is 232."""

    async def use() -> None:
        async with connection(await found(H10_1)) as client:
            with pytest.raises(BleakGATTProtocolError, match="Read Not Permitted"):
                await client.read_gatt_char(HEART_RATE)
            assert client.services.get_characteristic(DATA).max_write_without_response_size == 229
            control: asyncio.Queue[bytes] = asyncio.Queue()
            await client.start_notify(CONTROL, lambda _, value: control.put_nowait(bytes(value)))
            features = bytes(await client.read_gatt_char(CONTROL))
            assert features == bytes.fromhex("0f05") + bytes(15)
            assert (
                await asyncio.wait_for(control.get(), DEADLINE_S) == features
            )  # the read arrives as a notification too
        one = await MessageBus(bus_address=bench.address, bus_type=BusType.SYSTEM).connect()
        two = await MessageBus(bus_address=bench.address, bus_type=BusType.SYSTEM).connect()

        async def call(bus: MessageBus, member: str) -> Message:
            reply = await bus.call(
                Message(destination="org.bluez", path="/org/bluez/hci0", interface="org.bluez.Adapter1", member=member)
            )
            assert reply is not None
            return reply

        assert (await call(one, "StartDiscovery")).message_type is MessageType.METHOD_RETURN
        assert (await call(one, "StartDiscovery")).error_name == "org.bluez.Error.InProgress"
        assert (await call(two, "StopDiscovery")).error_name == "org.bluez.Error.Failed"
        assert (await call(two, "StartDiscovery")).message_type is MessageType.METHOD_RETURN
        assert (await call(one, "StopDiscovery")).message_type is MessageType.METHOD_RETURN
        two.disconnect()
        await two.wait_for_disconnect()
        nonsense = Message(
            destination="org.bluez", path="/org/bluez/hci0", interface="org.bluez.Adapter1", member="RemoveDevice"
        )
        assert (await one.call(nonsense)).error_name == "org.freedesktop.DBus.Error.InvalidArgs"
        discovering = Message(
            destination="org.bluez",
            path="/org/bluez/hci0",
            interface="org.freedesktop.DBus.Properties",
            member="Get",
            signature="ss",
            body=["org.bluez.Adapter1", "Discovering"],
        )
        deadline = time.monotonic() + DEADLINE_S
        while (await one.call(discovering)).body[0].value:  # the vanished sender's session ends with it
            assert time.monotonic() < deadline
            await asyncio.sleep(0.05)
        one.disconnect()
        await one.wait_for_disconnect()

    play(use())


def test_notifications_through_a_socket(bench):
    """AcquireNotify hands out a socket that carries the frames, until the client closes it."""

    async def use() -> None:
        async with connection(await found(H10_1)) as client:
            data: asyncio.Queue[bytes] = asyncio.Queue()
            strap = Strap(client)
            await client.start_notify(CONTROL, lambda _, value: strap.control.put_nowait(bytes(value)))
            await client.start_notify(
                DATA, lambda _, value: data.put_nowait(bytes(value)), bluez={"use_start_notify": False}
            )
            assert (await strap.command(START_ECG))[3] == 0
            assert len(await asyncio.wait_for(data.get(), DEADLINE_S)) == 229
            await client.stop_notify(DATA)
            received = data.qsize()
            assert (await strap.command(STOP_ECG))[3] == 0
            assert data.qsize() == received

    play(use())


def test_a_strap_taken_off_sends_noise_and_no_heart_rate(bench):
    """Without contact the heart-rate flags say so, the rate is 0 and there is no RR; with contact it all returns."""

    async def use() -> None:
        async with connection(await found(H10_2)) as client:
            rates: asyncio.Queue[bytes] = asyncio.Queue()
            await client.start_notify(HEART_RATE, lambda _, value: rates.put_nowait(bytes(value)))
            await asyncio.to_thread(bench.knobs, "h10_2", contact=False)
            while (value := await asyncio.wait_for(rates.get(), DEADLINE_S))[0] & 0x06 != 0x04:
                pass
            assert value == bytes([0x04, 0])
            await asyncio.to_thread(bench.knobs, "h10_2", contact=True)
            while (value := await asyncio.wait_for(rates.get(), DEADLINE_S))[0] & 0x16 != 0x16:
                pass
            assert 70 < value[1] < 95

    play(use())


def test_an_aborted_connection_attempt_is_retried_by_bleak(bench):
    """le-connection-abort-by-local on Connect is what bleak knows from BlueZ: it tries again and gets through."""

    async def use() -> None:
        device = await found(H10_1)
        await asyncio.to_thread(bench.knobs, "h10_1", abort_connects=1)
        async with connection(device) as client:
            assert client.is_connected

    before = bench.truth("h10_1")["connections_total"]
    play(use())
    assert bench.truth("h10_1")["connections_total"] == before + 2


def test_a_device_out_of_range_is_not_connected_and_comes_back(bench):
    """With `down` a device is not found and a connection attempt times out; set back, it streams."""

    async def use() -> None:
        device = await found(H10_1)
        await asyncio.to_thread(bench.knobs, "h10_1", down=True)
        await until(lambda: bench.read("/devices")[0]["knobs"]["down"])
        with pytest.raises(TimeoutError):
            await BleakClient(device, timeout=1.5).connect()
        seen = await BleakScanner.discover(timeout=1.0, return_adv=True)
        assert H10_1 not in {address for address, (_, adv) in seen.items() if adv.rssi != -127}
        await asyncio.to_thread(bench.knobs, "h10_1", down=False)
        async with connection(await found(H10_1)) as client:
            await (await Strap(client).begin(START_ECG)).frames(1)

    play(use())


async def scan_until(wanted: Any) -> str:
    """Scan until the outcome, "ok" or bleak's message, is as wanted."""
    deadline = time.monotonic() + DEADLINE_S
    while True:
        try:
            await BleakScanner.discover(timeout=0.2)
            outcome = "ok"
        except BleakError as error:
            outcome = str(error.args[0])
        if wanted(outcome):
            return outcome
        assert time.monotonic() < deadline, outcome
        await asyncio.sleep(0.05)  # without an adapter discover() fails without giving way


def test_adapter_off_and_gone_are_what_bleak_calls_them(bench):
    """A powered-off or absent adapter breaks links and makes scans fail; powered on again everything works."""

    async def use() -> None:
        async with connection(await found(H10_1)) as client:
            await asyncio.to_thread(bench.post, "/adapter", powered=False)
            await until(lambda: not client.is_connected)
            assert await scan_until(lambda outcome: outcome.startswith("No powered Bluetooth adapters"))
        await asyncio.to_thread(bench.post, "/adapter", present=False)
        assert await scan_until(lambda outcome: outcome == "No Bluetooth adapters found.")
        await asyncio.to_thread(bench.post, "/adapter", present=True)
        assert await scan_until(lambda outcome: outcome == "ok")
        async with connection(await found(H10_1)) as client:
            await (await Strap(client).begin(START_ECG)).frames(1)

    play(use())


KILLED_CLIENT = """
import asyncio, sys
from bleak import BleakClient, BleakScanner
async def main():
    device = await BleakScanner.find_device_by_address(sys.argv[1], timeout=60)
    async with BleakClient(device, timeout=60) as client:
        print("connected", flush=True)
        await asyncio.sleep(600)
asyncio.run(main())
"""


def test_the_strap_of_a_killed_client_is_released(bench):
    """A client that vanishes from the bus without a word loses its link, and the next client gets the device."""
    command = [sys.executable, "-c", KILLED_CLIENT, H10_1]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=dict(os.environ)) as client:
        assert client.stdout is not None
        assert client.stdout.readline() == "connected\n"
        assert bench.read("/devices")[0]["connected"]
        client.send_signal(signal.SIGKILL)
    poll(lambda: not bench.read("/devices")[0]["connected"], "link of the killed client ended")


def test_malformed_requests_are_400_with_a_reason_and_change_nothing(bench):
    """Bad JSON, unknown knobs, values out of range or of a wrong type: 400 and the name of what is wrong."""
    before = bench.read("/devices")
    for path, body, reason in [
        ("/devices/h10_1/knobs", b"{", "not JSON"),
        ("/devices/h10_1/knobs", b"[]", "object"),
        ("/devices/h10_1/knobs", b"\xff\xfe", "not JSON"),
        ("/devices/h10_1/knobs", b'{"latency": 1}', "latency"),
        ("/devices/h10_1/knobs", b'{"loss": 2, "latency_s": 0.5}', "loss"),
        ("/devices/h10_1/knobs", b'{"latency_s": 0.5, "loss": NaN}', "loss"),
        ("/devices/h10_1/knobs", b'{"drop": 1}', "drop"),
        ("/devices/h10_1/knobs", b'{"clock_reset": "yesterday"}', "clock_reset"),
        ("/devices/h10_1/knobs", b'{"stop_stream": "ecg"}', "stop_stream"),
        ("/faces", b'{"face_a": {"expression": "surprise"}}', "surprise"),
        ("/faces", b'{"count": -1}', "count"),
        ("/adapter", b'{"powered": "no"}', "powered"),
    ]:
        status, answer = bench.ask(path, body)
        assert status == 400, (path, body, answer)
        assert reason in answer["error"]
    assert bench.request("/devices/nobody/knobs", b'{"drop": true}')[0] == 404
    assert bench.request("/devices/h10_1/knobs")[0] == 405
    assert bench.read("/devices") == before


def test_a_second_bench_on_the_same_socket_and_a_wrong_cast_are_configuration_errors(bench, tmp_path):
    """Status 78 and one line that names the parameter; the first bench's bus is left alone."""
    for parameters, reason in [
        ({"socket_path": str(bench.socket)}, "socket_path"),
        ({"socket_path": "/proc/nowhere/bus"}, "no bus can be made at /proc/nowhere/bus"),
        ({"devices": "participants: {}\ndevices: [{sensor: x}]"}, "devices[0]: model is missing"),
        ({"input": "/nowhere.hea"}, "input"),
    ]:
        folder = tmp_path / reason.partition("[")[0].replace("/", "_")
        folder.mkdir(exist_ok=True)
        second = BenchProcess(folder, SILENT_DOMAIN, **parameters)
        assert second.wait() == 78, second.log()
        assert reason in second.log()
        assert "Traceback" not in second.log()
    assert len(bench.read("/devices")) == 4
    assert play(found(H10_1)) is not None


def test_who_asks_while_the_bench_starts_is_not_told_that_there_is_nothing(tmp_path: Path) -> None:
    """Its bus and its hearts take seconds: until then a request waits, or is answered 503."""
    bench = BenchProcess(tmp_path, SILENT_DOMAIN, ros4hri=False)
    statuses: list[int] = []

    def answered() -> bool:
        statuses.append(bench.ask("/devices")[0])
        return statuses[-1] == 200

    try:
        poll(answered, "the devices", READY_S)
        assert set(statuses) <= {200, 503}
    finally:
        bench.end()


def test_sigterm_while_streaming_ends_with_0_and_a_killed_bench_leaves_no_bus(running, tmp_path, monkeypatch):
    """SIGTERM ends bus and process in 10 s and with 0 while a strap streams; after SIGKILL the bus does not linger."""
    bench = running(BenchProcess(tmp_path, SILENT_DOMAIN, ros4hri=False))
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", bench.address)

    async def use() -> None:
        client = connection(await found(H10_1))
        await client.connect()
        await (await Strap(client).begin(START_ECG)).frames(1)
        assert await asyncio.to_thread(bench.stop_within) == 0, bench.log()
        await until(lambda: not client.is_connected)

    play(use())
    assert not bench.socket.exists()
    killed = running(BenchProcess(tmp_path, SILENT_DOMAIN, ros4hri=False))
    killed.kill()

    def bus_is_gone() -> bool:
        with socket.socket(socket.AF_UNIX) as probe:
            return probe.connect_ex(str(bench.socket)) != 0

    poll(bus_is_gone, "the bus of the killed bench is gone")


def test_the_ros4hri_side_behaves_like_the_real_nodes(ears, running, tmp_path):
    """Faces at 10 Hz, unstamped expressions at 2 Hz, persons latched, face_id repeated; /faces changes what is seen."""
    bench = running(BenchProcess(tmp_path))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    faces = ears.hear(IdsList, "/humans/faces/tracked", 10)
    persons = ears.hear(IdsList, "/humans/persons/tracked", latched)
    face_of_p1 = ears.hear(String, "/humans/persons/p1/face_id", latched)
    expressions = ears.hear(Expression, "/humans/faces/face_a/expression", 10)
    ears.until(lambda: faces and persons and face_of_p1 and expressions, "every topic heard")
    assert faces[-1].ids == ["face_a", "face_b"]
    assert persons[-1].ids == ["p1", "p2"]
    assert face_of_p1[-1].data == "face_a"
    said = expressions[-1]
    assert (said.expression, said.header.stamp.sec, said.header.stamp.nanosec) == ("neutral", 0, 0)
    bench.post("/faces", face_a={"expression": "angry", "confidence": 0.5})
    ears.until(lambda: expressions[-1].expression == "angry", "angry face")
    bench.post("/faces", count=0)
    ears.until(lambda: faces[-1].ids == [], "no face")
    ears.until(lambda: persons[-1].ids == [], "no person")
    ears.until(lambda: face_of_p1[-1].data == "", "empty face id")
    assert bench.stop() == 0, bench.log()


def test_a_real_recording_is_played_over_the_air(running, tmp_path, monkeypatch, shared_data):
    """With `input` the strap of p1 sends the record's ECG at 130 Hz, and the truth has the record's heart rate."""
    record = shared_data / "ecg" / "mitdb" / "100.hea"
    bench = running(BenchProcess(tmp_path, SILENT_DOMAIN, ros4hri=False, input=str(record)))
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", bench.address)

    async def use() -> list[bytes]:
        async with connection(await found(H10_1)) as client:
            return await (await Strap(client).begin(START_ECG)).frames(6)

    frames = play(use())
    beats_ns = np.array(bench.truth("h10_1")["beats_device_ns"])
    participant = bench.read("/truth")["participants"]["p1"]
    assert participant["source"].startswith("recording")
    assert 70 < participant["heart_rate_bpm"] < 80  # 100: 75 per minute
    content = b"".join(frame[10:] for frame in frames)
    ecg = np.array([int.from_bytes(content[i : i + 3], "little", signed=True) for i in range(0, len(content), 3)])
    fs_hz = 130 * 1.00131
    times_ns = device_ns(frames[-1]) - (ecg.size - 1 - np.arange(ecg.size)) / fs_hz * 1e9
    peaks_ns = times_ns[(ecg > np.roll(ecg, 1)) & (ecg > np.roll(ecg, -1)) & (ecg > ecg.mean() + 600)]
    assert peaks_ns.size >= 3
    assert max(np.abs(beats_ns - peak_ns).min() for peak_ns in peaks_ns) < 20e6
