"""driver-shimmer against a virtual Shimmer3: what comes, when it was sampled, what is lost, and that it is stopped."""

import asyncio
from contextlib import aclosing

import numpy as np
import pytest
from driver_shimmer.config import MODELS, ShimmerConfig, streams_of
from driver_shimmer.device import Shimmer
from driver_shimmer.packets import Packet
from driver_shimmer.protocol import Layout
from driver_shimmer.session import Prepared
from plugged import plugged, wakes_per_message
from pure_link import PureLink
from sense4hri.device import Identity, Noted, Reported, Samples, Status
from sense4hri.errors import ConfigError
from sense4hri.serial_port import linked
from sense4hri.stamps import SECOND_NS
from sensor_bench.shimmer.body import gyroscope
from sensor_bench.shimmer.firmware import Memory

TICK_NS = SECOND_NS / 32768


class Lossy:
    """Loses one packet in a hundred, none of the first and last."""

    def __init__(self, last: int) -> None:
        self._random, self._last, self._sent = np.random.default_rng(3), last, 0
        self.lost_total = 0

    def carry(self, packet: bytes, **samples: int) -> bytes:
        self._sent += 1
        gone = 10 < self._sent < self._last and self._random.random() < 0.01
        self.lost_total += gone
        return b"" if gone else packet


@pytest.mark.parametrize("model", list(MODELS))
def test_every_model_streams_what_it_is_said_to(virtual, ran, model):
    """All declared streams come, at the declared rate, with the declared channels."""
    run = ran(PureLink(virtual()), 3, model=model)
    declared = streams_of(ShimmerConfig(sensor_id="it_1", port="/dev/x", model=model))
    for sensor_type, stream in declared.items():
        times_ns, values = run.samples(sensor_type)
        assert values.shape[1] == len(stream.channel_names)
        assert np.all((values >= stream.range_min) & (values <= stream.range_max))
        assert np.diff(times_ns) == pytest.approx(SECOND_NS / stream.sampling_frequency_hz, abs=TICK_NS)
        assert len(times_ns) > stream.sampling_frequency_hz


def test_samples_are_what_the_body_did_at_their_time(virtual, ran, body):
    """Conductance and acceleration at the device's time, within what a count is."""
    device = virtual(clock_start=2_000_000)
    run = ran(PureLink(device), 20, model="Shimmer3 GSR+")
    times_ns, conductance_us = run.samples("eda")
    true_s = np.array([device.true_s(round(each / TICK_NS)) for each in times_ns])
    assert conductance_us[:, 0] == pytest.approx(body.skin.at(true_s), abs=0.02)
    times_ns, acceleration = run.samples("accelerometer")
    true_s = np.array([device.true_s(round(each / TICK_NS)) for each in times_ns])
    assert acceleration == pytest.approx(body.acceleration(true_s), abs=0.02)


def test_constants_of_another_range_are_told_once(virtual, ran):
    """The gyroscope turns in 2000 dps, the device keeps the constants of 500: samples come, and the log says it."""
    device = virtual()
    answer = device.receive
    device.receive = lambda octets, time_s: answer(octets, time_s).replace(
        gyroscope(3).stored(100.0), gyroscope(1).stored(100.0)
    )
    run = ran(PureLink(device), 2, model="Shimmer3 IMU", gyroscope_range_dps=2000)
    (noted,) = run.of(Noted)
    assert "gyroscope: the device keeps a sensitivity of 65.5" in noted.text
    assert len(run.samples("gyroscope")[0]) > 40


def test_a_start_that_is_refused_is_tried_again(virtual, ran):
    """A Shimmer that was put into its dock after it was prepared: the reason is told, and the driver lives."""
    device = virtual()
    answer = device.receive
    device.receive = lambda octets, time_s: b"\xfe" if octets == b"\x07" else answer(octets, time_s)
    assert "command 07 (START) was refused" in str(ran(PureLink(device), 2).error)


def test_the_magnetometer_s_gain_is_set_before_its_constants_are_used(virtual, ran, body):
    """A Shimmer left at 8.1 gauss by somebody else still says the field where it is."""
    device = virtual(memory=Memory(mag_gain=7))
    times_ns, field_ut = ran(PureLink(device), 2, model="Shimmer3 IMU").samples("magnetometer")
    true_s = np.array([device.true_s(round(each / TICK_NS)) for each in times_ns])
    assert field_ut == pytest.approx(100 * body.field(true_s), abs=0.2)


@pytest.mark.parametrize(("firmware", "known"), [((1, 0, 8, 0), False), ((3, 0, 16, 9), True)])
def test_firmware_that_knows_no_battery_is_not_asked_for_it(virtual, ran, monkeypatch, firmware, known):
    """BtStream streams like any other; its charge is unknown, before and while it streams."""
    monkeypatch.setattr("driver_shimmer.device.BATTERY_S", 0.02)
    run = ran(PureLink(virtual(memory=Memory(firmware=firmware))), 3)
    assert run.error is None
    assert len(run.samples("eda")[0]) > 100
    told = [each.battery_percent for each in run.of(Status) if each.battery_percent is not None]
    assert [not np.isnan(each) for each in told] == [known] * len(told)


def test_a_host_clock_that_is_set_back_holds_nothing_up(made):
    """Two packets, the second a minute earlier by the wall: they are handed on at once."""
    layout = Layout((0x1C,))
    prepared = Prepared(Identity(), 0.0, layout, {}, (), ())
    found = iter([Packet(60 * SECOND_NS, 640, bytes(layout.length)), Packet(0, 1280, bytes(layout.length))])
    device = made(PureLink(None), streams=("eda",))
    items = list(device.items(found, prepared))
    assert sum(isinstance(each, Samples) for each in items) == 1


@pytest.mark.parametrize("model", list(MODELS))
def test_the_event_loop_is_woken_once_for_a_message(virtual, tmp_path, monkeypatch, model):
    """What a Shimmer sends every few milliseconds is handed on once it makes a message."""
    config = ShimmerConfig(sensor_id="it_1", port=f"{tmp_path}/s", model=model)
    device = Shimmer(config, streams_of(config), lambda: linked(config.port))

    async def drive():
        async with plugged(tmp_path / "s", virtual()):
            return await wakes_per_message(monkeypatch, device.stream(), "accelerometer")

    assert asyncio.run(drive()) < 1.5


def test_the_converters_noise_is_no_contact(made):
    """One count and ten counts above nothing, in the range of 3.3 MOhm: no skin, and nothing flickers."""
    device = made(PureLink(None), streams=("eda",))
    counts = [683, 692, 683, 692]
    said = [item for each in counts for item in device._skin(np.array([[0xC000 | each]]), np.array([0]), 0)]
    assert [each.contact for each in said if isinstance(each, Status)] == [0.0]


@pytest.mark.parametrize(("model", "code"), [("Shimmer3 GSR+", 0x65), ("Shimmer3 ECG", 0x62)])
def test_an_answer_shorter_than_asked_is_a_lost_device(virtual, ran, model, code):
    """Board and registers: an answer of no bytes makes no sense, and nothing crashes."""
    device = virtual()
    answer = device.receive
    device.receive = lambda octets, time_s: (
        bytes([0xFF, code, 0]) if octets[0] == {0x65: 0x66, 0x62: 0x63}[code] else answer(octets, time_s)
    )
    assert "answered with 0 bytes" in str(ran(PureLink(device), 2, model=model).error)


def test_an_ecg_comes_in_microvolts(virtual, ran, body):
    """Lead II is what lies between its electrodes, lead I its share."""
    device = virtual()
    run = ran(PureLink(device), 5, model="Shimmer3 ECG")
    times_ns, uv = run.samples("ecg")
    true_s = np.array([device.true_s(round(each / TICK_NS)) for each in times_ns])
    assert uv[:, 0] == pytest.approx(body.ecg.at(true_s), abs=0.1)
    assert uv[:, 1] == pytest.approx(0.6 * body.ecg.at(true_s), abs=0.1)


def test_every_lost_packet_is_a_hole_of_its_length(virtual, ran):
    """One per cent lost: the times say how many, exactly; no time twice."""
    loss = Lossy(last=60 * 128)
    run = ran(PureLink(virtual(loss)), 70)
    times_ns, _ = run.samples("eda")
    steps = np.diff(times_ns) * 128 / SECOND_NS
    assert np.abs(steps - np.rint(steps)).max() < 0.01
    assert int(np.sum(np.rint(steps) - 1)) == loss.lost_total > 30


def test_the_clock_goes_on_where_it_wraps(virtual, ran):
    """24 bits are over after 512 s; the device's time is not."""
    run = ran(PureLink(virtual(clock_start=(1 << 24) - 40_000)), 3)
    times_ns, _ = run.samples("eda")
    assert np.diff(times_ns) == pytest.approx(SECOND_NS / 128, abs=TICK_NS)
    assert times_ns[-1] > 512 * SECOND_NS


def test_a_device_that_was_restarted_shows_its_new_time(virtual, ran, made):
    """It begins at 0 again when it has been switched off and on."""
    link = PureLink(virtual(clock_start=100 * 32768))
    device = made(link)
    before = ran(link, 2, device).samples("eda")[0]
    link.device, link.on_s = virtual(on_s=link.now_s), link.now_s
    after = ran(link, 2, device).samples("eda")[0]
    assert before[0] > 100 * SECOND_NS
    assert after[0] < 90 * SECOND_NS


def test_a_restart_that_nobody_saw_is_noticed_by_the_silence(virtual, ran, made, monkeypatch):
    """Its link stays and nothing comes: within the limit it is lost, so that it is prepared and started anew."""
    monkeypatch.setattr("driver_shimmer.device.SILENCE_S", 0.2)
    link = PureLink(virtual(), every=lambda now_s: switch(now_s))

    def switch(now_s: float) -> None:
        if now_s > 40 and link.on_s == 0:
            link.device, link.on_s = virtual(on_s=now_s), now_s

    run = ran(link, 1e6, made(link))
    assert "no packet" in str(run.error)


def test_a_lost_link_is_a_hole_and_no_new_beginning(virtual, ran, made):
    """Disconnected for ten minutes, more than a round of its clock: the time goes on as the device's did."""
    link = PureLink(virtual())
    device = made(link)
    before = ran(link, 2, device).samples("eda")[0]
    left_s = link.now_s
    link.now_s += 600
    after = ran(link, 2, device).samples("eda")[0]
    assert 600 < (after[0] - before[-1]) / SECOND_NS < link.now_s - left_s


def test_who_it_is_how_full_and_in_which_range_is_said(virtual, ran):
    """Identity, battery and contact at the start; every change of range with its time."""
    run = ran(PureLink(virtual()), 2)
    (identity,) = run.of(Identity)
    assert (identity.serial_number, identity.firmware_version) == ("0a1b2c3d4e5f6071", "LogAndStream 0.16.9")
    said = run.of(Status)
    assert [each.battery_percent for each in said if each.battery_percent] == [pytest.approx(61, abs=1)]
    assert [each.contact for each in said if each.contact is not None] == [1.0]
    assert [each.features[0].values for each in run.of(Reported)] == [(1.0,)]


def test_contact_is_said_again_after_a_reconnect(virtual, ran, made):
    """What was known of the electrodes ended with the link: it is said although it is what it was."""
    link = PureLink(virtual())
    device = made(link)
    for _ in range(2):
        assert [each.contact for each in ran(link, 2, device).of(Status) if each.contact is not None] == [1.0]


def test_electrodes_that_came_off_are_no_contact(virtual, ran, body):
    """Nothing between them: no conductance, and said so."""
    body.wearing.contact = False
    run = ran(PureLink(virtual()), 2)
    assert [each.contact for each in run.of(Status) if each.contact is not None] == [0.0]
    assert np.all(run.samples("eda")[1] <= 0.001)


def test_the_battery_is_asked_for_while_it_streams(virtual, ran, monkeypatch):
    """The answer comes between packets and costs none."""
    monkeypatch.setattr("driver_shimmer.device.BATTERY_S", 0.002)
    run = ran(PureLink(virtual()), 3)
    assert sum(each.battery_percent is not None for each in run.of(Status)) > 3
    assert np.diff(run.samples("eda")[0]) == pytest.approx(SECOND_NS / 128, abs=TICK_NS)


def test_it_is_stopped_whatever_happens(virtual, ran):
    """When the driver ends it sends the stop, and the device has stopped."""
    device = virtual()
    link = PureLink(device)
    ran(link, 1)
    assert link.written[-1] == b"\x20"
    assert not device.streaming


def test_one_that_a_killed_driver_left_streaming_is_stopped_first(virtual, ran):
    """Its packets are no answers."""
    device = virtual()
    device.receive(b"\x07", 0.0)
    run = ran(PureLink(device), 2)
    assert run.error is None
    assert len(run.samples("eda")[0]) > 100


@pytest.mark.parametrize(
    ("memory", "said"),
    [(Memory(hardware=10), "hardware 10"), (Memory(firmware=(3, 0, 5, 3)), "LogAndStream 0.5.3")],
)
def test_a_device_of_another_kind_is_a_wrong_configuration(virtual, made, memory, said):
    """Shimmer3R and firmware with times of 16 bits are named."""

    async def first() -> None:
        async with aclosing(made(PureLink(virtual(memory=memory))).stream()) as items:
            async for _ in items:
                pass

    with pytest.raises(ConfigError, match=said):
        asyncio.run(first())


class Mute:
    """A device that answers nothing."""

    def receive(self, octets: bytes, time_s: float) -> bytes:
        return b""

    def send(self, time_s: float) -> bytes:
        return b""


def test_silence_is_a_lost_device(ran, monkeypatch):
    """Something that answers no command is tried again, with the reason."""
    monkeypatch.setattr("driver_shimmer.session.ANSWER_S", 0.05)
    run = ran(PureLink(Mute()), 1e6)
    assert "no answer to command 3f" in str(run.error)


def test_a_damaged_stream_loses_what_was_hit_and_never_lies(virtual, ran, body):
    """Bytes that vanish: every value that comes is the right one for its time, and what is missing shows."""
    random = np.random.default_rng(5)

    def spoil(octets: bytes) -> bytes:
        at = int(random.integers(0, len(octets) or 1))
        return octets[:at] + octets[at + 3 :] if len(octets) > 20 and random.random() < 0.05 else octets

    device = virtual()
    run = ran(PureLink(device, spoil=spoil), 30)
    times_ns, conductance_us = run.samples("eda")
    true_s = np.array([device.true_s(round(each / TICK_NS)) for each in times_ns])
    assert conductance_us[:, 0] == pytest.approx(body.skin.at(true_s), abs=0.02)
    steps = np.diff(times_ns) * 128 / SECOND_NS
    assert np.abs(steps - np.rint(steps)).max() < 0.01
    assert 1 < np.sum(np.rint(steps) - 1) < 100


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"streams": ("ecg",)}, "'ecg'"),
        ({"streams": ("eda", "eda")}, "at most once"),
        ({"rate_hz": 0.5}, "rate_hz"),
        ({"port": "rfcomm0"}, "port"),
    ],
)
def test_wrong_parameters_are_named(parameters, said):
    """One line that says which."""
    with pytest.raises(ValueError, match=said):
        ShimmerConfig(**{"sensor_id": "it_1", "port": "/dev/rfcomm0", **parameters})
