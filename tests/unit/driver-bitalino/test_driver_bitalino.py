"""driver-bitalino: the emulator's bytes, cut, spoilt and lost, against what was sampled; units; what it refuses."""

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driver_bitalino import protocol, transport
from driver_bitalino.config import BitalinoConfig, streams_of
from driver_bitalino.device import Bitalino, Decoder
from driver_bitalino.losses import Rounds
from driver_bitalino.protocol import Frames, Run
from plugged import let_go, plugged, until_unplugged, wakes_per_message
from sense4hri.arrivals import Arrival
from sense4hri.device import Identity, Item, Marked, Samples, Status
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.stamps import SECOND_NS
from sensor_bench.bitalino.firmware import Board, Panel
from sensor_bench.bitalino.ports import PLUGGED, Port
from sensor_bench.wired import Frames as Air

BEGUN_NS = 1_800_000_000 * SECOND_NS
KINDS = ("emg", "ecg", "eda", "eeg", "acc", "lux")


def numbered(number: int) -> Port:
    """A port whose counts are the number of the sample and of the port, so that none can be taken for another."""
    return Port(
        f"s{number}", lambda first, count, fs: (np.arange(first, first + count) * 7 + number) % 1024, np.asarray
    )


class Counting(Port):
    """A port that gives its measure as counts."""

    def counts(self, first: int, count: int, fs_hz: float) -> Any:
        return self.measure(first, count, fs_hz).astype(np.int64) % 1024


def board(air: Air | None = None, panel: Panel | None = None, rate_factor: float = 1.0) -> Board:
    ports = [Counting(*numbered(number)) for number in range(6)]
    return Board(ports, panel or Panel(), air or Air(1), 0.0, rate_factor)


def wanted(channels: int, count: int) -> np.ndarray:
    """What such a board samples: the fifth and sixth channel keep the upper six of ten bits."""
    counts = (np.arange(count)[:, None] * 7 + np.arange(channels)) % 1024
    return counts >> np.where(np.arange(channels) < 4, 0, 4)


def started(device: Board, channels: int, rate_hz: int = 1000) -> Board:
    device.receive(protocol.set_rate(rate_hz) + protocol.start(tuple(range(1, channels + 1))), 0.0)
    return device


def runs_of(octets: bytes, channels: int, pieces: int = 1, seed: int = 0) -> tuple[list[Run], list[FrameError]]:
    """What comes out where the bytes come in so many pieces."""
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(octets), pieces - 1))
    frames, buffer, runs, errors = Frames(channels), bytearray(), [], []
    for part in np.split(np.frombuffer(octets, np.uint8), cuts):
        buffer += part.tobytes()
        for each in frames.take(buffer):
            (errors if isinstance(each, FrameError) else runs).append(each)
    return runs, errors


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 5, 6])
def test_every_sample_of_every_number_of_channels(channels: int) -> None:
    """In pieces cut anywhere each sample comes once, in order, right to the bit, and nothing is lost."""
    octets = started(board(), channels).send(2.0)
    assert len(octets) == 2000 * protocol.frame_bytes(channels)
    runs, errors = runs_of(octets, channels, pieces=100, seed=channels)
    assert errors == []
    np.testing.assert_array_equal(np.concatenate([run.counts for run in runs]), wanted(channels, 2000))
    assert sum(run.lost for run in runs) == 0


def test_a_frame_byte_by_byte() -> None:
    """The frame of the README: number 5, I1 and I2 high, A1 612, A2 301; a wrong bit anywhere breaks its CRC."""
    octets = bytes.fromhex("2d 91 c9 5f")
    frame = np.frombuffer(octets, np.uint8)[None]
    assert protocol.crc_fits(frame)[0]
    spoilt = np.repeat(frame, 32, axis=0) ^ np.packbits(np.eye(32, dtype=np.uint8), axis=1)
    assert not protocol.crc_fits(spoilt).any()


@pytest.mark.parametrize("seed", range(6))
def test_spoilt_and_lost_frames_are_counted_to_the_sample(seed: int) -> None:
    """1 % of the frames lost, a bit wrong in 1 % of the others: the rest comes once, right, where the count says."""
    random, air, size = np.random.default_rng(seed), Air(seed, loss=0.01), protocol.frame_bytes(4)
    octets = bytearray(started(board(air), 4).send(10.0))
    spoilt = np.flatnonzero(random.random(len(octets) // size - 20) < 0.01) + 10
    for frame in spoilt.tolist():
        octets[frame * size + int(random.integers(size))] ^= 1 << int(random.integers(8))
    runs, errors = runs_of(bytes(octets), 4, pieces=500, seed=seed)
    at, indices = octets[size - 1] >> 4, []  # the first frames may be lost: the number of the first that came
    for run in runs:
        at += run.lost
        indices += range(at, at := at + len(run.counts))
    np.testing.assert_array_equal(np.concatenate([run.counts for run in runs]), wanted(4, 10_000)[indices])
    missing = 10_000 - air.counts["s0"].samples_lost - len(indices)
    assert len(spoilt) <= missing <= len(spoilt) + 3  # a right one between wrong ones may go with them
    assert 0 < len(errors) < 2 * len(spoilt)


def test_bytes_that_vanish_cost_the_frames_they_were_of() -> None:
    """After a cut in the middle of a frame the next whole one is found, and what is missing counted."""
    octets = started(board(), 3).send(1.0)
    size = protocol.frame_bytes(3)
    runs, errors = runs_of(octets[: 100 * size + 4] + octets[104 * size + 3 :], 3)
    assert [len(run.counts) for run in runs] == [100, 895]
    assert [run.lost for run in runs] == [0, 5]
    assert len(errors) == 1


@pytest.mark.parametrize("rate_factor", [1.0, 1.001, 0.999])
@pytest.mark.parametrize(("hole", "told"), [(5, 5), (47, 47), (1007, 1007), (160, 0)])
def test_long_holes_are_told_by_the_host(hole: int, told: int, rate_factor: float) -> None:
    """Exact within seconds, over a jittering link and with a crystal that is off; whole rounds alone leave no trace."""
    random, rounds, counted, last = np.random.default_rng(hole), Rounds(1000), 0, -1
    blocks = np.array_split(np.concatenate([np.arange(5000), np.arange(5000 + hole, 15000)]), 800)
    sent_s = np.array([block[-1] for block in blocks]) / (1000 * rate_factor)
    came_s = np.maximum.accumulate(sent_s + random.exponential(0.01, len(blocks)))
    for block, at_s in zip(blocks, came_s.tolist(), strict=True):
        lost = sum((jump - 1) % 16 for jump in np.diff(block, prepend=last).tolist())
        counted += lost + rounds.missed(len(block), lost, BEGUN_NS + round(at_s * SECOND_NS))
        last = int(block[-1])
    assert counted == told


def test_a_hole_soon_after_another_hides_nothing() -> None:
    """Five frames, and a second later a hundred: all of them are told."""
    rounds, counted = Rounds(1000), 0
    numbers = np.concatenate([np.arange(5000), np.arange(5005, 6000), np.arange(6100, 15000)])
    last = -1
    for block in np.array_split(numbers, 800):
        lost = sum((jump - 1) % 16 for jump in np.diff(block, prepend=last).tolist())
        counted += lost + rounds.missed(len(block), lost, BEGUN_NS + int(block[-1]) * 1_000_000)
        last = int(block[-1])
    assert counted == 105


def decoded(config: BitalinoConfig, device: Board, seconds: float) -> list[Item]:
    """What a driver makes of what a board sends in so many seconds, every 10 ms."""
    decoder, items = Decoder(config, streams_of(config)), []
    device.receive(protocol.set_rate(config.sampling_frequency_hz), 0.0)
    device.receive(protocol.start(tuple(channel.port for channel in config.acquired)), 0.0)
    for tick in range(1, round(seconds * 100) + 1):
        if octets := device.send(tick / 100):
            items += decoder.items(Arrival(BEGUN_NS + tick * 10_000_000, octets))
    return items


def test_a_host_clock_that_is_set_loses_no_rounds() -> None:
    """The wall clock jumps a second ahead right after five lost frames: five are told."""
    config = BitalinoConfig(sensor_id="b_1", port="/dev/x", channels=("A1: raw",))
    device, size, told = started(board(), 1), protocol.frame_bytes(1), 0
    now = iter(range(0, 10**12, 100_000_000))
    decoder = Decoder(config, streams_of(config), lambda: next(now))
    for tick in range(1, 101):
        octets, stepped_ns = device.send(tick / 10), SECOND_NS if tick > 50 else 0
        arrival = Arrival(BEGUN_NS + tick * 100_000_000 + stepped_ns, octets[5 * size :] if tick == 50 else octets)
        told += sum(item.lost or 0 for item in decoder.items(arrival) if isinstance(item, Samples))
    assert told == 5


def constant(word: str, value: float) -> Port:
    plugged = PLUGGED[word]
    return Port(plugged.stream, lambda first, count, fs: np.full(count, value), plugged.volts)


@pytest.mark.parametrize(
    ("word", "value", "of_it"),
    [
        ("ecg", 800.0, 800.0),
        ("emg", -650.0, -650.0),
        ("eeg", 12.0, 12.0),
        ("eog", 300.0, 300.0),
        ("eda", 7.25, 7.25),
        ("acc", 0.9, 0.9 * 9.80665),
        ("lux", 60.0, 60.0),
        ("tmp", 33.5, 33.5),
        ("pzt", 0.5, 100 * 0.4 / 3.3),
    ],
)
def test_values_are_in_canonical_units(word: str, value: float, of_it: float) -> None:
    """What a sensor measures comes out of it, within half a step of its converter."""
    config = BitalinoConfig(sensor_id="b_1", port="/dev/x", channels=(f"A1: {word}",))
    (stream,) = streams_of(config).values()
    step = (stream.range_max - stream.range_min) / 1023
    device = Board([constant(word, value)] * 6, Panel(), Air(1), 0.0, 1.0)
    samples = [item for item in decoded(config, device, 1.0) if isinstance(item, Samples)]
    assert samples[0].chunk.samples[0, 0] == pytest.approx(of_it, abs=0.51 * step)
    assert samples[0].chunk.device_ns is None


def test_a_button_is_a_marker_at_its_time() -> None:
    """Pressed after 0.5 s: one marker, I1 0, within a frame of that; the first level is no change."""
    panel = Panel()
    device = started(board(panel=panel), 1)
    config = BitalinoConfig(sensor_id="b_1", port="/dev/x", channels=("A1: raw",), digital_inputs=("I1", "I2"))
    decoder = Decoder(config, streams_of(config))
    found = []
    for until_s, pressed in ((0.5, False), (1.0, True)):
        panel.pressed = pressed
        octets = device.send(until_s)
        found += decoder.items(Arrival(BEGUN_NS + round(until_s * SECOND_NS), octets))
    (marker,) = [item for item in found if isinstance(item, Marked)]
    assert (marker.name, marker.value, marker.device_ns) == ("I1", "0", None)
    assert abs(marker.event_ns - BEGUN_NS - SECOND_NS // 2) <= 2_000_000


def test_channels_of_a_kind_are_one_stream() -> None:
    """Three axes are one stream in the order of the ports; each is named by its port or as it is told to."""
    channels = ("A6: acc z", "A2: emg biceps", "A1: emg", "A4: acc x", "A5: acc y")
    config = BitalinoConfig(sensor_id="b_1", port="/dev/x", channels=channels, sampling_frequency_hz=100)
    streams = streams_of(config)
    assert {name: stream.channel_names for name, stream in streams.items()} == {
        "emg": ("A1", "biceps"),
        "accelerometer": ("x", "y", "z"),
    }
    assert (streams["accelerometer"].unit, streams["accelerometer"].resolution_bits) == ("m/s^2", 10)
    counts = {item.sensor_type: item.chunk.samples.shape[1] for item in decoded(config, board(), 1.0)}
    assert counts == {"emg": 2, "accelerometer": 3}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"channels": ("A7: ecg",)}, "A7: ecg"),
        ({"channels": ("A1: egc",)}, "A1: egc"),
        ({"channels": ("A1: ecg", "A1: eda")}, "each at most once"),
        ({"channels": ("A1: emg arm", "A2: emg arm")}, "two of emg are called 'arm'"),
        ({"accelerometer_counts": (600, 400)}, "a smaller and a larger number"),
        ({"sampling_frequency_hz": 500}, "500"),
        ({"port": "ttyUSB0"}, "ttyUSB0"),
    ],
)
def test_what_cannot_be_is_refused(given: dict[str, Any], said: str) -> None:
    """A wrong parameter is a ValueError that names it."""
    with pytest.raises(ValueError, match=said):
        BitalinoConfig(**{"sensor_id": "b_1", "port": "/dev/x"} | given)


def test_a_board_that_was_left_running_is_stopped_asked_and_started(tmp_path: Path) -> None:
    """Version and battery are read from an idle board; samples follow; once the driver is closed it is idle again."""
    device = started(board(panel=Panel(battery_v=3.8)), 6)
    config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b", channels=("A1: raw",))

    async def drive() -> list[Item]:
        async with plugged(tmp_path / "b", device) as link:
            items, stream = [], Bitalino(config, streams_of(config)).stream()
            while sum(isinstance(each, Samples) for each in items) < 3:
                items.append(await anext(stream))
            await stream.aclose()
            await let_go(link)
        return items

    identity, status, *samples = asyncio.run(drive())
    assert identity == Identity(firmware_version="BITalino_v5.1")
    assert isinstance(status, Status)
    assert status.battery_percent == pytest.approx(50, abs=1)
    assert all(isinstance(each, Samples) and each.lost == 0 for each in samples)
    assert device.send(1e6) == b""


@pytest.mark.parametrize("stray", [b"\x00", b"\xff", b"B"])
def test_a_stray_byte_before_the_version_is_none_of_it(tmp_path: Path, stray: bytes) -> None:
    """The board is what its name and number say, and is asked for its battery all the same."""
    device = board()
    strewn = {protocol.VERSION: stray}
    talks = SimpleNamespace(
        receive=lambda octets, time_s: strewn.get(octets, b"") + device.receive(octets, time_s), send=device.send
    )
    config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b", channels=("A1: raw",))

    async def connect() -> list[Item]:
        async with plugged(tmp_path / "b", talks):
            stream = Bitalino(config, streams_of(config)).stream()
            items = [await anext(stream), await anext(stream)]
            await stream.aclose()
        return items

    identity, status = asyncio.run(connect())
    assert identity == Identity(firmware_version="BITalino_v5.1")
    assert isinstance(status, Status)


def test_the_event_loop_is_woken_once_for_a_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a board sends every few milliseconds is handed on once it makes a message."""
    config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b", channels=("A1: ecg",))

    async def drive() -> float:
        async with plugged(tmp_path / "b", board()):
            return await wakes_per_message(monkeypatch, Bitalino(config, streams_of(config)).stream(), "ecg")

    assert asyncio.run(drive()) < 1.5


def test_what_a_board_sent_before_it_was_unplugged_is_handed_on(tmp_path: Path) -> None:
    """Every whole frame, also those that were too few for a message."""
    config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b", channels=("A1: ecg",))
    stream = Bitalino(config, streams_of(config)).stream()
    items, sent = asyncio.run(until_unplugged(tmp_path / "b", board(), stream))
    came = sum(len(item.chunk.samples) for item in items if isinstance(item, Samples))
    assert came == len(sent) // protocol.frame_bytes(1)


def test_a_board_that_does_not_hear_the_stop_is_named_as_what_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It goes on sending: it is not taken for another device because of what it sends."""
    monkeypatch.setattr(transport, "QUIET_S", 1.5)  # on a busy machine the emulator itself pauses for 0.3 s
    config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b", channels=("A1: ecg",))
    device = started(board(), 1)
    deaf = SimpleNamespace(receive=lambda octets, time_s: b"", send=device.send)

    async def drive() -> None:
        async with plugged(tmp_path / "b", deaf):
            await anext(Bitalino(config, streams_of(config)).stream())

    with pytest.raises(DeviceLost, match="goes on sending after it was stopped"):
        asyncio.run(drive())


def test_something_else_on_the_port_is_named(tmp_path: Path) -> None:
    """What answers nothing is no BITalino, or not switched on, and the driver says so."""

    class Mute:
        def send(self, time_s: float) -> bytes:
            return b""

        def receive(self, octets: bytes, time_s: float) -> bytes:
            return b""

    async def drive() -> None:
        async with plugged(tmp_path / "b", Mute()):
            config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b")
            with pytest.raises(DeviceLost, match="is it a BITalino, and switched on"):
                await anext(Bitalino(config, streams_of(config)).stream())

    asyncio.run(drive())


def seconds_of(octets: bytes, channels: int, random: np.random.Generator) -> list[bytes]:
    """As they come off a link: pieces of any length, also of a part of a frame."""
    cuts = np.sort(random.integers(0, len(octets), len(octets) // (20 * protocol.frame_bytes(channels))))
    return [each.tobytes() for each in np.split(np.frombuffer(octets, np.uint8), cuts)]


def flipped(octets: bytes, share: float, random: np.random.Generator) -> bytes:
    bits = np.unpackbits(np.frombuffer(octets, np.uint8))
    return np.packbits(bits ^ (random.random(len(bits)) < share)).tobytes()


def cut_and_doubled(octets: bytes, size: int, random: np.random.Generator) -> bytes:
    """One frame in 50 without its end, one in 50 twice."""
    frames = [octets[at : at + size] for at in range(0, len(octets), size)]
    kinds = random.integers(0, 50, len(frames)).tolist()
    return b"".join(
        {0: frame[: random.integers(size)], 1: 2 * frame}.get(kind, frame)
        for kind, frame in zip(kinds, frames, strict=True)
    )


def through(octets: bytes, channels: int, seed: int = 0) -> tuple[np.ndarray, int, int]:
    """The samples that come of it, what is said to be missing, and the most bytes that ever waited."""
    random, frames, buffer = np.random.default_rng(seed), Frames(channels), bytearray()
    runs, most = [Run(0, np.empty((0, 4), int), np.empty((0, channels), int))], 0
    for piece in seconds_of(octets, channels, random):
        buffer += piece
        runs += [each for each in frames.take(buffer) if isinstance(each, Run)]
        most = max(most, len(buffer))
    return np.concatenate([run.counts for run in runs]), sum(run.lost for run in runs), most


@pytest.mark.parametrize("channels", [1, 4, 6])
def test_bad_air_is_counted_and_over_with_the_first_good_frames(channels: int) -> None:
    """A bit in 1000 wrong, frames cut and doubled: came + counted is what was sampled, and what comes is right."""
    random, size = np.random.default_rng(channels), protocol.frame_bytes(channels)
    octets = started(board(), channels).send(2.0)
    first, bad, broken, last = (octets[at * size : (at + 500) * size] for at in range(0, 2000, 500))
    air = first + flipped(bad, 0.001, random) + cut_and_doubled(broken, size, random) + last
    came, lost, most = through(air, channels)
    assert len(came) + lost == 2000
    assert most < protocol.CONFIRM * size
    np.testing.assert_array_equal(came[-490:], wanted(channels, 2000)[-490:])


@pytest.mark.parametrize("channels", [2, 4, 6])
def test_a_wrong_frame_passes_by_the_chance_of_its_crc_alone(channels: int) -> None:
    """A bit in 100 wrong, which spoils every second or third frame: at most 1 of 16 of those comes as a sample."""
    random, size = np.random.default_rng(channels), protocol.frame_bytes(channels)
    octets = started(board(), channels).send(1.0)
    spoilt = flipped(octets, 0.01, random)
    came, _, _ = through(spoilt, channels)
    right = {tuple(row) for row in wanted(channels, 1024).tolist()}
    wrong = sum(tuple(row) not in right for row in came.tolist())
    hit = sum(octets[at : at + size] != spoilt[at : at + size] for at in range(0, len(octets), size))
    assert hit > 100
    assert wrong <= hit / 16
    assert len(came) > 0.8 * (1000 - hit)


@pytest.mark.parametrize("channels", [1, 6])
def test_noise_is_no_frame_and_holds_nobody_up(channels: int) -> None:
    """50 kB in one read: next to nothing of it is a sample, nothing is kept, and good frames are known at once."""
    random, size = np.random.default_rng(channels), protocol.frame_bytes(channels)
    octets = started(board(), channels).send(0.4)
    frames, buffer = Frames(channels), bytearray(octets[: 200 * size] + random.bytes(50_000) + octets[200 * size :])
    came = np.concatenate([each.counts for each in frames.take(buffer) if isinstance(each, Run)])
    assert 395 <= len(came) <= 410
    np.testing.assert_array_equal(came[-190:], wanted(channels, 400)[-190:])
    assert len(buffer) < protocol.CONFIRM * size


def test_bad_air_that_was_held_up_is_read_piece_by_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search costs what a few frames do, however many wait: a stalled host is not kept busy for seconds."""
    looked_at, crc_fits = list[int](), protocol.crc_fits
    monkeypatch.setattr(protocol, "crc_fits", lambda frames: looked_at.append(len(frames)) or crc_fits(frames))
    octets = flipped(started(board(), 6).send(2.0), 0.01, np.random.default_rng(1))
    for _ in Frames(6).take(bytearray(octets)):
        pass
    assert max(looked_at) < len(octets) / 20


@pytest.mark.parametrize(
    ("answer", "known_as", "has_state"),
    [
        (b"BITalino_v10.2\r\n", "BITalino_v10.2", True),
        (b"BITalino_v5.1\0\x1b\n", "BITalino_v5.1", True),
        (b"BITalino_v4.2\n", "BITalino_v4.2", False),
        (b"v5\n", "calls itself 'v5'", False),
        (b"BITalino" * 20, "it answers b'BITalinoBITalino", False),
    ],
)
def test_what_a_board_may_call_itself(tmp_path: Path, answer: bytes, known_as: str, has_state: bool) -> None:
    """Any number of its firmware, with whatever stands beside it; a name too short or too long is another device's."""
    device = board()

    def receive(octets: bytes, time_s: float) -> bytes:
        return answer if octets == protocol.VERSION else device.receive(octets, time_s)

    config = BitalinoConfig(sensor_id="b_1", port=f"{tmp_path}/b", channels=("A1: raw",))

    async def connect() -> list[Item]:
        async with plugged(tmp_path / "b", SimpleNamespace(receive=receive, send=device.send)):
            stream = Bitalino(config, streams_of(config)).stream()
            items = [await anext(stream), await anext(stream)]
            await stream.aclose()
        return items

    if "BITalino" not in known_as or " " in known_as:
        with pytest.raises(DeviceLost, match=known_as):
            asyncio.run(connect())
        return
    identity, second = asyncio.run(connect())
    assert identity == Identity(firmware_version=known_as)
    assert isinstance(second, Status) is has_state
