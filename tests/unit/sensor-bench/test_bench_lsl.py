"""sensor-bench: what LSL senders take of a signal, what their keys must be; their outlets are in tests/graph."""

from itertools import pairwise

import numpy as np
import pytest
from sensor_bench.config import parse
from sensor_bench.lsl.feeds import ELECTRODES, EcgFeed, EegFeed, GazeFeed, within
from sensor_bench.lsl.kind import LSL
from sensor_bench.signals.hearts import Heart

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
