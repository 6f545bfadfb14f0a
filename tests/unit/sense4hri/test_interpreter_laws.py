"""The two laws, proved for a toy interpreter of every shape: chunks do not matter; a hole breaks what it breaks.

Through the kit's feed, as the shell feeds a step, but without a graph. Samples carry their number.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kit.toy_steps import Baseline, Config, Counter, DerivedBreathing, Moved
from sense4hri.chunk import Chunk
from sense4hri.feed import AGAIN_S, HOLD_S, Beside, Feed, Report
from sense4hri.names import StreamName
from sense4hri.step import Marker, Unusable
from sense4hri.stream_info import StreamInfo

FS_HZ, ACC_HZ = 100.0, 50.0
DEVICE_NS, RECEIVED_NS = 10**15, 10**18
STEPS = {"ecg": Counter, "respiration": DerivedBreathing, "ppg": Moved, "eda": Baseline}


def about(sensor_type, fs_hz=FS_HZ, unit="uV"):
    return StreamInfo(StreamName("p1", sensor_type, "s1"), fs_hz, unit, ("a",))


def chunks(sizes, seconds, fs_hz=FS_HZ, lost=(), values=None, delay_s=0.0):
    """Frames of the given sizes in turn whose samples carry their number, but for those that touch what is lost (s)."""
    i, k, made, total = 0, 0, [], round(seconds * fs_hz)
    while i < total:
        n = min(sizes[k % len(sizes)], total - i)
        i, k = i + n, k + 1
        after_ns = round((i - 1) / fs_hz * 1e9)
        samples = np.arange(i - n, i, dtype=float)[:, None] if values is None else values[i - n : i, None]
        if not any(first < i / fs_hz and last > (i - n) / fs_hz for first, last in lost):
            received_ns = RECEIVED_NS + after_ns + round(delay_s * 1e9)
            made.append(Chunk(("a",), samples, DEVICE_NS + after_ns, received_ns))
    return made


def marker(at_s, name="baseline_end"):
    return Marker(RECEIVED_NS + round(at_s * 1e9), None, math.nan, "", "p1", name, "", "test")


def feed(sensor_type, info=None, ordered=None):
    step = STEPS[sensor_type]
    ordered = ordered if ordered is not None else hasattr(step, "marker") or hasattr(step, "beside")
    made = Feed(lambda known: step(Config(), known), 1.0, ordered=ordered)
    assert made.know(info or about(sensor_type)) == []
    return made


def play(sensor_type, events, info=None):
    """All updates of the events, in the order in which they are given."""
    fed = feed(sensor_type, info)
    return [update for event in events for update in fed.put(event)] + fed.finish()


def by_stamp(*streams):
    return sorted((event for stream in streams for event in stream), key=lambda event: event.received_ns)


def motion(sizes, seconds, delay_s=0.0, lost=()):
    info = about("accelerometer", ACC_HZ, "m/s^2")
    made = chunks(sizes, seconds, ACC_HZ, lost, delay_s=delay_s)
    return [Beside(chunk.received_ns, info, chunk) for chunk in made]


def numbers(updates):
    """What the updates say, but for the receipt stamp: that is of the message, so of the chunk."""
    return [repr(update._replace(received_ns=0)) for update in updates]


sizes_of_frames = st.lists(st.integers(1, 150), min_size=1, max_size=6)


@settings(max_examples=15, deadline=None)
@given(sizes_of_frames)
def test_chunks_do_not_matter_to_one_source(sizes):
    """However the samples are cut, the counts and means are the same; a step of one kind or another."""
    for sensor_type in ("ecg", "respiration"):
        whole = play(sensor_type, chunks([1], 8))
        first = whole[0].device_ns
        cut = play(sensor_type, chunks(sizes, 8))
        same_grid = [update for update in cut if (update.device_ns - first) % 10**9 == 0]
        assert len(cut) == len(same_grid) == 7
        assert numbers(cut) == numbers(whole)


@settings(max_examples=15, deadline=None)
@given(sizes_of_frames, st.lists(st.integers(1, 60), min_size=1, max_size=6))
def test_chunks_do_not_matter_to_two_sources(sizes, beside_sizes):
    """However both streams are cut, each update looks at the acceleration of exactly its own second."""
    events = by_stamp(chunks(sizes, 8), motion(beside_sizes, 8))
    updates = play("ppg", events)
    assert numbers(updates) == numbers(play("ppg", by_stamp(chunks([1], 8), motion([1], 8))))
    assert [update.extra[0].values[0] for update in updates] == [50.0 * k for k in range(1, 8)]


@settings(max_examples=15, deadline=None)
@given(st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_matter(random):
    """Messages of two streams that overtake each other by less than HOLD_S give the same numbers."""
    events = by_stamp(chunks([20], 8), motion([13], 8), [marker(3.0)])
    late = sorted(events, key=lambda event: event.received_ns + random.uniform(0, 0.9 * HOLD_S) * 1e9)
    in_order = {kind: iter([event for event in events if isinstance(event, kind)]) for kind in (Chunk, Beside, Marker)}
    arrived = [next(in_order[type(event)]) for event in late]  # a topic keeps its order
    assert list(map(repr, play("ppg", arrived))) == list(map(repr, play("ppg", events)))


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.45])
def test_a_marker_is_where_its_stamp_is(late_s):
    """A marker that arrives later than the samples it came before is still before them, up to HOLD_S."""
    raw = chunks([10], 8)
    mark = marker(3.0)
    arrival = next(i for i, chunk in enumerate(raw) if chunk.received_ns >= mark.received_ns + late_s * 1e9)
    updates = play("eda", [*raw[:arrival], mark, *raw[arrival:]])
    assert [update.tonic_us for update in updates[:2]] == pytest.approx([math.nan] * 2, nan_ok=True)
    assert updates[0].reasons == ("no baseline yet",)
    assert [update.tonic_us for update in updates[3:]] == [400.0 - 299.0 + 100 * k for k in range(4)]


def test_a_marker_without_a_stamp_came_with_the_newest_samples():
    """As `ros2 topic pub` sends it: it counts where it was heard, in a session too, not at once or as one of 1970."""
    raw, unstamped = chunks([10], 20), marker(3.0)._replace(received_ns=0)

    def played(events):
        fed = feed("eda")
        fed.cut_at(RECEIVED_NS + 10 * 10**9)
        return list(map(repr, [update for event in events for update in fed.put(event)] + fed.finish()))

    heard = next(i for i, chunk in enumerate(raw) if chunk.received_ns >= marker(13.0).received_ns)
    with_stamp = played([*raw[:heard], marker(13.0), *raw[heard:]])
    assert played([*raw[:heard], unstamped, *raw[heard:]]) == with_stamp != played(raw)


def test_markers_of_the_future_hold_nobody_up():
    """A marker stamped an hour ahead waits alone; samples and other markers go on."""
    updates = play("eda", [marker(3600.0), *by_stamp(chunks([10], 8), [marker(3.0)])])
    assert updates[-1].tonic_us == 700.0 - 299.0


def test_a_host_clock_set_back_holds_nobody_up():
    """When the host's clock goes back an hour, what was held is given, and updates go on at once."""
    raw = chunks([10], 8)
    back = [Chunk(c.channels, c.samples, c.device_ns, c.received_ns - 3600 * 10**9) for c in raw[400 // 10 :]]
    assert numbers(play("eda", [*raw[: 400 // 10], *back])) == numbers(play("eda", raw))


@pytest.mark.parametrize(
    ("lost", "segment", "chain"), [((3.0, 3.04), False, False), ((3.0, 6.0), False, True), ((3.0, 15.0), True, True)]
)
def test_a_hole_breaks_what_it_breaks(lost, segment, chain):
    """A short hole breaks nothing, a longer one the chain, one of more than 10 s the segment."""
    updates = play("respiration", chunks([4], 20, lost=[lost]))
    last = updates[-1]
    assert (last.breath_count < 1000) is segment
    assert (last.window_s < 6.0) is segment
    after = [n for n in range(2000) if not lost[0] * 100 <= n < lost[1] * 100 and (not chain or n >= lost[1] * 100)]
    newest = round((last.device_ns - DEVICE_NS) / 1e9 * FS_HZ)
    assert last.amplitude == pytest.approx(np.mean([n for n in after if n <= newest]))


def test_a_device_that_starts_afresh_begins_a_segment():
    """When the device's clock goes back everything begins anew, in two streams together too."""
    again = [Chunk(c.channels, c.samples, c.device_ns - 10**14, c.received_ns + 10**10) for c in chunks([10], 8)]
    assert play("respiration", [*chunks([10], 8), *again])[-1].window_s == pytest.approx(7.0, abs=0.2)
    first = by_stamp(chunks([10], 8), motion([10], 8))
    second = [
        event._replace(received_ns=c.received_ns, chunk=c) if isinstance(event, Beside) else c
        for event in first
        for old in [event.chunk if isinstance(event, Beside) else event]
        for c in [Chunk(old.channels, old.samples, old.device_ns - 10**14, old.received_ns + 10**10)]
    ]
    values = [update.extra[0].values[0] for update in play("ppg", [*first, *second])]
    assert values[:7] == values[-7:] == [50.0 * k for k in range(1, 8)]


def test_a_stream_beside_may_be_absent_or_cease():
    """Without the stream beside it nothing is held for more than two seconds, and the reason is said."""
    alone = play("ppg", chunks([10], 8))
    assert [update.reasons for update in alone] == [("motion: no accelerometer",)] * 7
    assert [update.pulse_amplitude for update in alone] == [
        update.pulse_amplitude for update in play("ppg", by_stamp(chunks([10], 8), motion([10], 8)))
    ]
    fed = feed("ppg")
    events = by_stamp(chunks([10], 30), motion([10], 4))
    seen = {event.received_ns: [u.device_ns for u in fed.put(event)] for event in events}
    lag_s = [(at - RECEIVED_NS - (d - DEVICE_NS)) / 1e9 for at, found in seen.items() for d in found]
    assert max(lag_s) < 3.0
    assert max(lag_s[-20:]) < 1.0


def test_a_session_cuts_every_input():
    """From the common start on it does not matter how long was listened before, and no marker from before it counts."""
    raw, start_ns = chunks([10], 20), RECEIVED_NS + 10 * 10**9

    def after_the_start(events):
        fed = feed("eda")
        fed.cut_at(start_ns)
        updates = [update for event in events for update in fed.put(event)] + fed.finish()
        return [update for update in updates if update.received_ns >= start_ns]

    live = after_the_start(by_stamp(raw, [marker(3.0), marker(13.0)]))
    replayed = after_the_start(by_stamp([c for c in raw if c.received_ns > start_ns - 2 * 10**9], [marker(13.0)]))
    assert list(map(repr, live)) == list(map(repr, replayed))
    assert math.isnan(live[0].tonic_us)
    assert not math.isnan(live[-1].tonic_us)


def test_what_waits_for_metadata_loses_nothing():
    """Samples and reports that came before anything was known of the stream give the same updates as in time."""
    waited = Feed(lambda known: Counter(Config(), known), 1.0)
    events = by_stamp(chunks([10], 8), [Report(RECEIVED_NS + 10**9, "heart_rate", 61.0)])
    assert [update for event in events for update in waited.put(event)] == []
    assert list(map(repr, waited.know(about("ecg")))) == list(map(repr, play("ecg", events)))


def test_channels_that_change_get_a_step_of_their_own():
    """A step sees one set of channels; where that changes everything begins anew with those that really come."""
    seen = []

    def make(info):
        seen.append(info.channel_names)
        return Counter(Config(), info)

    fed = Feed(make, 1.0)
    fed.know(about("ecg"))
    raw = chunks([10], 8)
    other = [Chunk(("b",), c.samples, c.device_ns, c.received_ns) for c in raw[40:]]
    updates = [update for event in [*raw[:40], *other] for update in fed.put(event)]
    assert seen == [("a",), ("b",)]
    assert [update.peak_count for update in updates] == [101, 100, 100, 101, 100, 100]


@pytest.mark.parametrize(
    ("info", "reason"),
    [
        (about("ecg", unit="deg"), "unit is 'deg', must be 'uV'"),
        (about("ecg", fs_hz=math.nan), "sampling_frequency_hz is nan"),
        (about("ecg", fs_hz=-1.0), "sampling_frequency_hz is -1"),
    ],
)
def test_a_stream_that_cannot_be_used_says_why(info, reason):
    """At its first sample and then once per update interval there is an update with the reason and nothing else."""
    told = []
    fed = Feed(lambda known: Counter(Config(), known), 1.0, refused=told.append)
    fed.know(info)
    updates = [update for event in chunks([10], 8) for update in fed.put(event)]
    assert len(told) == 1
    assert reason in told[0]
    assert {type(update) for update in updates} == {Unusable}
    assert {update.reasons for update in updates} == {(told[0],)}
    assert len(updates) == 8
    steps_s = [(b.device_ns - a.device_ns) / 1e9 for a, b in pairwise(updates)]
    assert steps_s[1:] == pytest.approx([1.0] * 6, abs=0.1)
    fed.cut_at(RECEIVED_NS + 10**10)
    assert [fed.put(event) for event in chunks([10], 30)[100:]]
    assert len(told) == 1, "said once, also after a session has begun"


class Divides(Counter):
    """A step that has not thought of a sample of exactly 300."""

    def push(self, timed):
        1 // int((timed.samples[:, 0] != 300).all())
        return super().push(timed)


def test_an_error_of_the_step_costs_its_stream_some_seconds_and_nobody_else_anything():
    """It is told once with its place, then as the reason of every update, and later the stream is interpreted anew."""
    told = []
    fed = Feed(lambda known: Divides(Config(), known), 1.0, refused=told.append)
    fed.know(about("ecg"))
    updates = [update for chunk in chunks([20], 3.2 + AGAIN_S + 5.0) for update in fed.put(chunk)]
    assert len(told) == 1
    assert "ZeroDivisionError in test_interpreter_laws.py, line " in told[0]
    usable = [not isinstance(update, Unusable) for update in updates]
    assert usable[:2] == [True, True]
    first, last = usable.index(False), len(usable) - usable[::-1].index(False)
    assert not any(usable[first:last])
    assert last - first == AGAIN_S
    assert all(usable[last:])
    assert len(usable[last:]) >= 3
    assert updates[first].reasons == (told[0],)


def test_an_error_is_over_where_the_hosts_clock_was_set_back():
    """By an hour, while the stream was left alone: it is interpreted anew at once, not an hour later."""
    fed = Feed(lambda known: Divides(Config(), known), 1.0)
    fed.know(about("ecg"))
    before, after = chunks([20], 4.0), chunks([20], 9.0, delay_s=-3600.0)[len(chunks([20], 4.0)) :]
    updates = [update for chunk in (*before, *after) for update in fed.put(chunk)]
    assert any(isinstance(update, Unusable) for update in updates)
    assert not isinstance(updates[-1], Unusable)
