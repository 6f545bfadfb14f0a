"""The device's state machine against a virtual sensor without Bluetooth."""

import asyncio
import struct
import time
from collections.abc import Awaitable, Callable

import numpy as np
import pytest
from driver_polar import device
from driver_polar import session as polar_session
from driver_polar.config import PolarConfig, streams_of
from driver_polar.device import Polar
from driver_polar.session import PMD_CONTROL
from processes import DEADLINE_S
from sense4hri import gatt
from sense4hri.device import Feature, Identity, Item, Reported, Samples, Status
from sense4hri.errors import ConfigError, DeviceLost, FrameError

STAMP = 599_622_173_760_485_265


def config_of(**values) -> PolarConfig:
    return PolarConfig(**{"sensor_id": "polar_1", "name": "B5E3A222"} | values)


def polar(sensor, **values) -> Polar:
    config = config_of(**values)
    return Polar(config, streams_of(config), sensor)


def frame(kind: int, content: bytes, frame_type: int = 0, stamp: int = STAMP) -> bytes:
    return struct.pack("<BQB", kind, stamp, frame_type) + content


def ecg(*microvolts: int, stamp: int = STAMP) -> bytes:
    return frame(0, b"".join((value & 0xFFFFFF).to_bytes(3, "little") for value in microvolts), stamp=stamp)


class Session:
    """The stream of a device, read in the background."""

    def __init__(self, polar: Polar) -> None:
        self.items: list[Item] = []
        self._generator = polar.stream()
        self.task = asyncio.ensure_future(self._read())

    async def _read(self) -> None:
        try:
            async for item in self._generator:
                self.items.append(item)
        finally:
            await self._generator.aclose()

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait for the condition, or raise what ended the stream."""
        deadline = time.monotonic() + DEADLINE_S
        while not condition():
            if self.task.done():
                self.task.result()
            assert time.monotonic() < deadline, f"waited in vain; items: {self.items}"
            await asyncio.sleep(0.001)

    async def stop(self) -> None:
        self.task.cancel()
        await asyncio.wait([self.task])

    def of(self, kind: type) -> list:
        return [item for item in self.items if isinstance(item, kind)]


def scenario(steps: Callable[[], Awaitable[None]]) -> None:
    """Run one asynchronous story to its end."""
    asyncio.run(asyncio.wait_for(steps(), 2 * DEADLINE_S))


def sends_until_stopped(sensor) -> Callable[[bytes], list[bytes]]:
    """The answers of a sensor that sends one more sample of acceleration just as that is stopped."""
    answers = sensor.answers

    def answered(command: bytes) -> list[bytes]:
        if command.hex() == "0302" and 2 in sensor.running:
            sensor.link.data(frame(2, struct.pack("<3h", 1, 0, 0), 0x80))
        return answers(command)

    return answered


def started(sensor, *kinds: int) -> Callable[[], bool]:
    return lambda: sensor.running >= set(kinds) and len(sensor.link.receivers) >= 2


def test_everything_an_h10_sends_at_once(h10) -> None:
    """ECG, acceleration, heart rate, battery, contact, identity and RSSI come at once; in the end all is stopped."""

    async def steps() -> None:
        session = Session(polar(h10))
        await session.until(started(h10, 0, 2))
        before_ns = time.time_ns()
        h10.link.data(ecg(-5, 7), frame(2, struct.pack("<3h", 0, -1000, 1000), frame_type=1))
        h10.link.receivers[gatt.HEART_RATE](bytes.fromhex("16484003"))
        h10.link.receivers[gatt.BATTERY](bytes([72]))
        await session.until(lambda: Status(battery_percent=72.0) in session.items)
        await session.stop()
        voltage, motion = session.of(Samples)
        assert (voltage.sensor_type, voltage.chunk.channels, voltage.chunk.device_ns) == ("ecg", ("ecg",), STAMP)
        assert voltage.chunk.samples.tolist() == [[-5.0], [7.0]]
        assert before_ns <= voltage.chunk.received_ns <= motion.chunk.received_ns <= time.time_ns()
        assert motion.chunk.samples == pytest.approx(np.array([[0, -9.80665, 9.80665]]))
        (report,) = session.of(Reported)
        assert (report.sensor_type, report.device_ns) == ("ecg", None)
        assert report.features == (
            Feature("heart_rate", "1/min", (72.0,)),
            Feature("rr_interval", "ms", (812.5,)),
            Feature("contact", "1", (1.0,)),
        )
        assert session.of(Status) == [
            Status(rssi_dbm=-61.0),
            Status(battery_percent=73.0),
            Status(contact=1.0),
            Status(battery_percent=72.0),
        ]
        assert session.of(Identity) == [Identity("Polar Electro Oy", None, "B5E3A222", None, "chest")]

    scenario(steps)
    assert h10.log == [
        "0100",
        "02000001820001010e00",
        "0102",
        "020200013200010110000201" + "0800",
        "0302",
        "0300",
        "disconnected",
    ]


def test_a_verity_sense_with_pulse_intervals(verity) -> None:
    """PPG, acceleration by the factor the device names, and PPI under `ppg` with the device's time."""

    async def steps() -> None:
        session = Session(polar(verity, model="VeritySense", body_location="left arm"))
        await session.until(started(verity, 1, 2, 3))
        content = bytes.fromhex("010000 020000 030000 ffffff") + bytes([0, 2])
        verity.link.data(frame(1, content, 0x80), frame(2, struct.pack("<3h", 4098, 0, 0), 0x80))
        verity.link.data(frame(3, bytes([60, 0xE8, 3, 10, 0, 0b110, 0, 0xD0, 7, 20, 0, 0b001])))
        await session.until(lambda: session.of(Reported))
        await session.stop()
        optical, motion = session.of(Samples)
        assert optical.chunk.channels == ("ppg_0", "ppg_1", "ppg_2", "ambient")
        assert optical.chunk.samples.tolist() == [[1, 2, 3, -1]] * 3
        assert motion.chunk.samples[0, 0] == 4098 * (0.00024399999529123306 * 9.80665)
        (report,) = session.of(Reported)
        values = {feature.name: feature.values for feature in report.features}
        assert (report.sensor_type, report.device_ns) == ("ppg", STAMP)
        assert values.pop("contact") == pytest.approx((1.0, float("nan")), nan_ok=True)
        assert values == {
            "heart_rate": (60.0,),
            "pp_interval": (1000.0, 2000.0),
            "pp_error": (10.0, 20.0),
            "blocked": (0.0, 1.0),
        }
        assert session.of(Identity)[0].body_location is None

    scenario(steps)
    assert verity.log[0] == "0309"  # SDK mode off, should someone have left it on
    assert verity.log[-4:] == ["0303", "0302", "0301", "disconnected"]


def test_sdk_mode_is_entered_first_and_left_last(verity) -> None:
    """In SDK mode the settings are those of the mode, and any rate of it can be asked for."""
    config = config_of(model="VeritySense", sdk_mode=True, streams=("ppg",))
    streams = streams_of(config)
    streams["ppg"] = streams["ppg"].__class__(176.0, "counts", -1, 1, 22, ("a", "b", "c", "d"))

    async def steps() -> None:
        session = Session(Polar(config, streams, verity))
        await session.until(started(verity, 1, 9))
        verity.link.data(frame(1, bytes(12), 0x80))
        await session.until(lambda: session.of(Samples))
        assert session.of(Samples)[0].chunk.channels == ("a", "b", "c", "d")
        await session.stop()

    scenario(steps)
    assert verity.log == ["0209", "0401", "02010001b000010116000401" + "04", "0301", "0309", "disconnected"]


@pytest.mark.parametrize("sdk_mode", [True, False])
def test_sdk_mode_is_changed_though_a_killed_driver_has_left_something_running(verity, sdk_mode) -> None:
    """That keeps the mode as it is: it is stopped first, and what it sent is not scaled by a factor of ours."""
    verity.running = {2} if sdk_mode else {2, 9}
    verity.answers = sends_until_stopped(verity)

    async def steps() -> None:
        session = Session(polar(verity, model="VeritySense", sdk_mode=sdk_mode, streams=("accelerometer",)))
        await session.until(lambda: session.of(FrameError))
        assert verity.running == ({2, 9} if sdk_mode else {2})
        assert [str(each) for each in session.of(FrameError)] == ["ACCELERATION frame from before it was started"]
        await session.stop()

    scenario(steps)


def test_a_device_without_sdk_mode_says_so(verity) -> None:
    """A refused SDK mode is a configuration error that names the parameter."""
    verity.refuse["0209"] = [3]
    assert "sdk_mode: Polar Sense 9E123456 has none" in refused(verity, model="VeritySense", sdk_mode=True)


def refused(sensor, **values) -> str:
    """The text of the ConfigError that ends the stream."""

    async def steps() -> None:
        session = Session(polar(sensor, **values))
        await session.until(lambda: False)

    with pytest.raises(ConfigError) as caught:
        scenario(steps)
    assert sensor.log[-1] == "disconnected"
    assert not sensor.running
    return str(caught.value)


def lost(sensor, **values) -> str:
    """The text of the DeviceLost that ends the stream before anything was streamed."""

    async def steps() -> None:
        session = Session(polar(sensor, **values))
        await session.until(lambda: False)

    with pytest.raises(DeviceLost) as caught:
        scenario(steps)
    assert sensor.log[-1] == "disconnected"
    return str(caught.value)


def test_a_rate_that_is_not_offered_lists_the_offers(h10) -> None:
    """The message names the parameter, the value and what the device offers."""
    config = config_of()
    streams = streams_of(config)
    streams["accelerometer"] = streams["accelerometer"].__class__(60.0, "m/s^2", -78, 78, 16, ("x", "y", "z"))

    async def steps() -> None:
        await Session(Polar(config, streams, h10)).until(lambda: False)

    with pytest.raises(ConfigError) as caught:
        scenario(steps)
    assert str(caught.value) == (
        "parameter 'accelerometer.sampling_frequency_hz' is 60; Polar H10 B5E3A222 offers 25, 50, 100, 200 Hz"
    )
    assert h10.log[-2:] == ["0300", "disconnected"]  # what was running already is stopped


def test_a_range_that_is_not_offered_lists_the_offers(h10) -> None:
    """The same holds for the range."""
    text = refused(h10, accelerometer_range_g=16)
    assert text == "parameter 'accelerometer_range_g' is 16; Polar H10 B5E3A222 offers 2, 4, 8"


def test_the_wrong_model_for_the_streams(h10, verity) -> None:
    """A device that does not measure what is configured is a configuration error that says what it measures."""
    text = refused(h10, model="VeritySense")
    assert "streams ppg, pp_interval: Polar H10 B5E3A222" in text
    assert "it measures ecg, accelerometer" in text
    assert "streams ecg: Polar Sense" in refused(verity)


def test_a_device_without_the_service(h10) -> None:
    """No measurement service, or no heart rate service, is a configuration error."""
    h10.missing.add(gatt.HEART_RATE)
    assert "no heart rate service" in refused(h10)
    del h10.values[PMD_CONTROL]
    assert "no Polar measurement service" in refused(h10)


def test_settings_in_several_packets(h10) -> None:
    """A paged answer is put together before it is read."""
    h10.page_bytes = 3

    async def steps() -> None:
        session = Session(polar(h10))
        await session.until(started(h10, 0, 2))
        await session.stop()

    scenario(steps)
    assert "02000001820001010e00" in h10.log


def test_a_stream_left_running_is_stopped_and_started_anew(h10) -> None:
    """What a broken connection left running starts again with the wanted settings."""
    h10.running.add(0)

    async def steps() -> None:
        session = Session(polar(h10, streams=("ecg",)))
        await session.until(lambda: len(h10.log) >= 4)
        await session.stop()

    scenario(steps)
    start = "02000001820001010e00"
    assert h10.log == ["0100", start, "0300", start, "0300", "disconnected"]


def test_what_a_stream_left_running_sent_before_it_is_started_anew_is_not_scaled(verity) -> None:
    """Its settings, and so its factor, are unknown: those frames are handed on as errors, the next as samples."""
    verity.running.add(2)
    verity.answers = sends_until_stopped(verity)

    async def steps() -> None:
        session = Session(polar(verity, model="VeritySense", streams=("accelerometer",)))
        await session.until(lambda: session.of(Samples) or session.of(FrameError))
        verity.link.data(frame(2, struct.pack("<3h", 4098, 0, 0), 0x80))
        await session.until(lambda: session.of(Samples))
        await session.stop()
        (motion,) = session.of(Samples)
        assert motion.chunk.samples[0, 0] == 4098 * (0.00024399999529123306 * 9.80665)
        assert [str(each) for each in session.of(FrameError)] == ["ACCELERATION frame from before it was started"]

    scenario(steps)


def test_a_link_that_breaks_ends_the_stream_after_what_had_come(h10) -> None:
    """Frames that came before the loss are still handed over; no command is sent into the void."""

    async def steps() -> None:
        session = Session(polar(h10, streams=("ecg",)))
        await session.until(started(h10, 0))
        h10.link.data(ecg(1))
        await session.until(lambda: session.of(Samples))  # the answer to the last command has been read
        h10.link.data(ecg(2, stamp=STAMP + 1), ecg(3, stamp=STAMP + 2))
        h10.link.drop()
        with pytest.raises(DeviceLost, match="the link broke"):
            await session.until(lambda: False)
        assert len(session.of(Samples)) == 3

    scenario(steps)
    assert h10.log[-2:] == ["02000001820001010e00", "disconnected"]


def test_a_link_that_breaks_while_starting(h10) -> None:
    """Waiting for an answer ends at once when the link does."""
    h10.silent.add("0100")

    async def steps() -> None:
        session = Session(polar(h10))
        await session.until(lambda: h10.log)
        h10.link.drop()
        with pytest.raises(DeviceLost, match="the link broke"):
            await session.until(lambda: False)  # not `no answer`, which it would be at the time limit

    scenario(steps)


def test_the_device_ends_a_stream_by_itself(h10) -> None:
    """The notice of a running stream is a loss; one of another measurement is not."""

    async def steps() -> None:
        session = Session(polar(h10))
        await session.until(started(h10, 0, 2))
        h10.link.receivers[PMD_CONTROL](bytes.fromhex("0105"))
        h10.link.data(ecg(1))
        await session.until(lambda: session.of(Samples))
        h10.link.receivers[PMD_CONTROL](bytes.fromhex("010002"))
        with pytest.raises(DeviceLost, match="stopped measuring by itself: ecg, accelerometer"):
            await session.until(lambda: False)

    scenario(steps)
    assert h10.log[-3:] == ["0302", "0300", "disconnected"]


def test_a_read_repeated_as_an_indication_is_no_answer(h10) -> None:
    """BlueZ repeats what was read, and late answers to other commands come: neither is taken for an answer."""
    real = h10.answers

    def with_noise(command: bytes) -> list[bytes]:
        return [h10.values[PMD_CONTROL], bytes.fromhex("f00306 0000"), b"", *real(command)]

    h10.answers = with_noise

    async def steps() -> None:
        session = Session(polar(h10))
        await session.until(started(h10, 0, 2))
        await session.stop()

    scenario(steps)
    assert h10.log[-3:] == ["0302", "0300", "disconnected"]


def test_undecodable_frames_are_handed_on_as_errors(h10) -> None:
    """Noise, a frame of a stream not started, a bad heart rate and a bad battery are errors; the stream goes on."""

    async def steps() -> None:
        session = Session(polar(h10, streams=("ecg", "heart_rate")))
        await session.until(started(h10, 0))
        h10.link.data(b"\x00\x01", frame(2, bytes(6), 1), frame(0, bytes(4)), frame(0, bytes(7), 3), ecg(9))
        h10.link.receivers[gatt.HEART_RATE](b"\x10")
        h10.link.receivers[gatt.BATTERY](b"")
        await session.until(lambda: len(session.of(FrameError)) == 6)
        await session.stop()
        assert [str(err).split(",")[0] for err in session.of(FrameError)] == [
            "PMD frame of 2 bytes (0001)",
            "ACCELERATION frame",
            "ECG frame type 0 holds 4 bytes",
            "ecg frame of 2 channels",
            "heart rate measurement of 1 bytes does not fit its flags (10)",
            "battery level '' is no percentage in one byte",
        ]
        assert len(session.of(Samples)) == 1

    scenario(steps)


def test_energy_and_intervals_without_a_rate(h10) -> None:
    """What a heart rate measurement holds beside the rate is reported without it."""

    async def steps() -> None:
        running = Session(polar(h10))
        await running.until(started(h10, 0, 2))
        h10.link.receivers[gatt.HEART_RATE](bytes.fromhex("1800 0a00 0004".replace(" ", "")))
        await running.until(lambda: running.of(Reported))
        await running.stop()
        assert running.of(Reported)[0].features == (
            Feature("rr_interval", "ms", (1000.0,)),
            Feature("energy_expended", "kJ", (10.0,)),
        )

    scenario(steps)


def test_no_heart_rate_is_not_zero(h10) -> None:
    """A rate of 0 means that the device knows none: it is left out, the contact is reported."""

    async def steps() -> None:
        session = Session(polar(h10))
        await session.until(started(h10, 0, 2))
        h10.link.receivers[gatt.HEART_RATE](bytes.fromhex("0400"))
        await session.until(lambda: session.of(Reported))
        await session.stop()
        assert session.of(Reported)[0].features == (Feature("contact", "1", (0.0,)),)
        assert Status(contact=0.0) in session.items

    scenario(steps)


def test_a_strap_that_only_reports_its_heart_rate(h10) -> None:
    """Nothing sampled is started, and the heart rate comes."""

    async def steps() -> None:
        session = Session(polar(h10, streams=("heart_rate",)))
        await session.until(lambda: h10.links and gatt.HEART_RATE in h10.link.receivers)
        h10.link.receivers[gatt.HEART_RATE](bytes.fromhex("0048"))
        await session.until(lambda: session.of(Reported))
        await session.stop()

    scenario(steps)
    assert h10.log == ["disconnected"]


def test_a_clock_that_jumps_back_is_passed_on(h10) -> None:
    """Neither a reset nor an unset clock is corrected; a stamp of zero is no stamp."""

    async def steps() -> None:
        session = Session(polar(h10, streams=("ecg",)))
        await session.until(started(h10, 0))
        h10.link.data(ecg(1), ecg(2, stamp=5), ecg(3, stamp=0))
        await session.until(lambda: len(session.of(Samples)) == 3)
        await session.stop()
        assert [item.chunk.device_ns for item in session.of(Samples)] == [STAMP, 5, None]

    scenario(steps)


def test_a_magnetometer_s_calibration_is_reported(verity) -> None:
    """The status word of a magnetometer frame is on `device`, beside the samples in uT."""

    async def steps() -> None:
        session = Session(polar(verity, model="VeritySense", streams=("magnetometer", "gyroscope")))
        await session.until(started(verity, 5, 6))
        verity.link.data(bytes.fromhex("0600943577000000008137ff51fd6cf600000301f802"))
        verity.link.data(frame(5, struct.pack("<3h", 160, 0, 0), 0x80))
        await session.until(lambda: len(session.of(Samples)) == 2)
        await session.stop()
        field, turn = session.of(Samples)
        assert field.chunk.samples[0] == pytest.approx([-20.1, -68.7, -245.2])
        assert turn.chunk.samples[0, 0] == pytest.approx(np.radians(10.0))
        assert session.of(Reported)[0].features == (Feature("calibration", "1", (0.0, 1.0)),)

    scenario(steps)


def test_too_small_an_mtu(h10) -> None:
    """The four-byte answer of an H10 whose link has too small an MTU is understood."""
    h10.mtu = 23
    h10.odd_answers["0200"] = bytes.fromhex("f000010a")
    assert "START ECG: the MTU of the link, 23 bytes, is too small; 232 are needed" in lost(h10)


@pytest.mark.parametrize(("status", "text"), [(13, "DEVICE_IN_CHARGER"), (12, "INVALID_STATE"), (77, "status 77")])
def test_a_refused_start_says_why(h10, status: int, text: str) -> None:
    """The device's own reason is in the message."""
    h10.refuse["0200"] = [status]
    assert lost(h10) == f"START ECG was refused: {text}"


def test_an_answer_that_makes_no_sense(h10) -> None:
    """Settings that cannot be read are a loss, not a crash."""
    h10.settings[0] = bytes.fromhex("00018200010e")
    assert "gave an answer that makes no sense: setting RESOLUTION with 14 values is cut" in lost(h10)


def test_no_answer(h10, monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that is never answered ends the connection; what may run is stopped all the same."""
    monkeypatch.setattr(polar_session, "RESPONSE_TIMEOUT_S", 0.05)
    h10.silent.add("0202")
    assert "no answer to START ACCELERATION" in lost(h10)
    assert h10.log[-3:] == ["0302", "0300", "disconnected"]


def test_a_device_that_does_not_answer_to_stop(h10, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopping gives up in time, so that the process can end."""
    monkeypatch.setattr(polar_session, "STOP_TIMEOUT_S", 0.05)
    h10.silent.add("0302")

    async def steps() -> None:
        running = Session(polar(h10))
        await running.until(started(h10, 0, 2))
        await running.stop()

    scenario(steps)
    assert h10.log[-2:] == ["0302", "disconnected"]


def test_a_stream_that_falls_silent(h10, monkeypatch: pytest.MonkeyPatch) -> None:
    """A connected strap that sends heart rates, but no ECG any more, is connected anew."""
    monkeypatch.setattr(device, "SILENCE_S", 0.2)

    async def steps() -> None:
        session = Session(polar(h10, streams=("ecg", "heart_rate")))
        await session.until(started(h10, 0))

        async def beat() -> None:
            while True:
                h10.link.receivers[gatt.HEART_RATE](bytes.fromhex("0048"))
                await asyncio.sleep(0.02)

        beats = asyncio.ensure_future(beat())
        with pytest.raises(DeviceLost, match="connected, but no ecg"):
            await session.until(lambda: False)
        beats.cancel()

    scenario(steps)
    assert h10.log[-2:] == ["0300", "disconnected"]


def test_a_strap_that_reports_a_heart_rate_alone_and_falls_silent(h10, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing is sampled it is the heart rate that must not be silent: the strap is connected anew."""
    monkeypatch.setattr(device, "SILENCE_S", 0.2)

    async def steps() -> None:
        session = Session(polar(h10, streams=("heart_rate",)))
        await session.until(lambda: h10.links and gatt.HEART_RATE in h10.link.receivers)
        for _ in range(15):
            h10.link.receivers[gatt.HEART_RATE](bytes.fromhex("0048"))
            await asyncio.sleep(0.02)
        assert not session.task.done()
        with pytest.raises(DeviceLost, match="connected, but no heart_rate"):
            await session.until(lambda: False)

    scenario(steps)


def test_commands_go_out_one_at_a_time(h10) -> None:
    """Two requests at once are answered in turn."""

    async def steps() -> None:
        point = polar_session.ControlPoint()
        async with h10.connect(lambda reason: None) as link:
            point.open(link)
            await link.subscribe(PMD_CONTROL, point.received)
            answers = await asyncio.gather(
                *(
                    point.request(polar_session.Op.GET_SETTINGS, kind)
                    for kind in (polar_session.Measurement(0), polar_session.Measurement(2))
                )
            )
        assert answers == [h10.settings[0], h10.settings[2]]

    scenario(steps)
