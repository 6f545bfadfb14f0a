"""driver-bioharness: its bytes, and the driver's device against a virtual strap."""

import asyncio
import datetime
from contextlib import aclosing, asynccontextmanager
from typing import Any

import numpy as np
import pytest
from driver_bioharness import protocol
from driver_bioharness.config import BioHarnessConfig, streams_of
from driver_bioharness.device import BioHarness
from driver_bioharness.protocol import SHAPES, Kind, Message
from hypothesis import given, settings
from hypothesis import strategies as st
from pure_link import PureLink
from sense4hri.arrivals import Arrival, Arrivals
from sense4hri.device import Identity, Reported, Samples, Status
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS
from sensor_bench.bioharness.firmware import UV_PER_COUNT, VirtualBioHarness, Worn, message, packed
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.sources import EcgSource, Wearing
from sensor_bench.signals.waveforms import stored

README = bytes.fromhex("02212007ea070b168046c503") + packed([512 + place for place in range(18)])


class Lossy:
    """Loses one packet in a hundred, and counts the samples of each stream."""

    def __init__(self, probability: float = 0.0) -> None:
        self._random, self._probability = np.random.default_rng(4), probability
        self.sent: dict[str, int] = {}
        self.lost: dict[str, int] = {}

    def carry(self, packet: bytes, **samples: int) -> bytes:
        gone = self._random.random() < self._probability
        for name, count in samples.items():
            self.sent[name] = self.sent.get(name, 0) + count
            self.lost[name] = self.lost.get(name, 0) + count * gone
        return b"" if gone else packet


def strap(carry: Any = None, begins: str = "2026-11-22T17:34:20", **keywords: Any) -> VirtualBioHarness:
    at = datetime.datetime.fromisoformat(begins)
    return VirtualBioHarness(Heart(1), stored(), keywords.pop("worn", Worn()), carry or Lossy().carry, at, **keywords)


@pytest.fixture(autouse=True)
def _awake(monkeypatch):
    """Time is made up: the strap is kept awake by it, not by the clock on the wall."""
    monkeypatch.setattr("driver_bioharness.device.LIFESIGN_S", 0.0)


def virtual_link(device: VirtualBioHarness) -> PureLink:
    return PureLink(device, idle_s=0.02)


def ran(link: PureLink, seconds: float, **parameters: Any) -> list[Any]:
    """What the driver's device yields for so many seconds of the link's time."""
    config = BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0", **parameters)
    device, found = BioHarness(config, streams_of(config), link.connect), []

    async def run() -> None:
        async with aclosing(device.stream()) as items:
            async for item in items:
                found.append(item)
                if link.now_s > seconds:
                    return

    asyncio.run(run())
    return found


def samples(items: list[Any], sensor_type: str) -> list[Samples]:
    return [each for each in items if isinstance(each, Samples) and each.sensor_type == sensor_type]


def test_the_packet_of_the_readme_says_what_the_readme_says():
    """Breathing, number 7, on 2026-11-22 at 17:34:20.288 by its own calendar, from 512 counts on."""
    octets = README + bytes([protocol.crc8(README[3:]), 0x03])
    (found,) = protocol.take(bytearray(octets))
    assert isinstance(found, Message)
    head = protocol.decode_head(found.content)
    shown = datetime.datetime(1970, 1, 1) + datetime.timedelta(milliseconds=head.first_ns // 10**6)
    assert (found.kind, head.sequence, str(shown)) == (Kind.BREATHING, 7, "2026-11-22 17:34:20.288000")
    values = protocol.decode_samples(Kind.BREATHING, head.octets)
    assert values[:, 0].tolist() == [512.0 + place for place in range(18)]


@given(content=st.binary(max_size=128), kind=st.integers(0, 255))
def test_both_ends_agree_in_frame_and_checksum(content, kind):
    """The driver's table of CRC-8 and the virtual strap's division are one polynomial."""
    assert protocol.encode(kind, content) == message(kind, content)
    assert list(protocol.take(bytearray(message(kind, content)))) == [Message(kind, content)]


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_the_link_does_no_message_is_wrong(seed):
    """Cuts, flipped bits, garbage, any pieces: every whole message comes once, and nothing else."""
    random = np.random.default_rng(seed)
    stream, whole = b"", []
    for number in range(150):
        octets, fate = message(number, random.bytes(int(random.integers(1, 90)))), random.random()
        if fate < 0.02:
            octets = octets[: random.integers(1, len(octets))] + b"\x00" * 140  # what follows is no part of it
        elif fate < 0.04:
            octets = octets[:-3] + bytes([octets[-3] ^ 1 << int(random.integers(0, 8))]) + octets[-2:]
        else:
            whole.append(number)
        stream += octets + (random.bytes(3) if fate > 0.98 else b"")
    buffer, found = bytearray(), []
    while stream:
        size = int(random.integers(1, 300))
        buffer += stream[:size]
        stream = stream[size:]
        found += protocol.take(buffer)
    numbers = [each.kind for each in found if isinstance(each, Message)]
    assert [each for each in numbers if each in whole] == whole or len(set(whole) - set(numbers)) <= 2
    assert len(numbers) == len(set(numbers)) or len(numbers) - len(set(numbers)) <= 1


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"\x00\xea\x07\x0d\x01" + bytes(4), "2026-13-1"), (b"\x00\xea\x07\x0c\x01\xff\xff\xff\xff", "ms of the day")],
)
def test_a_time_that_cannot_be_is_an_error(content, said):
    """A thirteenth month, a day of more than 86 400 s."""
    with pytest.raises(FrameError, match=said):
        protocol.decode_head(content)


def test_a_calendar_that_was_never_set_still_counts():
    """0-0-0 at half past one is an hour and a half after the epoch: the packet is not lost."""
    half_past_one_ms = 90 * 60_000
    assert protocol.decode_head(bytes(5) + half_past_one_ms.to_bytes(4, "little")).first_ns == half_past_one_ms * 10**6


def test_samples_are_what_the_body_did_at_their_time():
    """The ECG by its stamps lies on the wearer's, its clock fast by 200 ppm; every stream at its rate."""
    device = strap(skew_ppm=200.0)
    items = ran(virtual_link(device), 20)
    ecg = EcgSource(Heart(1), Wearing(), stored(), 1)
    for each in samples(items, "ecg"):
        device_ns = each.chunk.device_ns - np.arange(62, -1, -1) * SECOND_NS // 250
        true_s = np.array([device.true_s(int(at)) for at in device_ns])
        assert each.chunk.samples[:, 0] == pytest.approx(512 + ecg.at(true_s) / UV_PER_COUNT, abs=0.51)
    for sensor_type, kind in (("respiration", Kind.BREATHING), ("accelerometer", Kind.ACCELEROMETER)):
        mine = samples(items, sensor_type)
        assert all(each.chunk.samples.shape == (SHAPES[kind].samples, SHAPES[kind].channels) for each in mine)
        assert len(mine) > 10
    gravity = np.linalg.norm(samples(items, "accelerometer")[0].chunk.samples, axis=1)
    assert gravity == pytest.approx(9.7, abs=0.7)


def test_losses_are_the_holes_of_its_time_exactly():
    """One packet in a hundred lost: what the times say is missing is what was thrown away."""
    loss = Lossy(0.03)
    items = ran(virtual_link(strap(loss.carry)), 120)
    stamps = [each.chunk.device_ns for each in samples(items, "ecg")]
    holes = np.rint(np.diff(stamps) * 250 / SECOND_NS).astype(int) - 63
    assert 0 < holes.sum() <= loss.lost["ecg"] <= holes.sum() + 2 * 63
    assert set(holes % 63) == {0}


@pytest.mark.parametrize(("kind", "samples"), [(Kind.ECG, 63), (Kind.BREATHING, 18), (Kind.ACCELEROMETER, 20)])
def test_a_packet_that_came_twice_is_counted_as_one(kind, samples):
    """The second is handed on with the same stamp, which the kit counts as a duplicate and nobody interprets."""
    config = BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0")
    device, clock = BioHarness(config, streams_of(config), None), SampleClock(SHAPES[kind].rate_hz)
    head = bytes([7]) + (2026).to_bytes(2, "little") + bytes([11, 22]) + bytes(4)
    packet = Message(kind, head + packed([512] * (samples * SHAPES[kind].channels)))
    for _ in range(2):
        for each in device.items(packet, 10**18):
            clock.place(each.chunk)
    assert clock.duplicates_total == 1


def test_what_came_before_the_link_broke_is_handed_on():
    """The sign of life cannot be written any more; two packets that came before wait to be read, then the end."""
    config, arrivals = BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0"), Arrivals[bytes]()
    head, found = (2026).to_bytes(2, "little") + bytes([11, 22]), list[Any]()
    for number in range(2):
        content = bytes([number]) + head + (252 * number).to_bytes(4, "little") + packed([512] * 63)
        arrivals.put(Arrival(10**18, message(Kind.ECG, content)))
    arrivals.fail(DeviceLost("hung up"))

    class Broken:
        gather_s, enough = 0.0, 0

        def write(self, octets: bytes) -> None:
            if octets[1] == Kind.LIFESIGN:
                raise DeviceLost("the link broke")

    @asynccontextmanager
    async def connect():
        yield Broken(), arrivals

    async def run() -> None:
        async with aclosing(BioHarness(config, streams_of(config), connect).stream()) as items:
            async for item in items:
                found.append(item)

    with pytest.raises(DeviceLost, match="hung up"):
        asyncio.run(run())
    assert len(samples(found, "ecg")) == 2


def test_midnight_is_no_gap():
    """The ms of the day begin at 0 again, the date goes on."""
    items = ran(virtual_link(strap(begins="2026-12-31T23:59:55")), 12)
    steps = np.diff([each.chunk.device_ns for each in samples(items, "ecg")])
    assert set(steps.tolist()) == {252_000_000}


def test_a_strap_s_heart_is_told_under_ecg_whatever_is_sampled():
    """As the contract has it (section 5); a rate of respiration under its own type, too."""
    items = ran(virtual_link(strap()), 20, streams=("accelerometer",))
    under = {
        feature.name: each.sensor_type for each in items if isinstance(each, Reported) for feature in each.features
    }
    wanted = {"heart_rate": "ecg", "rr_interval": "ecg", "respiration_rate": "respiration", "posture": "accelerometer"}
    assert wanted.items() <= under.items()


def test_intervals_are_the_hearts_and_each_comes_once():
    """R-R intervals are those between the beats."""
    items = ran(virtual_link(strap()), 30)
    intervals = [f for each in items if isinstance(each, Reported) for f in each.features if f.name == "rr_interval"]
    told = [value for feature in intervals for value in feature.values]
    true = [round(beat.rr_s * 1000) for beat in Heart(1).beats(0, 40)]
    at = true.index(round(told[0]))
    assert told == true[at : at + len(told)]
    assert len(told) > 20


def test_what_was_before_missing_packets_is_no_beat():
    """The sign turned while nothing came: when is not known, so no interval is told of the first slot after."""
    device = BioHarness(config := BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0"), streams_of(config), None)
    begun_ns, second_ns = 10**18, 1_008_000_000
    for number, (sign, told) in {0: (1, 0), 1: (-1, 1), 60: (1, 0), 61: (-1, 1)}.items():
        octets = np.full(18, sign * 800, "<i2").tobytes()
        packet = protocol.Packet(number, begun_ns + number * second_ns, octets)
        assert len(list(device._intervals(packet, 0))) == told


def test_what_the_summary_does_not_know_is_not_told():
    """Ones in every bit are no measurement."""
    octets = bytearray(b"\xff" * 60)
    octets[protocol.STATUS] = 0
    summary = protocol.decode_summary(bytes(octets))
    assert [summary.activity_g, summary.peak_acceleration_g, summary.battery_percent] == [None] * 3


def test_the_summary_is_told_and_what_is_unreliable_is_not():
    """Heart and breathing rate, battery, contact; of one that nobody wears no heart rate."""
    worn = Worn(battery_percent=55)
    items = ran(virtual_link(strap(worn=worn)), 5)
    names = {f.name: f.values[0] for each in items if isinstance(each, Reported) for f in each.features}
    assert names["heart_rate"] == pytest.approx(66, abs=5)
    assert (names["respiration_rate"], names["skin_temperature"]) == (15.0, 33.5)
    assert Status(battery_percent=55.0, contact=1.0) in items
    assert Identity(serial_number="BHT000001") in items
    worn.level = 3
    items = ran(virtual_link(strap(worn=worn)), 5)
    assert not [f for each in items if isinstance(each, Reported) for f in each.features if f.name == "heart_rate"]
    assert next(each.contact for each in items if isinstance(each, Status)) == 0.0


def test_it_is_kept_awake_and_switched_off():
    """Without a lifesign it would end after ten seconds; when the driver ends nothing is sent any more."""
    device = strap()
    link = virtual_link(device)
    assert len(samples(ran(link, 30), "ecg")) > 100
    assert protocol.encode(Kind.LIFESIGN) in link.written
    assert device.sending == []


def test_what_the_device_refuses_is_told():
    """A message that ends in NAK is an error that names it."""
    config = BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0")
    device = BioHarness(config, streams_of(config), lambda: None)  # type: ignore[arg-type, return-value]
    (error,) = device.items(Message(0x16, b"", 0x15), 0)
    assert "16 was refused" in str(error)


@pytest.mark.parametrize(
    ("streams", "said"), [((), "at least one"), (("ecg", "ecg"), "at most once"), (("eda",), "eda")]
)
def test_wrong_parameters_are_named(streams, said):
    """One line that says which."""
    with pytest.raises(ValueError, match=said):
        BioHarnessConfig(sensor_id="strap_1", port="/dev/rfcomm0", streams=streams)
