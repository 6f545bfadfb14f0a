"""The belt's conversation against a link without Bluetooth."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager

import pytest
from driver_vernier import device
from driver_vernier.config import Config, streams_of
from driver_vernier.device import NOTIFY, WRITE, Device, Pace
from sense4hri.device import Identity, Reported, Samples, Status
from sense4hri.errors import ConfigError, DeviceLost
from sensor_bench.vernier import firmware
from sensor_bench.vernier.firmware import Commands, measurement, sealed


def _both(number: int, rate: float) -> bytes:
    return measurement(number, 6, [[10.0, float("nan")], [10.5, rate]])


NOTICE = bytes([0x0D, 1, 2, 3])


class FakeBelt:
    """Radio and link in one: the bench's firmware answers in parts of 20 bytes; once started it sends three frames.

    silent: a command that is never answered. frames: what it sends in place of the three.
    """

    name, rssi_dbm, mtu = "GDX-RB 0K1002A1", -50.0, 23

    def __init__(self, silent: int = -1, frames: Sequence[bytes] = (), lost: bool = True) -> None:
        self.frames, self.lost = frames or [_both(8, float("nan")), _both(9, 15.0), _both(12, 15.0)], lost
        self.commands, self.silent, self.asked = Commands("0K1002A1", lambda: 81), silent, list[int]()
        self._receive: Callable[[bytes], None]

    @asynccontextmanager
    async def connect(self, on_lost: Callable[[str], None]) -> AsyncIterator["FakeBelt"]:
        self.on_lost = on_lost
        yield self

    async def subscribe(self, characteristic: str, receive: Callable[[bytes], None]) -> bool:
        self._receive = receive
        return characteristic == NOTIFY

    async def write(self, characteristic: str, value: bytes, acknowledged: bool = True) -> None:
        assert (characteristic, acknowledged, len(value) <= 20) == (WRITE, False, True)
        for answer in self.commands.receive(value):
            self.asked.append(answer[0])
            if answer[0] != self.silent:
                self.send(sealed(0x98, 0, answer))
            if answer[0] == 0x18:
                for frame in self.frames:
                    self.send(frame)
                if self.lost:
                    self.on_lost("the link broke")

    def send(self, frame: bytes) -> None:
        for at in range(0, len(frame), 20):
            self._receive(frame[at : at + 20])


def items_of(belt: FakeBelt) -> list:
    """What the device yields, and the error it ends with."""
    found = []
    config = Config(sensor_id="it_1", name="0K1002A1")

    async def run() -> None:
        try:
            async for item in Device(config, streams_of(config), belt).stream():
                found.append(item)  # noqa: PERF401 - what came before an error counts
        except (DeviceLost, ConfigError) as err:
            found.append(err)

    asyncio.run(asyncio.wait_for(run(), 20))
    return found


def test_a_session_from_the_first_command_to_the_last():
    """Identity, battery, force with what is missing before it, the newest rate; stopped though the link is gone."""
    belt = FakeBelt()
    found = items_of(belt)
    assert belt.asked == [0x1A, 0x10, 0x55, 0x51, 0x50, 0x1B, 0x18, 0x19, 0x54]
    assert belt.commands.period_us == 100_000
    assert Identity(None, "GDX-RB", "0K1002A1", "1.7", None) in found
    assert Status(battery_percent=81.0) in found
    samples = [item for item in found if isinstance(item, Samples)]
    assert [item.chunk.samples.tolist() for item in samples] == [[[10.0], [10.5]]] * 3
    assert [item.lost for item in samples] == [0, 0, 4]
    assert {item.features[0].values for item in found if isinstance(item, Reported)} == {(15.0,)}
    assert isinstance(found[-1], DeviceLost)


def test_what_is_missing_before_a_frame_without_force_is_told_with_the_next_force():
    """Counters 1, 2, a notice 9, a rate alone 11, then force 12: six and one frames of two samples are missing."""
    rate = measurement(11, 1 << 2, [[15.0], [15.0]])
    found = items_of(FakeBelt(frames=[_both(1, 15.0), _both(2, 15.0), sealed(0x20, 9, NOTICE), rate, _both(12, 15.0)]))
    assert [item.lost for item in found if isinstance(item, Samples)] == [0, 0, 14]


def test_only_force_is_a_belt_that_is_not_silent(monkeypatch):
    """Notices, rates and odd bytes alone: the belt is silent, and the link is made anew."""
    monkeypatch.setattr(device, "SILENCE_S", 0.3)
    belt, config = FakeBelt(frames=[_both(1, 15.0)], lost=False), Config(sensor_id="it_1", name="0K1002A1")

    async def chatter() -> None:
        for number in range(2, 40):
            await asyncio.sleep(0.05)
            belt.send(sealed(0x20, number, NOTICE) + measurement(number, 1 << 2, [[15.0]]) + b"\x07\x01")

    async def listen() -> None:
        async for _ in Device(config, streams_of(config), belt).stream():
            pass

    async def run() -> None:
        talk = asyncio.ensure_future(chatter())
        with pytest.raises(DeviceLost, match="no measurement"):
            await listen()
        assert not talk.done()
        talk.cancel()

    asyncio.run(asyncio.wait_for(run(), 20))


@pytest.mark.parametrize(
    ("channels", "reason"),
    [({2: ("Temperature", "C")}, "has no channel 1"), ({1: ("Force", "lb")}, "measures in 'lb'")],
)
def test_another_sensor_of_the_family_is_refused(monkeypatch, channels, reason):
    """Whoever gives the name of a thermometer is told so; it is not measured as breath."""
    monkeypatch.setattr(firmware, "CHANNELS", channels)
    (*_, error) = items_of(FakeBelt())
    assert isinstance(error, ConfigError)
    assert reason in str(error)


@pytest.mark.parametrize("command", [0x1A, 0x50, 0x1B])
def test_a_belt_that_does_not_answer_is_lost(monkeypatch, command):
    """The sentence names the command; the driver tries again."""
    monkeypatch.setattr(device, "ANSWER_S", 0.05)
    (*_, error) = items_of(FakeBelt(silent=command))
    assert isinstance(error, DeviceLost)
    assert f"no answer to command {command:#04x}" in str(error)


def test_a_rate_the_belt_cannot_do_is_refused():
    """A parameter of the study beyond 100 Hz ends the driver with its name."""
    config = Config(sensor_id="it_1", name="0K1002A1")
    stream = streams_of(config)["respiration"].__class__(500.0, "N", 0.0, 50.0, 24, ("respiration",))
    with pytest.raises(ConfigError, match=r"respiration.sampling_frequency_hz' is 500"):
        Device(config, {"respiration": stream}, FakeBelt())


def test_a_rate_this_belt_cannot_do_is_refused_when_it_says_so(monkeypatch):
    """A belt that says 200 ms is not asked for 10 Hz: the sentence names the parameter, the belt and its limit."""
    monkeypatch.setattr(firmware, "PERIODS_US", (200_000, 3_600_000_000, 200_000, 1_000))
    belt = FakeBelt()
    (*_, error) = items_of(belt)
    assert isinstance(error, ConfigError)
    assert str(error) == "parameter 'respiration.sampling_frequency_hz' is 10, GDX-RB 0K1002A1 can do at most 5"
    assert 0x18 not in belt.asked


@pytest.mark.parametrize(("sent_hz", "refused"), [(10.0, False), (9.0, False), (20.0, True), (5.0, True)])
def test_a_belt_that_keeps_another_period_is_no_belt_at_the_asked_rate(sent_hz, refused):
    """Twice or half the rate that was asked for is told with both rates; a crystal that is off is not."""
    now_s = [0.0]
    pace = Pace(10.0, lambda: now_s[0])

    def listen() -> None:
        for number in range(round(25 * sent_hz)):
            now_s[0] = number / sent_hz
            pace.came(1)

    if not refused:
        listen()
        return
    with pytest.raises(DeviceLost, match=f"sends {sent_hz:.1f} samples per s, asked were 10"):
        listen()


@pytest.mark.parametrize("kept", [0, 150], ids=["what was sent meanwhile is gone", "it comes at once"])
@pytest.mark.parametrize(("sent_hz", "refused"), [(10.0, False), (20.0, True), (5.0, True)])
def test_a_stall_is_no_other_period(kept, sent_hz, refused):
    """The link stands for 15 s while the pace is checked: it is checked afterwards, a belt that is off still found."""
    now_s = [0.0]
    pace = Pace(10.0, lambda: now_s[0])

    def listen(from_s: float, to_s: float) -> None:
        for number in range(round((to_s - from_s) * sent_hz)):
            now_s[0] = from_s + number / sent_hz
            pace.came(1)

    listen(0.0, 10.0)
    now_s[0] = 25.0
    for _ in range(kept):
        pace.came(1)
    if not refused:
        listen(25.0, 60.0)
        return
    with pytest.raises(DeviceLost, match=f"sends {sent_hz:.1f} samples per s, asked were 10"):
        listen(25.0, 60.0)


def test_a_list_of_channels_that_is_cut_short_is_asked_for_again():
    """Fewer than its four bytes say nothing of the belt: another try, and no end of the driver with status 78."""
    belt = FakeBelt()
    answers = belt.commands.receive
    belt.commands.receive = lambda value: [each[:2] if each[0] == 0x51 else each for each in answers(value)]
    (*_, end) = items_of(belt)
    assert isinstance(end, DeviceLost), end
    assert "makes no sense" in str(end)
