"""The pure half of the kit: names, sample times, the grid, clock arithmetic."""

import ast
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.chunk import Break, Chunk
from sense4hri.clock_model import ros_ns
from sense4hri.grid import UpdateGrid
from sense4hri.names import StreamName, is_human_id, is_sensor_id, sanitise_sensor_id
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import event_ns

KIT = Path(__file__).resolve().parents[3] / "interfaces" / "sense4hri" / "src" / "sense4hri"
PURE = (
    *(
        "errors",
        "modalities",
        "waiting",
        "names",
        "chunk",
        "sample_clock",
        "jitter",
        "running_rate",
        "arrival_fit",
        "grid",
        "clock_model",
        "hrv",
        "nn_intervals",
        "early_beats",
        "medians",
        "windows",
        "lasting",
    ),
    *("schema", "version", "device", "arrivals", "unwrap", "holes", "recorder_status", "files", "set_aside"),
    *(
        "pace",
        "patterns",
        "topics",
        "crowd",
        "memory",
        "message_types",
        "inbox",
        "liveness",
        "processor",
        "strict_json",
        "intake",
        "refusals",
        "plain_text",
    ),
)
T0 = 10**15


def chunk(n, device_ns, received_ns=0):
    return Chunk(("x",), np.zeros((n, 1)), device_ns, received_ns)


@pytest.mark.parametrize(
    ("text", "human", "sensor"),
    [
        ("p1", True, True),
        ("Ada", True, False),
        ("a" * 63, True, True),
        *((text, False, False) for text in ("23bd5", "a__b", "", "a" * 64, "p-1", "p1\n")),
    ],
)
def test_ids_follow_the_contract(text, human, sensor):
    """An id starts with a letter, holds no double underscore and at most 63 characters; a sensor_id no capitals."""
    assert (is_human_id(text), is_sensor_id(text)) == (human, sensor)


def test_an_address_becomes_a_sensor_id():
    """Serial numbers and addresses become legal ids in one way."""
    assert sanitise_sensor_id("A0:9E:1A") == "s_a0_9e_1a"
    assert sanitise_sensor_id("6080292F") == "s_6080292f"
    with pytest.raises(ValueError, match="'--'"):
        sanitise_sensor_id("--")


@given(st.text())
def test_whatever_is_sanitised_is_legal(text):
    """The sanitising function makes a legal id of any text that has a letter or digit of ASCII."""
    try:
        assert is_sensor_id(sanitise_sensor_id(text))
    except ValueError:
        assert not any(c.isascii() and c.isalnum() for c in text.lower())


def test_a_topic_reads_back_as_its_name():
    """Parsing inverts naming, and refuses what the contract does not allow."""
    name = StreamName("p1", "ecg", "h10_1")
    assert StreamName.parse(name.topic("raw")) == (name, "raw")
    for bad in ("/humans/physiological/p1/state", "/humans/physiological/9/ecg/h/raw", name.topic("raw")[1:], "/x"):
        assert StreamName.parse(bad) is None


def test_contiguous_samples_lie_between_the_stamps():
    """Sample i of a contiguous frame stands at previous + (i+1) * delta / n, whatever the declared rate says."""
    clock = SampleClock(100.0)
    clock.place(chunk(10, T0))
    timed = clock.place(chunk(10, T0 + 99_000_000))
    assert timed.break_ is None
    assert timed.times_ns.tolist() == [T0 + 9_900_000 * (i + 1) for i in range(10)]


def test_a_lost_frame_is_a_gap_and_not_smeared():
    """After a lost frame the samples stand back from their own stamp, and the missing ones are counted."""
    clock = SampleClock(100.0)
    clock.place(chunk(10, T0))
    timed = clock.place(chunk(10, T0 + 200_000_000))
    assert (timed.break_, timed.lost, clock.lost_samples_total, clock.gaps_total) == (Break.GAP, 10, 10, 1)
    assert timed.times_ns[0] == T0 + 110_000_000


def test_one_lost_sample_of_small_frames_is_seen():
    """With one sample a message, each missing one is a gap."""
    clock = SampleClock(250.0)
    for i in (0, 1, 2, 4):
        timed = clock.place(chunk(1, T0 + i * 4_000_000))
    assert (timed.break_, timed.lost) == (Break.GAP, 1)


def test_a_frame_without_a_time_among_others_follows_the_one_before():
    """It is no reset, and what was lost beside it is counted when the next time comes."""
    clock = SampleClock(100.0)
    clock.place(chunk(10, T0, 7 * T0))
    untimed = clock.place(chunk(10, None, 7 * T0))
    assert (untimed.break_, untimed.device_ns) == (None, None)
    assert untimed.times_ns.tolist() == [T0 + 10_000_000 * (i + 1) for i in range(10)]
    assert clock.place(chunk(10, T0 + 200_000_000, 7 * T0)).break_ is None
    clock.place(chunk(10, None, 7 * T0))
    assert clock.place(chunk(10, T0 + 500_000_000, 7 * T0)).lost == 10
    assert (clock.resets_total, clock.backwards_total, clock.gaps_total) == (0, 0, 1)
    assert clock.in_device_time
    assert clock.place(chunk(10, None, 7 * T0 + 10**10)).break_ is Break.FIRST
    assert not clock.in_device_time


def test_an_irregular_sample_without_a_time_among_others_goes_by_its_receipt():
    """A report without device time stands as long after the one before as it was received after it."""
    clock = SampleClock(0.0)
    clock.place(chunk(1, T0, 7 * T0))
    untimed = clock.place(chunk(1, None, 7 * T0 + 3 * 10**9))
    assert (untimed.times_ns.tolist(), untimed.break_, clock.in_device_time) == ([T0 + 3 * 10**9], None, True)
    late = clock.place(chunk(1, None, 7 * T0 + 10**10))
    assert (late.times_ns.tolist(), clock.in_device_time) == ([7 * T0 + 10**10], False)


def test_a_device_that_starts_afresh_is_a_reset():
    """A stamp that goes back is counted as a reset; an equal one as a duplicate; neither is reordered."""
    clock = SampleClock(100.0)
    clock.place(chunk(10, T0))
    assert clock.place(chunk(10, T0)).break_ is Break.DUPLICATE
    assert clock.place(chunk(10, 5)).break_ is Break.RESET
    assert clock.place(chunk(10, 100_000_005)).break_ is None
    assert (clock.duplicates_total, clock.resets_total, clock.backwards_total) == (1, 1, 1)


@pytest.mark.parametrize("fs_true", [275.16, 258.83, 129.9, 130.17, 50.9])
def test_a_rate_that_differs_from_the_declared_one_is_learnt(fs_true):
    """Real boards run up to 10 % off their declared rate: the rate is measured and frames come out contiguous."""
    nominal = {275.16: 250.0, 258.83: 250.0, 50.9: 50.0}.get(fs_true, 130.0)
    clock = SampleClock(nominal)
    breaks = [clock.place(chunk(50, T0 + round(k * 50 / fs_true * 1e9))).break_ for k in range(60)]
    assert clock.fs_hz == pytest.approx(fs_true, rel=1e-6)
    assert breaks[10:] == [None] * 50


def board(frames, n, jitter_ms, lost=(), fs_true=259.0):
    """A board declared with 250 Hz: device stamps of its frames, evenly jittered, those with numbers in lost left out.

    Returns the placed chunks and the clock.
    """
    noise, clock = np.random.default_rng(4), SampleClock(250.0)
    stamps = [T0 + round((k * n / fs_true + noise.uniform(0, jitter_ms) / 1e3) * 1e9) for k in range(frames)]
    return [clock.place(chunk(n, stamp)) for k, stamp in enumerate(stamps) if k not in lost], clock


@pytest.mark.parametrize(("n", "jitter_ms"), [(4, 6.0), (10, 8.0), (10, 18.0), (25, 30.0)])
def test_the_jitter_of_a_devices_stamps_is_no_loss(n, jitter_ms):
    """A complete recording of a board that stamps its frames some ms late has no gap from its first frame on."""
    placed, clock = board(4000, n, jitter_ms)
    assert (clock.gaps_total, clock.lost_samples_total) == (0, 0)
    assert {timed.break_ for timed in placed[1:]} == {None}
    assert clock.fs_hz == pytest.approx(259.0, rel=2e-3)


@pytest.mark.parametrize("jitter_ms", [1.0, 2.0, 3.0, 3.8])
def test_the_jitter_of_single_samples_is_no_loss(jitter_ms):
    """One sample a frame, stamps late by up to a whole interval: no gap once the jitter is known, times in order."""
    placed, clock = board(4000, 1, jitter_ms)
    assert clock.lost_samples_total <= 2
    assert {timed.break_ for timed in placed[40:]} == {None}
    assert np.all(np.diff(np.concatenate([timed.times_ns for timed in placed])) > 0)


def test_a_hole_longer_than_the_jitter_of_single_samples_is_seen():
    """One sample a frame, stamps late by up to 3 ms of 3.9: ten lost in a row are a gap of ten, give or take one."""
    placed, _ = board(4000, 1, 3.0, {*range(2000, 2010)})
    assert [timed.lost for timed in placed[40:] if timed.break_ is Break.GAP] == [pytest.approx(10, abs=1)]


@pytest.mark.parametrize("n", [10, 25])
def test_frames_lost_between_jittering_stamps_are_counted_to_the_sample(n):
    """One, two and seven frames in a row are counted exactly, from the second frame on, and time never goes back."""
    lost = {2, 700, 1500, 1501, *range(2900, 2907)}
    placed, clock = board(4000, n, 1.2 * n, lost)
    gaps = [timed.lost for timed in placed if timed.break_ is Break.GAP]
    assert gaps == [n, n, 2 * n, 7 * n]
    assert clock.lost_samples_total == n * len(lost)
    assert np.all(np.diff(np.concatenate([timed.times_ns for timed in placed])) > 0)


@pytest.mark.parametrize(("n", "pause_ms"), [(1, 2.0), (2, 2.0), (2, 2.3), (3, 2.0), (3, 2.3)])
def test_a_board_that_pauses_for_part_of_a_frame_has_lost_nothing(n, pause_ms):
    """Stamps in whole ms of a loop that pauses now and then: 0 lost, and frames really lost are still exact."""
    steps_ms = np.full(12_000, 1e3 / 259.0)
    steps_ms[700::500] += pause_ms
    stamps = (T0 + np.floor(np.cumsum(steps_ms)) * 1e6).astype(np.int64)[n - 1 :: n]
    for lost in (set(), {1000, 2001, 3333}):
        clock = SampleClock(250.0)
        placed = [clock.place(chunk(n, int(stamp))) for k, stamp in enumerate(stamps) if k not in lost]
        assert clock.lost_samples_total == n * len(lost)
        assert np.all(np.diff(np.concatenate([timed.times_ns for timed in placed])) > 0)


def test_single_samples_lost_between_jittering_stamps_are_counted():
    """One sample a frame, stamps late by up to 0.3 of a sample: every lost one is counted, and no other."""
    lost = {*range(200, 4000, 97)}
    _, clock = board(4000, 1, 0.3 * 1e3 / 259.0, lost)
    assert (clock.lost_samples_total, clock.gaps_total) == (len(lost), len(lost))


@pytest.mark.parametrize("before", [3, 200])
def test_samples_lost_inside_a_device_whose_stamps_are_true(before):
    """Where stamps do not jitter, a frame that lost some of its samples is a gap of so many, at once."""
    clock = SampleClock(130.0)
    for k in range(before):
        clock.place(chunk(36, T0 + round(k * 36 / 129.95 * 1e9)))
    timed = clock.place(chunk(33, T0 + round(before * 36 / 129.95 * 1e9)))
    assert (timed.break_, timed.lost) == (Break.GAP, 3)


SENT_S = np.arange(1, 601) * 0.1  # when 60 s of frames of 10 samples are sent


def told(device_s, received_s):
    """Breaks and losses of frames of 10 samples at 100 Hz with these times on both clocks, after the first frame."""
    clock, stamps = SampleClock(100.0), zip(device_s.tolist(), received_s.tolist(), strict=True)
    placed = [clock.place(chunk(10, T0 + round(d * 1e9), 7 * T0 + round(r * 1e9))) for d, r in stamps]
    assert clock.lost_samples_total == sum(timed.lost for timed in placed)
    return [(timed.break_, timed.lost) for timed in placed[1:] if timed.break_]


@pytest.mark.parametrize("ahead_s", [6.0, 3600.0, 7 * 365.25 * 86_400.0])
@pytest.mark.parametrize("away_s", [0.0, 30.0])
def test_a_device_clock_that_is_set_ahead_has_lost_no_samples(ahead_s, away_s):
    """Told as a reset, also after an outage: samples that were lost would have taken as long on the host's clock."""
    late = SENT_S > 30
    assert told(SENT_S + late * (away_s + ahead_s), SENT_S + late * away_s) == [(Break.RESET, 0)]


@pytest.mark.parametrize("kept_s", [0.0, 10.0, 20.0])
def test_an_outage_is_a_loss_however_late_what_was_kept_of_it_comes(kept_s):
    """30 s without a radio, of which the device has kept the first and sends them at once: the rest is lost."""
    here = (SENT_S <= 20) | (SENT_S > 50)
    device_s = SENT_S[here | (20 + kept_s >= SENT_S)]
    received_s = np.where(device_s > 20, np.maximum(device_s, 50.1), device_s)
    assert told(device_s, received_s) == [(Break.GAP, round((30 - kept_s) * 100))]


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0, 1000.0])
def test_a_hole_of_a_recording_is_a_loss_at_any_speed(speed):
    """A player's host sees less or more of the hole than the recording has, as of everything else in it."""
    device_s = SENT_S + (SENT_S > 30) * 20.0
    assert told(device_s, device_s / speed) == [(Break.GAP, 2000)]


@pytest.mark.parametrize("step_s", [-3600.0, -10.0, 10.0, 3600.0])
def test_a_host_clock_that_is_set_changes_no_time_of_a_device(step_s):
    """Neither a break nor a loss: the device's frames follow each other."""
    assert told(SENT_S, SENT_S + (SENT_S > 30) * step_s) == []


def test_a_frame_that_comes_far_too_early_does_not_go_back():
    """A stamp with less time before it than its samples take is a break; its samples lie after those before it."""
    clock = SampleClock(100.0)
    before = clock.place(chunk(50, T0))
    timed = clock.place(chunk(50, T0 + 100_000_000))
    assert (timed.break_, timed.lost) == (Break.GAP, 0)
    assert before.times_ns[-1] < timed.times_ns[0] < timed.times_ns[-1] == T0 + 100_000_000


def test_without_device_time_the_jitter_of_arrival_stays_out_of_the_samples():
    """Samples by arrival alone are evenly spaced to a tenth of the jitter, and never go back."""
    noise = np.random.default_rng(1)
    clock = SampleClock(100.0)
    times = []
    for k in range(600):
        received = T0 + round((k * 10 / 100.0 + noise.uniform(0, 0.04)) * 1e9)
        times.append(clock.place(chunk(10, None, received)).times_ns)
    steps = np.diff(np.concatenate(times))
    assert np.all(steps > 0)
    assert np.std(steps[3000:]) < 0.1 * 0.04e9
    assert np.mean(steps[3000:]) == pytest.approx(1e7, rel=2e-3)


def test_a_hole_in_arrival_is_a_gap():
    """Without device time, a silence of seconds breaks the line; the size of the loss is not guessed."""
    clock = SampleClock(100.0)
    for k in range(50):
        clock.place(chunk(10, None, T0 + k * 100_000_000))
    timed = clock.place(chunk(10, None, T0 + 50 * 100_000_000 + 3 * 10**9))
    assert (timed.break_, timed.lost) == (Break.GAP, 0)
    assert timed.times_ns[-1] == T0 + 50 * 100_000_000 + 3 * 10**9


def test_bad_rates_and_empty_chunks_are_named():
    """A negative or missing rate and a chunk without samples are refused."""
    for rate in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="sampling_frequency_hz"):
            SampleClock(rate)
    with pytest.raises(ValueError, match="without samples"):
        SampleClock(100.0).place(chunk(0, T0))


@given(st.lists(st.integers(1, 40), min_size=1, max_size=40), st.sampled_from([0.25, 1.0, 0.333]))
def test_updates_do_not_depend_on_the_chunking(sizes, interval_s):
    """However samples are cut into chunks, updates fall on the same samples, and no sample is lost or seen twice."""

    def updates(cuts):
        clock, grid, at, total, pieces = SampleClock(100.0), UpdateGrid(interval_s), 0, [], 0
        for n in cuts:
            at += n
            for piece, due in grid.split(clock.place(chunk(n, T0 + at * 10_000_000))):
                pieces += len(piece.times_ns)
                if due:
                    total.append(int(piece.times_ns[-1]))
        assert pieces == at
        return total

    assert updates(sizes) == updates([1] * sum(sizes))


@pytest.mark.parametrize("fs_hz", [130.0, 55.0, 44.1])
def test_a_nanosecond_of_a_stamp_moves_no_update(fs_hz):
    """Stamps rounded to the nanosecond, of frames of 0.1 s, 1 s or 10 s: every update falls on the same sample."""

    def updates(frame_s):
        clock, grid, at, ends = SampleClock(fs_hz), UpdateGrid(1.0), 0, []
        count = round(frame_s * fs_hz)
        for last in range(count, round(60 * fs_hz) + 1, count):
            for piece, due in grid.split(clock.place(chunk(count, T0 + round((last - 1) / fs_hz * 1e9)))):
                at += len(piece.times_ns)
                ends += [at] if due else []
        return ends

    every = updates(0.1)
    for frame_s in (1.0, 10.0):
        assert updates(frame_s) == every[: len(updates(frame_s))]


def test_clock_arithmetic_keeps_the_last_nanosecond():
    """ros_ns is exact on today's numbers, alike for one int and for arrays."""
    device = 825_000_000_123_456_789
    assert (
        ros_ns(device, device - 10**12, 946_684_800_000_000_001, 10.0) == device + 946_684_800_000_000_001 + 10_000_000
    )
    array = np.array([device, device + 1])
    assert ros_ns(array, device - 10**12, 7, 10.0).tolist() == [device + 7 + 10**7, device + 8 + 10**7]


@pytest.mark.parametrize("module", PURE)
def test_the_pure_half_imports_no_ros(module):
    """A notebook without ROS can import the pure modules: they import each other, numpy and the standard library."""
    allowed = {"numpy", "sense4hri", *sys.stdlib_module_names}
    for node in ast.walk(ast.parse((KIT / f"{module}.py").read_text())):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        for name in names:
            top, _, rest = name.partition(".")
            assert top in allowed, f"{module} imports {name}"
            assert top != "sense4hri" or rest.split(".")[0] in (*PURE, "stamps"), f"{module} imports {name}"


@pytest.mark.parametrize(("sec", "is_now"), [(0, True), (1_700_000_000, False)])
def test_a_marker_without_a_stamp_is_of_now(sec, is_now):
    """`ros2 topic pub` sends none, and nothing of a study happened in 1970."""
    marker = SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=0)))
    before_ns = time.time_ns()
    assert (before_ns <= event_ns(marker) <= time.time_ns()) is is_now
    assert is_now or event_ns(marker) == sec * 1_000_000_000
