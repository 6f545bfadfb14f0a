"""A recording opened as tables: what is in it lies where it happened."""

import numpy as np
import pandas as pd
import pytest
import sense4hri_session
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from sense4hri_session.seen import Seen

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
SHORTEST_DELAY_NS = 20_000_000


@pytest.fixture(scope="module")
def session(recording):
    return sense4hri_session.open(recording)


def test_two_lines_give_a_frame(recording):
    """`open(path)` and `session[key].frame()` give all samples with a UTC index."""
    session = sense4hri_session.open(recording)
    frame = session["p1/ecg/h10_1"].frame()
    assert list(frame.columns) == ["ecg", "device_time_ns", "received_ns", "segment"]
    assert str(frame.index.dtype) == "datetime64[ns, UTC]"
    assert len(frame) == session["p1/ecg/h10_1"].seen.samples
    assert sorted(session.streams) == ["p1/accelerometer/h10_1", "p1/ecg/h10_1", "p1/ppg/verity_1", "p2/eda/e4_1"]
    assert session.humans == ["p1", "p2"]
    assert session["p1/ecg/h10_1"].unit == "uV"


@pytest.mark.parametrize(("key", "rate", "frame"), [("p1/ecg/h10_1", 130.1, 13), ("p1/ppg/verity_1", 55.0, 11)])
def test_samples_lie_where_they_were_taken(session, key, rate, frame):
    """The corrected time of every sample is within 1 ms of the truth, the link's shortest delay apart."""
    time_ns, _ = session[key].arrays()
    samples = np.arange(int(90 * rate / frame) * frame) + 1
    true_s = samples / rate
    last = true_s.reshape(-1, frame)[:, -1]
    if "ecg" in key:
        true_s = true_s.reshape(-1, frame)[~((last >= 40) & (last < 45))].ravel()
    error_ms = (time_ns - START_NS - SHORTEST_DELAY_NS) * 1e-6 - true_s * 1e3
    assert np.abs(error_ms).max() < 1.0


def test_both_raw_stamps_are_kept(session, recording):
    """The last sample of a message has its device stamp, and all of it the header's stamp, as others read them."""
    frame = session["p1/ecg/h10_1"].frame()
    ends = frame.groupby("received_ns", sort=False).tail(1)
    with AnyReader([recording]) as reader:
        connections = [c for c in reader.connections if c.topic.endswith("ecg/h10_1/raw")]
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    stamps = [[m.sec * SECOND + m.nanosec for m in (x.header.stamp, x.device_timestamp)] for x in messages]
    assert ends[["received_ns", "device_time_ns"]].to_numpy(np.int64).tolist() == stamps
    assert np.concatenate([m.channels[0].samples for m in messages]).tolist() == frame["ecg"].tolist()


def test_a_stream_without_device_time_is_smoothed_over_receipt(session):
    """Without device time there is no segment and no device stamp, and the sample times still do not jitter."""
    frame = session["p2/eda/e4_1"].frame()
    assert frame["device_time_ns"].isna().all()
    assert (frame["segment"] == 0).all()
    steps = frame.index.to_series().diff().dt.total_seconds().dropna()[40:]
    assert steps.between(0.24, 0.26).all()


def test_peaks_are_on_the_peaks(session):
    """Events of the features message are in corrected time: each lies on a maximum of the exported signal."""
    events = session.events("p1/ecg/h10_1")
    time_ns, samples = session["p1/ecg/h10_1"].arrays()
    inside = [t for t in events["time_ns"] if time_ns[0] < t < time_ns[-1] and np.abs(time_ns - t).min() < 8e6]
    heights = np.interp(inside, time_ns, samples[:, 0])
    assert len(inside) > 80
    assert heights.min() > 950
    assert (events["event"] == "r_peak").all()
    assert (events["rr_intervals_ms"] == 800).all()


def test_markers_states_and_the_rest(session):
    """Markers lie at their header's stamp; states, expressions, assignments and the session are tables."""
    markers = session.markers
    assert ((markers["time_ns"] - START_NS) / SECOND).tolist() == [10.5, 30.25, 60.0]
    assert markers["value"].tolist() == ["", "image 7", "ä"]
    assert set(session.states["state"]) == {"calm_relaxed"}
    assert set(session.expressions["expression"]) == {"happy", "neutral"}
    assert session.assignments[["sensor_id", "human_id"]].to_numpy().tolist() == [["h10_1", "p1"]]
    assert session.info["task"] == "rest"
    assert session.clock_models.empty
    assert session.features("p1/ecg/h10_1")["reasons"].iloc[0] == "hrv needs 30 s"


def test_sensors_of_one_device_share_its_clock(session):
    """The strap's two streams have one fit, and its skew is the device's within 2 ppm."""
    assert session["p1/ecg/h10_1"].clock is session["p1/accelerometer/h10_1"].clock
    segment = session.clocks["h10_1"].segments[0]
    assert segment.skew_ppm() == pytest.approx(-40, abs=2)
    assert session.clocks["verity_1"].segments[0].skew_ppm() == pytest.approx(70, abs=2)


def test_reading_needs_the_memory_of_one_table(session):
    """`tables(rows)` gives pieces of that size which together are the whole frame."""
    pieces = list(session["p1/ecg/h10_1"].tables(1000))
    assert max(map(len, pieces)) < 1100
    whole = pd.concat(pieces)
    assert whole["ecg"].tolist() == session["p1/ecg/h10_1"].frame()["ecg"].tolist()


def test_mcap_reads_the_same(session, recording):
    """mcap-ros2-support and this package agree on every feature message."""
    with next(recording.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        theirs = [m.heart_rate_bpm for _, _, _, m in reader.iter_decoded_messages() if hasattr(m, "heart_rate_bpm")]
    ours = [*session.features("p1/ecg/h10_1")["heart_rate_bpm"], *session.states["heart_rate_bpm"]]
    assert sorted(ours) == sorted(theirs)


def test_a_stream_is_shown_in_a_line(session):
    """Whoever looks at `session.streams` sees what there is, not every stamp of it."""
    assert repr(session["p1/ecg/h10_1"]) == "<Stream p1/ecg/h10_1: ecg; 130.095 Hz; unit uV>"


def test_a_missing_stream_is_named(session):
    """A wrong key says what there is."""
    with pytest.raises(KeyError, match=r"p9/ecg/x.*p1/ecg/h10_1"):
        session["p9/ecg/x"]


def test_channels_may_change(study):
    """A stream that changes its channels mid-session has all of them, empty where they were not sent."""
    for i in range(40):
        names = ["a", "b"] if i < 20 else ["b", "c"]
        at = START_NS + i * SECOND // 10
        study.raw("p1/eeg/x_1", at, i * SECOND // 10 + SECOND, {n: np.arange(10.0) + ord(n) for n in names})
    session = sense4hri_session.open(study.write())
    stream = session["p1/eeg/x_1"]
    frame = stream.frame()
    assert stream.channels == ("a", "b", "c")
    assert len(stream.seen.channel_sets) == 2
    assert "p1/eeg/x_1 came with 2 sets of channels (a, b; b, c)" in session.notes[0]
    assert frame["a"].isna().sum() == frame["c"].isna().sum() == 200
    assert frame["b"].notna().all()


def test_a_reboot_opens_a_segment(study):
    """Device time that goes back begins a second segment; both lie on one timeline without a jump."""
    for i in range(600):
        epoch = 50 * SECOND if i < 300 else 0
        at = i * SECOND // 10
        study.raw("p1/ecg/x_1", START_NS + at, SECOND + at % (30 * SECOND) + epoch, {"ecg": np.zeros(13)})
    stream = sense4hri_session.open(study.write())["p1/ecg/x_1"]
    frame = stream.frame()
    assert frame["segment"].unique().tolist() == [1, 2]
    assert frame.index.to_series().diff().dt.total_seconds().iloc[1:].between(0.005, 0.011).all()


def bursts(hz, together, seconds=120.0, counts=1):
    """Receipt stamps of messages that come so many at once, 50 us apart."""
    number = np.arange(int(seconds * hz / counts))
    sent_s = (number // together + 1) * together * counts / hz
    return START_NS + np.rint((sent_s + (number % together) * 5e-5) * SECOND).astype(np.int64)


@pytest.mark.parametrize("together", [1, 3, 8])
def test_a_rate_by_receipt_is_that_of_the_samples_however_they_come_together(together):
    """100 Hz in bursts measure 100 Hz, also over a pause of ten minutes, a stall of 3 s and a clock set back."""
    received = bursts(100.0, together)
    for at, step_s in ((4000, 600.0), (6000, 3.0), (8000, -5.0)):
        received[at:] += round(step_s * SECOND)
    seen = Seen([0] * len(received), received.tolist(), [1] * len(received))
    assert seen.rate_hz() == pytest.approx(100.0, rel=3e-3)  # of the burst before a pause one step is left out


def test_a_slow_rate_by_receipt_is_measured():
    """One sample in ten seconds, with a pause of ten minutes, is 0.1 Hz."""
    received = START_NS + np.arange(60) * 10 * SECOND
    received[30:] += 600 * SECOND
    assert Seen([0] * 60, received.tolist(), [1] * 60).rate_hz() == pytest.approx(0.1)


def test_a_device_stamp_that_is_missing_costs_the_rate_nothing():
    """130 Hz in device time, one of 200 stamps zero and all received in bursts, measures 130 Hz."""
    received = bursts(130.0, 8, counts=13)
    device = (np.arange(len(received)) + 10) * SECOND // 10
    device[::200] = 0
    seen = Seen(device.tolist(), received.tolist(), [13] * len(received))
    assert seen.rate_hz() == pytest.approx(130.0, rel=1e-6)


def test_a_stream_in_bursts_that_nobody_declared_has_no_gaps(study):
    """Its samples lie 10 ms apart, a few at the start aside."""
    for received_ns in bursts(100.0, 3, 60.0).tolist():
        study.raw("p1/eda/x_1", received_ns, 0, {"eda": np.zeros(1)})
    stream = sense4hri_session.open(study.write())["p1/eda/x_1"]
    assert stream.sampling_frequency_hz == pytest.approx(100.0, rel=2e-3)
    steps = np.diff(stream.arrays()[0]) / SECOND
    assert np.mean((steps > 0.005) & (steps < 0.015)) > 0.99


def test_messages_that_are_no_raw_are_counted(study):
    """Raw messages with channels of unequal length are left out and counted."""
    for i in range(30):
        study.raw(
            "p1/ecg/x_1", START_NS + i * SECOND, (i + 1) * SECOND, {"a": np.zeros(4), "b": np.zeros(4 - (i == 7))}
        )
    stream = sense4hri_session.open(study.write())["p1/ecg/x_1"]
    assert stream.seen.undecodable == 1
    assert len(stream.frame()) == 29 * 4
