"""BrainFlow's own boards through the driver's device: a recording made here played back, and the synthetic one."""

import asyncio
import gc
import threading
import time
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from driver_brainflow.config import BrainflowConfig, streams_of
from driver_brainflow.device import Board
from driver_brainflow.transport import Rows, Session, description
from sense4hri.device import Declared, Identity, Marked, Samples, Status
from sense4hri.errors import ConfigError, DeviceLost
from sensor_bench.shimmer.body import Body
from sensor_bench.shimmer.firmware import Memory, VirtualShimmer
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.skin import Skin
from sensor_bench.signals.sources import Wearing
from sensor_bench.signals.waveforms import stored
from sensor_bench.wire import Pty

FS_HZ, SAMPLES, BEGUN_S = 250.0, 600, 1_700_000_000.0
LOST = range(200, 203)
MARKED = 400


def board(name: str, **given) -> Board:
    config = BrainflowConfig(sensor_id="it_1", board=name, poll_s=0.02, **given)
    return Board(config, streams_of(config))


async def taken(device: Board, enough) -> list:
    """Return what the device yields until there is enough."""
    items = []
    stream = device.stream()
    async with asyncio.timeout(20):
        async for item in stream:
            items.append(item)
            if enough(items):
                break
    await stream.aclose()
    return items


def samples_of(items: list, sensor_type: str) -> list[Samples]:
    return [item for item in items if isinstance(item, Samples) and item.sensor_type == sensor_type]


def count(items: list, sensor_type: str) -> int:
    return sum(len(item.chunk.samples) for item in samples_of(items, sensor_type))


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> tuple[Path, np.ndarray]:
    """A Cyton's file as BrainFlow's streamer writes it, three samples missing in it; its rows as a table."""
    table = description("CYTON")["default"]
    index = np.arange(SAMPLES)
    rows = np.zeros((table["num_rows"], SAMPLES))
    rows[table["package_num_channel"]] = index % 256
    rows[table["eeg_channels"]] = np.sin(index / 9) * 100 + np.arange(8)[:, None]
    rows[table["accel_channels"]] = np.arange(3)[:, None] - 1 + index / 1000
    rows[table["timestamp_channel"]] = BEGUN_S + index / FS_HZ
    rows[table["marker_channel"], MARKED] = 7
    rows = np.delete(rows, LOST, axis=1)
    path = tmp_path_factory.mktemp("brainflow") / "cyton.csv"
    path.write_text("".join("\t".join(f"{value:.6f}" for value in row) + "\n" for row in rows.T))
    return path, np.loadtxt(path).T


@pytest.fixture(scope="module")
def played(recording) -> list:
    """Everything the recording yields, with its own times."""
    device = board("PLAYBACK_FILE", master_board="CYTON", file=str(recording[0]))
    return asyncio.run(taken(device, lambda items: count(items, "accelerometer") == SAMPLES - len(LOST)))


def test_a_recording_comes_back_exactly(recording, played):
    """Every sample once and in order: EEG in uV as recorded, acceleration times the standard gravity."""
    table = description("CYTON")["default"]
    eeg = np.concatenate([each.chunk.samples for each in samples_of(played, "eeg")])
    accelerometer = np.concatenate([each.chunk.samples for each in samples_of(played, "accelerometer")])
    assert np.array_equal(eeg, recording[1][table["eeg_channels"]].T)
    assert np.array_equal(accelerometer, recording[1][table["accel_channels"]].T * 9.80665)


def test_a_recordings_own_times_are_device_times(recording, played):
    """Each frame has the recorded time of its last sample, and a receipt that is now."""
    ends = np.cumsum([len(each.chunk.samples) for each in samples_of(played, "eeg")]) - 1
    recorded_s = recording[1][description("CYTON")["default"]["timestamp_channel"]]
    times_s = [each.chunk.device_ns / 1e9 for each in samples_of(played, "eeg")]
    assert np.allclose(times_s, recorded_s[ends], atol=2e-6, rtol=0)
    assert all(abs(each.chunk.received_ns - time.time_ns()) < 60e9 for each in samples_of(played, "eeg"))


def test_what_is_missing_in_a_recording_is_told_where_it_is(played):
    """Three numbers are missing: the frame that begins after them says three, no other says any."""
    lost = [(each.lost, each.chunk.device_ns) for each in samples_of(played, "eeg") if each.lost]
    assert [n for n, _ in lost] == [3]
    begun = next(each for each in samples_of(played, "eeg") if each.lost).chunk
    assert begun.samples[0, 0] == pytest.approx(np.sin(203 / 9) * 100, abs=1e-5)


def test_a_marker_channel_becomes_a_marker(recording):
    """A number in BrainFlow's marker channel is a marker of the study, at the time of its sample.

    Read here without BrainFlow, whose playback puts zeros there.
    """
    reader = board("PLAYBACK_FILE", master_board="CYTON", file="-")._reader("default", FS_HZ)
    (marked,) = [item for item in reader.items(recording[1], 1, 1.0) if isinstance(item, Marked)]
    assert (marked.name, marked.value) == ("marker", "7")
    assert marked.device_ns == pytest.approx((BEGUN_S + MARKED / FS_HZ) * 1e9, abs=2000)


def test_a_battery_that_the_board_has_not_told_yet_is_no_empty_one():
    """BrainFlow's row of it holds 0 until the board sends its charge: a Muse S Athena every 10 s, an EmotiBit never."""
    table = description("MUSE_S_ATHENA")["ancillary"]
    reader, rows = board("MUSE_S_ATHENA")._reader("ancillary", 64.0), np.zeros((table["num_rows"], 2))
    assert not [item for item in reader.items(rows, 1, 1.0) if isinstance(item, Status)]
    rows[table["battery_channel"]] = 0, 83
    assert [item for item in reader.items(rows, 1, 1.2) if isinstance(item, Status)] == [Status(battery_percent=83.0)]


@pytest.mark.parametrize(("behind_s", "is_receipt"), [(0.05, True), (60.0, False), (-60.0, False)])
def test_what_is_fetched_late_is_stamped_as_it_came(behind_s, is_receipt):
    """A poll a second after the last one, or a stall: a marker and a loss at its beginning keep their own stamps.

    Stamps of a board's own clock, by which the newest sample came long ago or has not come yet, are no receipts.
    """
    table, received_s = description("CYTON")["default"], 1_700_000_000.0
    numbers = np.delete(np.arange(376), 10)
    rows = np.zeros((table["num_rows"], len(numbers)))
    rows[table["package_num_channel"]] = numbers % 256
    rows[table["timestamp_channel"]] = stamps_s = received_s - behind_s - (375 - numbers) / FS_HZ
    rows[table["marker_channel"], 2] = 7
    items = list(board("CYTON", serial_port="-")._reader("default", FS_HZ).items(rows, int(received_s * 1e9), 1.0))
    (marker,) = [item.event_ns for item in items if isinstance(item, Marked)]
    stamps = [marker, *(each.chunk.received_ns for each in samples_of(items, "eeg"))]
    assert stamps == pytest.approx(
        [s * 1e9 for s in stamps_s[[2, 9, -1]]] if is_receipt else [received_s * 1e9] * 3, 1e-15
    )


def test_played_as_if_live_it_has_no_device_time(recording):
    """With new stamps the playback is a board like any other: no clock, stamped on this host when it came."""
    device = board("PLAYBACK_FILE", master_board="CYTON", file=str(recording[0]), recorded_times=False)
    begun_ns = time.time_ns()
    items = asyncio.run(taken(device, lambda items: count(items, "eeg") >= 100))
    assert all(item.chunk.device_ns is None for item in samples_of(items, "eeg"))
    assert all(begun_ns <= item.chunk.received_ns <= time.time_ns() for item in samples_of(items, "eeg"))


def test_the_synthetic_board_streams_again_and_again():
    """Each connection gives all sixteen electrodes, nothing missing, no device time, the battery; then lets go."""
    device = board("SYNTHETIC", streams=("eeg", "accelerometer", "temperature"))
    for _ in range(2):
        items = asyncio.run(taken(device, lambda items: count(items, "temperature") >= 100))
        assert isinstance(items[0], Identity)
        assert {item.sensor_type for item in items if isinstance(item, Samples)} == {
            "eeg",
            "accelerometer",
            "temperature",
        }
        assert all(item.chunk.samples.shape[1] == 16 for item in samples_of(items, "eeg"))
        assert {(item.chunk.device_ns, item.lost) for item in samples_of(items, "eeg")} == {(None, 0)}
        assert any(isinstance(item, Status) and 0 <= item.battery_percent <= 100 for item in items)


def test_an_attempt_that_ends_late_does_not_let_go_of_what_a_later_one_opened():
    """BrainFlow knows a board by its name and inputs alone: who did not open it, or has let go of it, leaves it."""
    presets = ("default",)
    config = BrainflowConfig(sensor_id="it_1", board="SYNTHETIC")
    early, later, last = (Session(config.board, config.inputs, (), config.verbose) for _ in range(3))
    early.open(presets)
    early.close(lost=False)
    later.open(presets)
    try:
        with pytest.raises(DeviceLost):
            last.open(presets)
        last.close(lost=False)
        early.close(lost=False)
        assert any(later.read(presets, 0.05) for _ in range(100))
    finally:
        later.close(lost=False)


def test_an_attempt_that_is_forgotten_leaves_what_a_later_one_opened():
    """BrainFlow's Python object releases its board's session when it is collected, whoever opened it by then."""
    presets = ("default",)
    config = BrainflowConfig(sensor_id="it_1", board="SYNTHETIC")
    early, later = (Session(config.board, config.inputs, (), config.verbose) for _ in range(2))
    later.open(presets)
    try:
        del early
        gc.collect()
        assert any(later.read(presets, 0.05) for _ in range(100))
    finally:
        later.close(lost=False)


def test_a_search_that_never_ends_ends_the_driver(monkeypatch):
    """BrainFlow's own Bluetooth can wait for itself; a driver that is started again searches anew."""
    free = threading.Event()
    monkeypatch.setattr("driver_brainflow.device.OPEN_S", 0.05)
    monkeypatch.setattr("driver_brainflow.device.SLOW_S", 0.05)
    monkeypatch.setattr(Session, "open", lambda self, presets: free.wait(60))
    try:
        with pytest.raises(RuntimeError, match=r"neither found SYNTHETIC nor given up in 0\.05 s"):
            asyncio.run(taken(board("SYNTHETIC"), len))
    finally:
        free.set()


def test_a_board_whose_count_means_nothing_known_loses_an_unknown_number(recording):
    """Where BrainFlow's number is not established, `lost` is None, never 0."""
    device = board("PLAYBACK_FILE", master_board="CYTON_DAISY_WIFI", file=str(recording[0]))
    assert device._reader("default", FS_HZ)._missing is None


@asynccontextmanager
async def shimmer(path: Path, carry=lambda packet, **_: packet):
    """A virtual Shimmer3 at 64 Hz, of skin conductance and ECG, on a serial port; gives the port."""
    body, begun_s = Body(Heart(1), Skin(1), stored(), Wearing()), time.monotonic()
    virtual = VirtualShimmer(body, Memory(divider=512, sensors=0x00001C, gsr_range=4), carry)
    wire = Pty(path, lambda octets: wire.write(virtual.receive(octets, time.monotonic() - begun_s)))

    async def send() -> None:
        while True:
            await asyncio.sleep(0.02)
            wire.write(virtual.send(time.monotonic() - begun_s))

    wire.plug()
    sending = asyncio.create_task(send())
    try:
        yield str(path.resolve())
    finally:
        sending.cancel()
        wire.unplug()


def test_a_board_that_samples_at_another_rate_than_its_table_s_is_declared_at_its_own(tmp_path):
    """A Shimmer3 keeps its rate, and `commands` may set one: BrainFlow's table says 512 Hz, this one does 64 or 128.

    So what the study says is held against that rate, not the table's. Its electrodes' counts come as the converter
    sent them.
    """
    assert BrainflowConfig(sensor_id="it_1", board="SHIMMER3").asks_rates
    sent: list[int] = []

    def carry(packet: bytes, **_: int) -> bytes:
        sent.append(int.from_bytes(packet[7:10], "big", signed=True))
        return packet

    async def listen(commands: tuple[str, ...]) -> list:
        async with shimmer(tmp_path / "shimmer", carry) as port:
            device = board("SHIMMER3", serial_port=port, streams=("ecg", "eda"), commands=commands)
            return await taken(device, lambda items: count(items, "eda") >= 10)

    for commands, rate_hz in (((), 64.0), (("sampling_rate:128",), 128.0)):
        sent.clear()
        items = asyncio.run(listen(commands))
        assert isinstance(items[1], Declared)
        assert {name: each.sampling_frequency_hz for name, each in items[1].streams.items()} == {
            "ecg": rate_hz,
            "eda": rate_hz,
        }
        came = np.concatenate([each.chunk.samples[:, 0] for each in samples_of(items, "ecg")])
        assert came.tolist() == sent[: len(came)]


def test_a_command_that_a_board_refuses_is_said_as_that(tmp_path):
    """The parameter and the command, not how the board is connected."""

    async def listen() -> None:
        async with shimmer(tmp_path / "shimmer") as port:
            await taken(board("SHIMMER3", serial_port=port, commands=("louder",)), bool)

    with pytest.raises(ConfigError, match="commands: SHIMMER3 refuses 'louder'"):
        asyncio.run(listen())


@pytest.mark.parametrize(
    ("name", "given", "failure", "said"),
    [
        ("CYTON", {}, ConfigError, "serial_port"),
        ("CYTON", {"serial_port": "/dev/there_is_none"}, DeviceLost, "cannot be opened"),
        ("CALLIBRI_EEG", {}, ConfigError, "not support this board on this system"),
        ("PLAYBACK_FILE", {"master_board": "CYTON", "file": "/there/is/none.csv"}, ConfigError, "file"),
    ],
)
def test_what_keeps_from_connecting_is_said_in_words(name, given, failure, said):
    """Neither a bare number of BrainFlow's nor a traceback: the parameter, or what to look at."""
    with pytest.raises(failure, match=said):
        asyncio.run(taken(board(name, **given), bool))


def test_a_muse_is_missed_sooner_once_it_has_sent(monkeypatch):
    """Its first samples may take as long as any board's; a shorter silence later is enough to close it as lost."""
    table, closed = np.zeros((description("MUSE_2")["default"]["num_rows"], 12)), []
    yielded: list = []
    reads = iter([(1.0, True)] + [(0.02, False)] * 500)

    def read(self, presets, wait_s):
        waited_s, came = next(reads)
        time.sleep(waited_s)
        return [Rows("default", table, time.monotonic())] if came else None

    monkeypatch.setattr("driver_brainflow.device.SILENCE_S", 5.0)
    monkeypatch.setattr("driver_brainflow.device.MUSE_SILENCE_S", 0.3)
    monkeypatch.setattr(Session, "open", lambda self, presets: dict.fromkeys(presets, 256.0))
    monkeypatch.setattr(Session, "read", read)
    monkeypatch.setattr(Session, "close", lambda self, lost: closed.append(lost))
    with pytest.raises(DeviceLost, match=r"no samples for 0\.3 s"):
        asyncio.run(taken(board("MUSE_2"), lambda items: yielded.append(items[-1])))
    assert isinstance(yielded[-1], Samples)
    assert closed == [True]


def test_a_file_that_has_ended_stays_lost(recording, monkeypatch):
    """A playback that falls silent is over; it is not played again as if it were new."""
    monkeypatch.setattr("driver_brainflow.device.SILENCE_S", 0.3)
    device = board("PLAYBACK_FILE", master_board="CYTON", file=str(recording[0]))
    with pytest.raises(DeviceLost, match=r"no samples for 0\.3 s"):
        asyncio.run(taken(device, lambda items: False))
    with pytest.raises(DeviceLost, match="has ended"):
        asyncio.run(taken(device, bool))
