"""driver-polar as a real process, through unmodified bleak and a real D-Bus, against sensor-bench."""

import asyncio
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import rclpy
from dbus_fast import BusType, Message, MessageType
from dbus_fast.aio import MessageBus
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, StreamHealth

pytestmark = pytest.mark.timeout(180)

ROOT = Path(__file__).resolve().parents[2]
STRAP = {"sensor_id": "h10_1", "human_id": "p1", "model": "H10", "name": "1A2B3C01"}
BAND = {"sensor_id": "verity_1", "human_id": "p1", "model": "VeritySense", "name": "Polar Sense 1A2B3C02"}
OLD_BAND = {"sensor_id": "oh1_1", "human_id": "p2", "model": "OH1", "address": "f1:4a:10:00:00:03"}
DEVICES = """
participants: {p1: {}}
devices:
  - {sensor: h10_1, model: H10, participant: p1, address: "F1:4A:10:00:00:01", device_id: 1A2B3C01,
     skew_ppm: 38.0, rssi_dbm: -52, battery_percent: 88}
  - {sensor: verity_1, model: VeritySense, participant: p1, address: "F1:4A:10:00:00:02", device_id: 1A2B3C02,
     ppi_delay_s: 2.0, rssi_dbm: -61}
  - {sensor: oh1_1, model: OH1, participant: p1, address: "F1:4A:10:00:00:03", device_id: 1A2B3C03, ppi_delay_s: 2.0}
"""
PMD_CONTROL, PMD_DATA, HEART_RATE = (
    "fb005c81-02e7-f387-1cad-8acd2d8df0c8",
    "fb005c82-02e7-f387-1cad-8acd2d8df0c8",
    "00002a37-0000-1000-8000-00805f9b34fb",
)
G = 9.80665


def poll(condition: Callable[[], Any], seconds: float, what: Callable[[], str] | str) -> Any:
    """Return the first true result of condition; fail after so many seconds."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"not within {seconds} s: {what if isinstance(what, str) else what()}")
        time.sleep(0.02)
    return result


class Process:
    """One of our services; its log is kept in a file."""

    def __init__(self, log: Path, package: str, parameters: dict[str, Any], env: dict[str, str]) -> None:
        self.log_file = log
        given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={json.dumps(value)}")]
        with log.open("w") as out:
            self.child = subprocess.Popen(
                [sys.executable, "-m", package, "--ros-args", *given], stdout=out, stderr=out, env={**os.environ, **env}
            )

    def log(self) -> str:
        return self.log_file.read_text()

    def until(self, text: str, seconds: float = 20) -> None:
        poll(lambda: text in self.log(), seconds, lambda: f"{text!r} in:\n{self.log()}")

    def wait(self, seconds: float) -> int:
        try:
            return self.child.wait(seconds)
        except subprocess.TimeoutExpired:
            pytest.fail(f"did not end within {seconds} s:\n{self.log()}")

    def end(self, seconds: float = 10) -> int:
        if self.child.poll() is None:
            self.child.send_signal(signal.SIGTERM)
        try:
            return self.child.wait(seconds)
        except subprocess.TimeoutExpired:
            self.child.kill()
            return self.child.wait()


class Seen(NamedTuple):
    """What passed on the D-Bus: a notified value (`notify`), a value written (`write`), or `Disconnect`."""

    kind: str
    characteristic: str
    value: bytes


class Spy(threading.Thread):
    """Listens to everything on the private D-Bus: the bytes as the driver's library gets them."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.seen: list[Seen] = []
        self._address, self._uuids, self._ready, self._leave = address, {}, threading.Event(), threading.Event()
        self.start()
        assert self._ready.wait(10)

    def run(self) -> None:
        asyncio.run(self._listen())

    async def _listen(self) -> None:
        bus = await MessageBus(bus_address=self._address, bus_type=BusType.SYSTEM).connect()
        self._learn(await call(bus, "org.bluez", "/", "org.freedesktop.DBus.ObjectManager", "GetManagedObjects"))
        bus.add_message_handler(self._take)
        await call(
            bus,
            "org.freedesktop.DBus",
            "/org/freedesktop/DBus",
            "org.freedesktop.DBus.Monitoring",
            "BecomeMonitor",
            "asu",
            [[], 0],
        )
        self._ready.set()
        while not self._leave.is_set():
            await asyncio.sleep(0.02)
        bus.disconnect()

    def _learn(self, objects: dict[str, Any]) -> None:
        for path, interfaces in objects.items():
            if "org.bluez.GattCharacteristic1" in interfaces:
                self._uuids[path] = interfaces["org.bluez.GattCharacteristic1"]["UUID"].value

    def _take(self, message: Message) -> bool:
        if message.member == "InterfacesAdded":
            self._learn(dict([message.body]))
        uuid = self._uuids.get(message.path, "")
        if message.member == "PropertiesChanged" and uuid and "Value" in message.body[1]:
            self.seen.append(Seen("notify", uuid, bytes(message.body[1]["Value"].value)))
        if message.message_type is MessageType.METHOD_CALL and message.member == "WriteValue":
            self.seen.append(Seen("write", uuid, bytes(message.body[0])))
        if message.message_type is MessageType.METHOD_CALL and message.member == "Disconnect":
            self.seen.append(Seen("Disconnect", "", b""))
        return message.message_type is MessageType.METHOD_CALL  # handled: a monitor must not answer

    def notified(self, characteristic: str) -> list[bytes]:
        return [
            seen.value for seen in list(self.seen) if (seen.kind, seen.characteristic) == ("notify", characteristic)
        ]

    def frames(self, measurement: int, messages: list[PhysioRaw]) -> dict[int, bytes]:
        """Content of the PMD frames of one measurement type by device time, once those of all messages were seen."""
        found: dict[int, bytes] = {}

        def all_seen() -> bool:
            for frame in self.notified(PMD_DATA):
                if frame[0] == measurement:
                    found[struct.unpack("<Q", frame[1:9])[0]] = frame[10:]
            return all(to_ns(message.device_timestamp) in found for message in messages)

        poll(all_seen, 10, "every message's frame was seen on the bus")
        return found

    def commands(self) -> list[str]:
        """Commands and disconnections in the order they came."""
        return [seen.value.hex() or seen.kind for seen in list(self.seen) if seen.kind != "notify"]

    def close(self) -> None:
        self._leave.set()
        self.join(5)


async def call(
    bus: MessageBus, service: str, path: str, interface: str, member: str, signature: str = "", body: Any = ()
) -> Any:
    """Return the first value of a D-Bus method's reply."""
    reply = await bus.call(Message(service, path, interface, member, signature=signature, body=list(body)))
    assert reply is not None
    assert reply.message_type is MessageType.METHOD_RETURN, reply.body
    return reply.body[0] if reply.body else None


class Bench:
    """sensor-bench without its ROS side, and its knobs."""

    def __init__(self, folder: Path) -> None:
        self.socket = folder / "bus"
        self.address = f"unix:path={self.socket}"
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self.process = Process(
            folder / "bench.log",
            "sensor_bench",
            {"socket_path": str(self.socket), "ros4hri": False, "devices": DEVICES},
            {"METRICS_PORT": str(self._port), "ROS_DOMAIN_ID": "29", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
        )

    def ready(self) -> None:
        """Wait until the sensors advertise; on a busy machine the simulated waveforms take their time."""
        self.process.until("DBUS_SYSTEM_BUS_ADDRESS=", 90)

    def post(self, path: str, **values: object) -> None:
        request = urllib.request.Request(f"http://127.0.0.1:{self._port}{path}", json.dumps(values).encode())
        with urllib.request.urlopen(request, timeout=5) as answer:
            assert answer.status == 200

    def turn(self, sensor: str, **knobs: object) -> None:
        self.post(f"/devices/{sensor}/knobs", **knobs)

    def device(self, sensor: str) -> dict[str, Any]:
        with urllib.request.urlopen(f"http://127.0.0.1:{self._port}/devices", timeout=5) as answer:
            return next(each for each in json.load(answer) if each["sensor"] == sensor)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    running = Bench(tmp_path_factory.mktemp("bench"))
    try:
        running.ready()
        yield running
    finally:
        running.process.end()


@pytest.fixture
def spy(bench: Bench) -> Iterator[Spy]:
    listening = Spy(bench.address)
    yield listening
    listening.close()


@pytest.fixture
def drive(ros_domain: int, bench: Bench, tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """drive(parameters, ...) starts a driver; where it is not told otherwise, at the bench's D-Bus."""
    running: list[Process] = []

    def begin(parameters: dict[str, Any], bus: str | None = None, **more: Any) -> Process:
        env = {"DBUS_SYSTEM_BUS_ADDRESS": bus or bench.address}
        log = tmp_path / f"driver_{len(running)}.log"
        running.append(Process(log, "driver_polar", {**parameters, **more}, env))
        return running[-1]

    yield begin
    for process in running:
        process.end()


class Ears:
    """A node of the test's own, spun while it waits."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = rclpy.create_node("ears", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def hear(self, kind: type, stream: StreamName, field: str) -> list[Any]:
        profile = {"raw": qos.RAW, "device": qos.DEVICE, "health": qos.HEALTH}[field]
        got: list[Any] = []
        self.node.create_subscription(kind, stream.topic(field), got.append, profile)
        return got

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 30) -> Any:
        deadline = time.monotonic() + seconds
        while not (result := condition()):
            if time.monotonic() > deadline:
                pytest.fail(f"not within {seconds} s: {what}")
            self._executor.spin_once(timeout_sec=0.05)
        return result

    def ask(self, kind: type, name: str, request: Any) -> Any:
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f"{name} is served")
        answer = client.call_async(request)
        return self.until(lambda: answer.done() and answer.result(), f"{name} answers")

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def ears(ros_domain: int) -> Iterator[Ears]:
    node = Ears()
    yield node
    node.close()


def name(parameters: dict[str, Any], sensor_type: str, human_id: str | None = None) -> StreamName:
    return StreamName(human_id or parameters["human_id"], sensor_type, parameters["sensor_id"])


def channel(messages: list[PhysioRaw], index: int = 0) -> list[float]:
    return [value for message in messages for value in message.channels[index].samples]


def signed(octets: bytes, size: int) -> list[int]:
    return [int.from_bytes(octets[at : at + size], "little", signed=True) for at in range(0, len(octets), size)]


def uncompressed(content: bytes, channels: int, size: int) -> list[list[int]]:
    """A second reading of compressed frames, one bit at a time, for the test alone."""
    rows, at = [signed(content[: channels * size], size)], channels * size
    while at < len(content):
        width, count = content[at], content[at + 1]
        length = (width * count * channels + 7) // 8
        bits = "".join(f"{octet:08b}"[::-1] for octet in content[at + 2 : at + 2 + length])
        for row in range(count):
            steps = []
            for index in range(channels):
                start = (row * channels + index) * width
                word = int(bits[start : start + width][::-1] or "0", 2)
                steps.append(word - (1 << width) if width and word >> (width - 1) else word)
            rows.append([old + step for old, step in zip(rows[-1], steps, strict=True)])
        at += 2 + length
    return rows


def test_a_strap_arrives_bit_exact_and_is_always_stopped(drive, ears, spy, bench) -> None:
    """ECG, motion, heart rate and health of an H10 at once; on SIGTERM the streams stop before the link does."""
    ecg = ears.hear(PhysioRaw, name(STRAP, "ecg"), "raw")
    motion = ears.hear(PhysioRaw, name(STRAP, "accelerometer"), "raw")
    device = ears.hear(PhysioDeviceFeature, name(STRAP, "ecg"), "device")
    health = ears.hear(StreamHealth, name(STRAP, "ecg"), "health")
    driver = drive(STRAP)
    ears.until(lambda: len(ecg) >= 6 and len(motion) >= 4 and len(device) >= 4, "all streams")
    ears.until(lambda: health[-1].state == StreamHealth.STREAMING and health[-1].contact == 1.0, "healthy")
    asked = GetParameters.Request(names=["serial_number", "vendor", "body_location", "ecg.sampling_frequency_hz"])
    values = ears.ask(GetParameters, "/driver_polar_h10_1/get_parameters", asked).values

    begun = time.monotonic()
    assert driver.end() == 0, driver.log()
    assert time.monotonic() - begun < 8
    poll(lambda: "Disconnect" in spy.commands(), 5, "the link is closed")
    assert spy.commands()[-3:] == ["0302", "0300", "Disconnect"]
    assert bench.device("h10_1")["streaming"] == []

    sent = spy.frames(0, ecg)
    for message in ecg:
        assert list(message.channels[0].samples) == signed(sent[to_ns(message.device_timestamp)], 3)
        assert abs(to_ns(message.header.stamp) - time.time_ns()) < 60e9
    moved = spy.frames(2, motion)
    for message in motion:
        milli_g = [round(value / (1e-3 * G)) for value in message.channels[2].samples]
        assert milli_g == signed(moved[to_ns(message.device_timestamp)], 2)[2::3]
    assert np.diff([to_ns(message.device_timestamp) for message in ecg]) == pytest.approx(73 / 130 * 1e9, rel=1e-3)

    said = {feature.name: list(feature.values) for message in device for feature in message.features}
    assert all(to_ns(message.device_timestamp) == 0 for message in device)
    assert {"heart_rate", "rr_interval", "contact"} <= set(said)
    raw_rates = {frame[1] for frame in spy.notified(HEART_RATE)}
    assert said["heart_rate"][0] in raw_rates
    assert health[-1].state in (StreamHealth.STREAMING, StreamHealth.STOPPING), driver.log()
    assert (health[-1].battery_percent, health[-1].rssi_dbm) == (88.0, -52.0)
    assert health[-1].gaps_total == health[-1].lost_samples_total == 0
    assert [value.string_value for value in values[:3]] == ["1A2B3C01", "Polar Electro Oy", "chest"]
    assert values[3].double_value == 130.0


def test_an_arm_band_arrives_bit_exact(drive, ears, spy) -> None:
    """Compressed PPG and motion of a Verity Sense, and its pulse intervals with device time, all at once."""
    optical = ears.hear(PhysioRaw, name(BAND, "ppg"), "raw")
    motion = ears.hear(PhysioRaw, name(BAND, "accelerometer"), "raw")
    device = ears.hear(PhysioDeviceFeature, name(BAND, "ppg"), "device")
    drive(BAND)
    ears.until(lambda: len(optical) >= 5 and len(motion) >= 3 and device, "all streams")
    optical, motion = optical[:5], motion[:3]
    light, moved = spy.frames(1, optical), spy.frames(2, motion)
    for message in optical:
        rows = uncompressed(light[to_ns(message.device_timestamp)], 4, 3)
        assert [list(row) for row in zip(*(each.samples for each in message.channels), strict=True)] == rows
        assert [each.channel_name for each in message.channels] == ["ppg_0", "ppg_1", "ppg_2", "ambient"]
    factor = struct.unpack("<f", struct.pack("<f", 2.44e-4))[0]
    for message in motion:
        rows = uncompressed(moved[to_ns(message.device_timestamp)], 3, 2)
        assert list(message.channels[0].samples) == pytest.approx([row[0] * factor * G for row in rows], rel=1e-12)
    features = {feature.name: list(feature.values) for feature in device[0].features}
    assert to_ns(device[0].device_timestamp) > 0
    assert {"pp_interval", "pp_error", "blocked", "contact"} <= set(features)
    assert all(300 < interval < 2000 for interval in features["pp_interval"])


def test_sdk_mode_and_an_old_model(drive, ears, bench) -> None:
    """A Verity Sense streams at a rate only SDK mode has; an OH1, which names another rate, streams too."""
    fast = ears.hear(PhysioRaw, name(BAND, "ppg"), "raw")
    old = ears.hear(PhysioRaw, name(OLD_BAND, "ppg"), "raw")
    driver = drive({**BAND, "ppg.sampling_frequency_hz": 176.0}, sdk_mode=True, streams=["ppg"])
    drive(OLD_BAND)
    ears.until(lambda: len(fast) >= 4 and len(old) >= 4, "both stream")
    assert bench.device("verity_1")["sdk_mode"]
    elapsed_s = (to_ns(fast[-1].device_timestamp) - to_ns(fast[0].device_timestamp)) * 1e-9
    assert len(channel(fast[1:])) / elapsed_s == pytest.approx(176, rel=0.02)
    assert driver.end() == 0
    assert not bench.device("verity_1")["sdk_mode"]


def test_a_link_that_drops_comes_back_and_disturbs_nobody(drive, ears, bench) -> None:
    """After a drop, a stream the firmware ends and a clock reset the strap streams again; the arm band never stops."""
    ecg = ears.hear(PhysioRaw, name(STRAP, "ecg"), "raw")
    health = ears.hear(StreamHealth, name(STRAP, "ecg"), "health")
    other = ears.hear(StreamHealth, name(BAND, "ppg"), "health")
    strap = drive(STRAP, streams=["ecg"])
    drive(BAND, streams=["ppg"])
    streaming = StreamHealth.STREAMING
    ears.until(lambda: ecg and all(each and each[-1].state == streaming for each in (health, other)), "both stream")

    bench.turn("h10_1", drop=True)
    ears.until(lambda: health[-1].reconnects_total == 1 and health[-1].state == StreamHealth.STREAMING, "back again")
    bench.turn("h10_1", stop_stream="ecg")
    ears.until(lambda: health[-1].reconnects_total == 2 and health[-1].state == StreamHealth.STREAMING, "and again")
    assert "stopped measuring by itself: ecg" in strap.log()
    assert strap.log().count("the link broke") == 1

    last = len(ecg)
    bench.turn("h10_1", clock_reset=True)
    ears.until(lambda: len(ecg) >= last + 3, "frames after the reset")
    steps_ns = np.diff([to_ns(message.device_timestamp) for message in ecg])
    assert (steps_ns < 0).sum() == 1  # passed on as it is

    before = health[-1]
    bench.turn("h10_1", garbled_frames=2)
    ears.until(lambda: health[-1].extra[0].values[0] == 2.0, "two undecodable frames are counted")
    assert health[-1].extra[0].name == "undecodable_frames_total"
    ears.until(lambda: health[-1].gaps_total == before.gaps_total + 1, "the hole they leave is seen")
    assert health[-1].lost_samples_total == before.lost_samples_total + 2 * 73
    assert (other[-1].reconnects_total, other[-1].gaps_total) == (0, 0)
    since = next(index for index, each in enumerate(other) if each.state == streaming)
    assert {each.state for each in other[since:]} == {streaming}


def test_who_wears_it_is_set_at_run_time(drive, ears) -> None:
    """Setting human_id moves every topic of the running driver without a gap in its clock."""
    before = ears.hear(PhysioRaw, name(STRAP, "ecg"), "raw")
    after = ears.hear(PhysioRaw, name(STRAP, "ecg", "p7"), "raw")
    device = ears.hear(PhysioDeviceFeature, name(STRAP, "ecg", "p7"), "device")
    health = ears.hear(StreamHealth, name(STRAP, "ecg", "p7"), "health")
    drive(STRAP)
    ears.until(lambda: len(before) >= 2, "streaming under the first name")
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="p7")
    request = SetParameters.Request(parameters=[Parameter(name="human_id", value=value)])
    assert ears.ask(SetParameters, "/driver_polar_h10_1/set_parameters", request).results[0].successful
    ears.until(lambda: len(after) >= 2 and device and health, "streaming under the second name")
    step_ns = to_ns(after[-1].device_timestamp) - to_ns(before[-1].device_timestamp)
    assert step_ns / (73 / 130 * 1e9) == pytest.approx(round(step_ns / (73 / 130 * 1e9)), abs=0.02)
    assert health[-1].gaps_total == 0


def test_two_drivers_want_one_sensor(drive, ears, bench) -> None:
    """Started together, one streams and the other says that the sensor is in use, until the first is killed."""
    configs = [STRAP, {**STRAP, "sensor_id": "h10_again"}]
    heard = [ears.hear(StreamHealth, name(config, "ecg"), "health") for config in configs]
    drivers = [drive(config) for config in configs]
    streaming = StreamHealth.STREAMING

    def order() -> list[int]:
        """The one that streams first; empty until the other says why it does not."""
        says = ["in use by another" in "".join(each[-1].reasons) if each else False for each in heard]
        streams = [bool(each) and each[-1].state == streaming for each in heard]
        return [streams.index(True), says.index(True)] if any(streams) and any(says) else []

    winner, loser = ears.until(order, "one streams, the other says why not")
    since = len(heard[winner])
    ears.until(lambda: len(heard[loser]) >= 10, "the other tries again and again")
    assert {health.state for health in heard[winner][since:]} == {streaming}
    assert (heard[winner][-1].reconnects_total, heard[winner][-1].gaps_total) == (0, 0)
    assert heard[loser][-1].samples_total == 0
    drivers[winner].child.kill()  # as hard as can be
    ears.until(lambda: heard[loser][-1].state == streaming, "the other streams", 40)


def test_bluetooth_that_is_not_there_is_waited_for(drive, ears, bench, tmp_path) -> None:
    """No D-Bus, an adapter pulled out or off, and a sensor out of range are reasons in health, not the end."""
    health = ears.hear(StreamHealth, name(STRAP, "ecg"), "health")
    nowhere = {**BAND, "sensor_id": "nowhere"}
    cut_off = ears.hear(StreamHealth, name(nowhere, "ppg"), "health")

    def waits_because(heard: list[StreamHealth], text: str) -> None:
        ears.until(lambda: heard and text in "".join(heard[-1].reasons), text)
        assert heard[-1].state in (StreamHealth.CONNECTING, StreamHealth.LOST)

    drive(nowhere, bus=f"unix:path={tmp_path}/absent")
    bench.turn("h10_1", down=True)
    try:
        driver = drive(STRAP, scan_timeout_s=1.0)
        waits_because(cut_off, "no D-Bus to reach Bluetooth through")
        waits_because(health, "1A2B3C01 does not advertise within 1 s")
        assert "Polar sensors heard: Polar OH1 1A2B3C03, Polar Sense 1A2B3C02" in health[-1].reasons[0]
        bench.post("/adapter", powered=False)
        waits_because(health, "No powered Bluetooth adapters found")
        bench.post("/adapter", present=False)
        waits_because(health, "No Bluetooth adapters found")
    finally:
        bench.post("/adapter", present=True, powered=True)
        bench.turn("h10_1", down=False)
    ears.until(lambda: health[-1].state == StreamHealth.STREAMING, "streaming at last", 40)
    assert driver.log().count("trying again") == 1  # logged once, however long it takes


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"model": "H10", "name": "1A2B3C01"}, "parameter 'sensor_id' is required"),
        ({"sensor_id": "h10_1"}, "address or name"),
        ({**STRAP, "model": "H9"}, "model 'H9'"),
        ({**STRAP, "streams": "ecg"}, "parameter 'streams' is 'ecg', must be a list"),
        ({**STRAP, "sdk_mode": 1}, "parameter 'sdk_mode' is 1, must be true or false"),
        ({**STRAP, "human_id": "p 1"}, "human_id 'p 1'"),
        ({**STRAP, "ecg.unit": "mV"}, "parameter 'ecg.unit' is 'mV', the driver sends uV"),
        (
            {**STRAP, "accelerometer.sampling_frequency_hz": 60.0},
            "parameter 'accelerometer.sampling_frequency_hz' is 60; Polar H10 1A2B3C01 offers 25, 50, 100, 200 Hz",
        ),
        ({**STRAP, "model": "VeritySense"}, "streams ppg, pp_interval: Polar H10 1A2B3C01 is no VeritySense"),
    ],
)
def test_a_wrong_configuration_ends_the_driver(drive, bench, parameters, message) -> None:
    """Exit status 78 and one line that names the parameter, also where only the sensor can tell."""
    driver = drive(parameters)
    assert driver.wait(25) == 78, driver.log()
    (line,) = [line for line in driver.log().splitlines() if "configuration:" in line]
    assert message in line
    assert "Traceback" not in driver.log()
    poll(lambda: not bench.device("h10_1")["connected"], 5, "the sensor is released")


def test_a_wrong_adapter_is_waited_for(drive) -> None:
    """An adapter that does not exist is no configuration error."""
    driver = drive(STRAP, adapter="hci7")
    driver.until("adapter 'hci7' not found; trying again")
    assert driver.end() == 0
