"""driver-polar as a real process, through unmodified bleak and a real D-Bus, against sensor-bench."""

import asyncio
import os
import signal
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from checks import bluetooth
from dbus_fast import BusType, Message, MessageType
from dbus_fast.aio import MessageBus
from processes import DEADLINE_S, Process, poll
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, StreamHealth
from sensor_bench_process import BenchProcess

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
        assert self._ready.wait(DEADLINE_S)

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
        wanted = ("notify", characteristic)
        return [seen.value for seen in list(self.seen) if (seen.kind, seen.characteristic) == wanted]

    def frames(self, measurement: int, messages: list[PhysioRaw]) -> dict[int, bytes]:
        """Content of the PMD frames of one measurement type by device time, once those of all messages were seen."""
        found: dict[int, bytes] = {}

        def all_seen() -> bool:
            for frame in self.notified(PMD_DATA):
                if frame[0] == measurement:
                    found[struct.unpack("<Q", frame[1:9])[0]] = frame[10:]
            return all(to_ns(message.device_timestamp) in found for message in messages)

        poll(all_seen, "every message's frame was seen on the bus")
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


@pytest.fixture
def spy(bench: BenchProcess) -> Iterator[Spy]:
    listening = Spy(bench.address)
    yield listening
    listening.close()


@pytest.fixture
def drive(bench: BenchProcess, start: Callable[..., Process]) -> Callable[..., Process]:
    """drive(parameters, ...) starts a driver; where it is not told otherwise, at the bench's D-Bus."""

    def begin(parameters: dict[str, Any], bus: str | None = None, **more: Any) -> Process:
        return start("driver_polar", env={"DBUS_SYSTEM_BUS_ADDRESS": bus or bench.address}, **parameters, **more)

    return begin


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
    ecg = ears.hear(PhysioRaw, name(STRAP, "ecg").topic("raw"), qos.RAW)
    motion = ears.hear(PhysioRaw, name(STRAP, "accelerometer").topic("raw"), qos.RAW)
    device = ears.hear(PhysioDeviceFeature, name(STRAP, "ecg").topic("device"), qos.DEVICE)
    health = ears.hear(StreamHealth, name(STRAP, "ecg").topic("health"), qos.HEALTH)
    begun_ns = time.time_ns()
    driver = drive(STRAP)
    ears.until(lambda: len(ecg) >= 6 and len(motion) >= 4 and len(device) >= 4, "all streams")
    streaming = StreamHealth.STREAMING
    ears.until(lambda: health and health[-1].state == streaming and health[-1].contact == 1.0, "healthy")
    asked = GetParameters.Request(names=["serial_number", "vendor", "body_location", "ecg.sampling_frequency_hz"])
    values = ears.ask(GetParameters, "/driver_polar_h10_1/get_parameters", asked).values

    assert driver.stop_within() == 0, driver.log()
    poll(lambda: "Disconnect" in spy.commands(), "the link is closed")
    assert spy.commands()[-3:] == ["0302", "0300", "Disconnect"]
    assert bench.device("h10_1")["streaming"] == []

    sent = spy.frames(0, ecg)
    for message in ecg:
        assert list(message.channels[0].samples) == signed(sent[to_ns(message.device_timestamp)], 3)
        assert begun_ns < to_ns(message.header.stamp) < time.time_ns()
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
    optical = ears.hear(PhysioRaw, name(BAND, "ppg").topic("raw"), qos.RAW)
    motion = ears.hear(PhysioRaw, name(BAND, "accelerometer").topic("raw"), qos.RAW)
    device = ears.hear(PhysioDeviceFeature, name(BAND, "ppg").topic("device"), qos.DEVICE)
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
    fast = ears.hear(PhysioRaw, name(BAND, "ppg").topic("raw"), qos.RAW)
    old = ears.hear(PhysioRaw, name(OLD_BAND, "ppg").topic("raw"), qos.RAW)
    driver = drive({**BAND, "ppg.sampling_frequency_hz": 176.0}, sdk_mode=True, streams=["ppg"])
    drive(OLD_BAND)
    ears.until(lambda: len(fast) >= 4 and len(old) >= 4, "both stream")
    assert bench.device("verity_1")["sdk_mode"]
    elapsed_s = (to_ns(fast[-1].device_timestamp) - to_ns(fast[0].device_timestamp)) * 1e-9
    assert len(channel(fast[1:])) / elapsed_s == pytest.approx(176, rel=0.02)
    assert driver.stop() == 0
    assert not bench.device("verity_1")["sdk_mode"]


def test_a_link_that_drops_comes_back_and_disturbs_nobody(drive, ears, bench) -> None:
    """After a drop, a stream the firmware ends and a clock reset the strap streams again; the arm band never stops."""
    ecg = ears.hear(PhysioRaw, name(STRAP, "ecg").topic("raw"), qos.RAW)
    health = ears.hear(StreamHealth, name(STRAP, "ecg").topic("health"), qos.HEALTH)
    other = ears.hear(StreamHealth, name(BAND, "ppg").topic("health"), qos.HEALTH)
    strap = drive(STRAP, streams=["ecg"])
    drive(BAND, streams=["ppg"])
    streaming = StreamHealth.STREAMING
    ears.until(lambda: ecg and all(each and each[-1].state == streaming for each in (health, other)), "both stream")

    bench.knobs("h10_1", drop=True)
    ears.until(lambda: health[-1].reconnects_total == 1 and health[-1].state == StreamHealth.STREAMING, "back again")
    bench.knobs("h10_1", stop_stream="ecg")
    ears.until(lambda: health[-1].reconnects_total == 2 and health[-1].state == StreamHealth.STREAMING, "and again")
    assert "stopped measuring by itself: ecg" in strap.log()
    assert strap.log().count("the link broke") == 1

    def resets() -> int:
        return int((np.diff([to_ns(message.device_timestamp) for message in ecg]) < 0).sum())

    bench.knobs("h10_1", clock_reset=True)
    ears.until(resets, "frames after the reset")
    last, told = len(ecg), len(health)
    ears.until(lambda: len(ecg) >= last + 2 and len(health) >= told + 2, "more of them, and health that knows of it")
    assert resets() == 1  # passed on as it is

    before = health[-1]
    bench.knobs("h10_1", garbled_frames=2)
    ears.until(lambda: health[-1].extra[0].values[0] == 2.0, "two undecodable frames are counted")
    assert health[-1].extra[0].name == "undecodable_frames_total"
    ears.until(lambda: health[-1].gaps_total == before.gaps_total + 1, "the hole they leave is seen")
    assert health[-1].lost_samples_total == before.lost_samples_total + 2 * 73
    assert (other[-1].reconnects_total, other[-1].gaps_total) == (0, 0)


def test_a_bus_that_is_killed_heals_without_a_hand(drive, ears, bench) -> None:
    """The bench starts its D-Bus daemon again, the driver says why it waits, and the strap streams again."""
    health = ears.hear(StreamHealth, name(STRAP, "ecg").topic("health"), qos.HEALTH)
    strap = drive(STRAP, streams=["ecg"])
    ears.until(lambda: health and health[-1].state == StreamHealth.STREAMING, "streams")
    os.kill(bench.bus_pid(), signal.SIGKILL)
    ears.until(lambda: health[-1].state != StreamHealth.STREAMING and health[-1].reasons, "it says why it waits")
    ears.until(lambda: health[-1].state == StreamHealth.STREAMING and health[-1].reconnects_total == 1, "back again")
    assert "the private bus ended with status -9; it is started again" in bench.log()
    assert "Traceback" not in bench.log() + strap.log()


def test_who_wears_it_is_set_at_run_time(drive, ears) -> None:
    """Setting human_id moves every topic of the running driver without a gap in its clock."""
    before = ears.hear(PhysioRaw, name(STRAP, "ecg").topic("raw"), qos.RAW)
    after = ears.hear(PhysioRaw, name(STRAP, "ecg", "p7").topic("raw"), qos.RAW)
    device = ears.hear(PhysioDeviceFeature, name(STRAP, "ecg", "p7").topic("device"), qos.DEVICE)
    health = ears.hear(StreamHealth, name(STRAP, "ecg", "p7").topic("health"), qos.HEALTH)
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
    heard = [ears.hear(StreamHealth, name(config, "ecg").topic("health"), qos.HEALTH) for config in configs]
    drivers = [drive(config) for config in configs]
    streaming = StreamHealth.STREAMING

    def order() -> list[int]:
        """The one that streams first; empty until the other says why it does not."""
        says = ["in use by another" in "".join(each[-1].reasons) if each else False for each in heard]
        streams = [bool(each) and each[-1].state == streaming for each in heard]
        return [streams.index(True), says.index(True)] if any(streams) and any(says) else []

    winner, loser = ears.until(order, "one streams, the other says why not")
    ears.until(lambda: len(heard[loser]) >= 10, "the other tries again and again")
    assert (heard[winner][-1].reconnects_total, heard[winner][-1].gaps_total) == (0, 0)
    assert heard[loser][-1].samples_total == 0
    drivers[winner].kill()
    ears.until(lambda: heard[loser][-1].state == streaming, "the other streams", 60)


def test_bluetooth_that_is_not_there_is_waited_for(drive, ears, bench, tmp_path) -> None:
    """No D-Bus, an adapter pulled out or off, and a sensor out of range are reasons in health, not the end."""
    health = ears.hear(StreamHealth, name(STRAP, "ecg").topic("health"), qos.HEALTH)
    nowhere = {**BAND, "sensor_id": "nowhere"}
    cut_off = ears.hear(StreamHealth, name(nowhere, "ppg").topic("health"), qos.HEALTH)

    def waits_because(heard: list[StreamHealth], text: str) -> None:
        ears.until(lambda: heard and text in "".join(heard[-1].reasons), text)
        assert heard[-1].state in (StreamHealth.CONNECTING, StreamHealth.LOST)

    drive(nowhere, bus=f"unix:path={tmp_path}/absent")
    bench.knobs("h10_1", down=True)
    try:
        driver = drive(STRAP, scan_timeout_s=1.0)
        waits_because(cut_off, "no D-Bus to reach Bluetooth through")
        waits_because(health, "1A2B3C01 does not advertise within 1 s")
        waits_because(health, "sensors of this kind heard: Polar OH1 1A2B3C03, Polar Sense 1A2B3C02")
        bench.post("/adapter", powered=False)
        waits_because(health, "No powered Bluetooth adapters found")
        bench.post("/adapter", present=False)
        waits_because(health, "No Bluetooth adapters found")
    finally:
        bench.post("/adapter", present=True, powered=True)
        bench.knobs("h10_1", down=False)
    ears.until(lambda: health[-1].state == StreamHealth.STREAMING, "streaming at last", 60)
    assert driver.log().count("trying again") == 1  # logged once, however long it takes


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"model": "H10", "name": "1A2B3C01"}, "parameter 'sensor_id' is required"),
        ({"sensor_id": "h10_1"}, "address or name"),
        ({**STRAP, "model": "H9"}, "parameter 'model' is 'H9', must be one of H10, VeritySense, OH1"),
        ({**STRAP, "streams": "ecg"}, "parameter 'streams' is 'ecg', must be a list"),
        ({**STRAP, "sdk_mode": 1}, "parameter 'sdk_mode' is 1, must be true or false"),
        ({**STRAP, "human_id": "p 1"}, "parameter 'human_id' is 'p 1'"),
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
    assert driver.wait(60) == 78, driver.log()
    (line,) = [line for line in driver.log().splitlines() if "configuration:" in line]
    assert message in line
    assert "Traceback" not in driver.log()
    poll(lambda: not bench.device("h10_1")["connected"], "the sensor is released")


def test_a_wrong_adapter_is_waited_for(drive) -> None:
    """An adapter that does not exist is no configuration error."""
    driver = drive(STRAP, adapter="hci7")
    driver.until("adapter 'hci7' not found; trying again")
    assert driver.stop() == 0


def test_the_adapter_of_a_bus_is_found_before_a_study_starts(bench):
    """`make check` sees BlueZ's adapter, and says so where it is switched off or gone."""
    assert bluetooth.adapters(bench.address) == (["hci0"], "")
    for knob, said in (("powered", "switched off on hci0"), ("present", "no Bluetooth adapter")):
        bench.post("/adapter", **{knob: False})  # answered before it is done
        poll(lambda said=said: said in bluetooth.adapters(bench.address)[1], said)
