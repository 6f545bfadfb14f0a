"""sensor-bench: what LSL senders take of a signal, what their keys must be; their outlets are in tests/graph."""

import asyncio
from itertools import pairwise

import numpy as np
import pytest
from sense4hri.signal_files.content import UnreadableFileError
from sensor_bench.clock import HostClock
from sensor_bench.config import parse
from sensor_bench.lsl.feeds import ELECTRODES, EcgFeed, EegFeed, GazeFeed, within
from sensor_bench.lsl.kind import LSL
from sensor_bench.lsl.recording import RecordedFeed
from sensor_bench.room import Room
from sensor_bench.signals.hearts import Heart
from signal_file_makers import xdf

FEEDS = {
    "ecg": lambda: EcgFeed("a", "b", 500.0, Heart(1), 1),
    "eeg": lambda: EegFeed("a", "b", 250.0, 8, 1),
    "gaze": lambda: GazeFeed("a", "b", 60.0, Heart(1), 1),
}


def devices(text):
    return parse(f"participants: {{p1: {{}}}}\ndevices: [{{sensor: a, participant: p1, {text}}}]").devices


@pytest.mark.parametrize("make", FEEDS.values(), ids=FEEDS)
def test_a_signal_does_not_depend_on_how_it_is_cut(make):
    """Ten seconds at once are ten seconds in spans of odd lengths."""
    whole, edges = make().taken(0.0, 10.0)[0], [0.0, 0.013, 1.7, 1.7, 5.2004, 10.0]
    feed = make()
    parts = [t for a, b in pairwise(edges) for t in feed.taken(a, b) if t.outlet == 0]
    assert np.array_equal(np.concatenate([part.times_s for part in parts]), whole.times_s)
    assert np.allclose(np.concatenate([part.rows for part in parts]), whole.rows)


@pytest.mark.parametrize("rate_hz", [1 / 2.0, 60.0, 250.0, 500.0])
def test_no_sample_is_taken_twice_or_left_out(rate_hz):
    """Spans that touch hold each number once."""
    numbers = np.concatenate([within(at / 50, (at + 1) / 50, rate_hz) for at in range(500)])
    assert np.array_equal(numbers, np.arange(len(numbers)))
    assert len(numbers) == int(10 * rate_hz)


def test_what_outlets_say_of_themselves_fits_what_they_send():
    """As many channels are described as sent; a full EEG has 32 different electrodes."""
    assert len(set(ELECTRODES)) == 32
    for make in FEEDS.values():
        feed = make()
        assert len(feed.types) == len(feed.outlets)
        for taken in feed.taken(0.0, 4.0):
            assert {len(row) for row in taken.rows} == {len(feed.outlets[taken.outlet].channels)}


def test_a_sender_is_a_model_like_others():
    """Its keys are strict."""
    (eeg,) = devices("model: LslEeg, channels: 32, rate_hz: 500")
    assert isinstance(eeg, LSL.keys)
    assert (eeg.channels, eeg.rate_hz) == (32, 500.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model: LslEeg, channels: 33", "channels"),
        ("model: LslRecording", "file"),
        ("model: LslRecording, file: /nowhere.xdf", "no such file"),
        ("model: LslEcg, file: x.xdf", "file"),
        ("model: LslEcg, address: x", "address"),
    ],
)
def test_what_a_sender_cannot_be_is_told(text, message):
    """With the key that is wrong."""
    with pytest.raises(ValueError, match=message):
        devices(text)


@pytest.mark.parametrize("clock_s", [None, 100.0])
def test_a_machine_that_is_off_stays_off(clock_s, monkeypatch):
    """`drop` and `clock_reset` start none that `down` has switched off."""
    monkeypatch.setattr("sensor_bench.lsl.sender.REBOOT_S", 0.0)
    host = HostClock()
    room = Room({"p1": None}, 1, host, host.now_ns(), None, None, {"p1": Heart(1)})
    sender = LSL.make(room, LSL.keys(sensor="lsl_1", model="LslEcg", participant="p1"))

    async def play():
        await sender.switch(True)
        await sender.restart(clock_s)
        await sender.stop()

    asyncio.run(play())
    assert (sender.down, sender.starts_total) == (True, 0)


def test_a_recording_whose_markers_never_came_is_played(tmp_path):
    """LabRecorder keeps every stream that was ticked: the one without a sample is offered, and sends nothing."""
    feed = RecordedFeed(xdf(tmp_path / "a.xdf", 100.0, ("C3", "C4"), np.ones((200, 2)), []), start_s=1.0)
    assert [len(track.stamps_s) for track in feed.parts[0]] == [100, 0]
    assert [outlet.name for outlet in feed.outlets] == ["EEG", "Markers"]


def test_a_recording_without_any_sample_is_told(tmp_path):
    """It says so, as any file that cannot be played."""
    with pytest.raises(UnreadableFileError, match="no stream of it has a sample"):
        RecordedFeed(xdf(tmp_path / "a.xdf", 100.0, ("C3",), np.ones((0, 1)), []), start_s=0.0)


def test_a_recorded_outlet_has_the_channels_that_it_sends(tmp_path):
    """Also those that its description does not label."""
    path = xdf(tmp_path / "a.xdf", 100.0, ("C3", "C4", "Cz"), np.ones((10, 3)), [])
    last = b"<channel><label>Cz</label><unit>microvolts</unit></channel>"
    path.write_bytes(path.read_bytes().replace(last, b" " * len(last)))
    feed = RecordedFeed(path, start_s=0.0)
    assert feed.parts[0][0].rows.shape[1] == 3
    assert feed.outlets[0].channels == (("C3", "microvolts", ""), ("C4", "microvolts", ""), ("", "", ""))
