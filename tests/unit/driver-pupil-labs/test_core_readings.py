"""What Pupil Capture publishes becomes rows: every picture once, in its own time, in mm where there is a model."""

import asyncio
import math
from contextlib import aclosing
from types import SimpleNamespace

import msgpack
import numpy as np
import pytest
from driver_pupil_labs.config import PupilConfig
from driver_pupil_labs.device import Core, Told
from driver_pupil_labs.eyes import MOST_HELD, InOrder, Pairing, rate_hz
from driver_pupil_labs.protocol import Event, Gaze, Note, Pupil, annotation, decode
from driver_pupil_labs.streams import MISSED_S, MOST, Known
from driver_pupil_labs.transport import Heard
from hypothesis import given
from hypothesis import strategies as some
from listened import until
from sense4hri.arrivals import Silence
from sense4hri.device import ClockMeasurement, Declared, Samples
from sense4hri.errors import DeviceLost, FrameError
from sensor_bench.clock import DeviceClock
from sensor_bench.pupil_core.capture import VirtualCapture

PUPIL_S = 5000.0


def capture(**more) -> VirtualCapture:
    return VirtualCapture(DeviceClock(0, round(PUPIL_S * 1e9)), **more)


def listen(virtual: VirtualCapture, seconds: float, told: Told | None = None, from_s: float = 0.0):
    """Return all items of so many seconds, in steps of 20 ms as a socket brings them, and what was told."""
    told, items = told or Told(), []
    for at_s in np.arange(from_s, from_s + seconds, 0.02):
        for topic, payload in virtual.send(float(at_s)):
            match decode(topic.decode(), payload):
                case Gaze() as gaze:
                    told.gaze(gaze, 1)
                case Pupil() as pupil:
                    told.pupil(pupil, 1)
                case other:
                    items += [other] if other else []
        items += list(told.items())
    return items, told


def rows(items, sensor_type):
    found = [each for each in items if isinstance(each, Samples) and each.sensor_type == sensor_type]
    times_ns = [[each.chunk.device_ns] if each.times_ns is None else each.times_ns for each in found]
    return np.concatenate(times_ns), np.concatenate([each.chunk.samples for each in found])


def test_two_cameras_give_irregular_gaze_and_120_sizes_a_second():
    """The rate is that of the stamps, sizes are in mm, left and right are where they belong; gaze has no rhythm."""
    items, _ = listen(capture(), 4)
    streams = [each for each in items if isinstance(each, Declared)][-1].streams
    gaze, pupils = streams["eye_tracking"], streams["pupillometry"]
    assert (gaze.sampling_frequency_hz, gaze.unit) == (0.0, "1")
    assert all(each.lost is None for each in items if isinstance(each, Samples) and each.sensor_type == "eye_tracking")
    assert (pupils.sampling_frequency_hz, pupils.unit) == (120.0, "mm")
    assert pupils.channel_names == ("diameter_left", "diameter_right", "confidence")
    _, sizes = rows(items, "pupillometry")
    assert np.allclose(sizes[:, 0] - sizes[:, 1], 0.1, atol=0.01)
    assert np.all((sizes[:, 0] > 3) & (sizes[:, 0] < 5))


def test_times_are_pupil_time_and_gaze_is_where_the_wearer_looks():
    """Stamps are the pictures' own, not those of arrival; without a first second, in which nothing is known yet."""
    items, _ = listen(capture(), 4)
    times_ns, gaze = rows(items, "eye_tracking")
    assert np.allclose(np.diff(times_ns) / 1e6, 1000 / 240, atol=0.01)
    assert times_ns[0] == pytest.approx((PUPIL_S + 1.0) * 1e9, abs=3e7)
    assert np.all((gaze[:, :2] > 0) & (gaze[:, :2] < 1))


@pytest.mark.parametrize("phase_s", [0.0005, 0.003, 0.0055])
def test_gaze_of_blinks_comes_late_and_is_put_in_order(phase_s):
    """Every gaze once, in the order in which it was seen."""
    virtual = capture(phases_s=(0.0, phase_s))
    items, _ = listen(virtual, 10)
    times_ns, _ = rows(items, "eye_tracking")
    assert np.all(np.diff(times_ns) >= 0)
    left_out = virtual.counts["gaze"].made - len(times_ns)
    assert 240 <= left_out < 240 + 30 + 20  # the first second, and what is held back


@given(phase_ms=some.floats(0.1, 8.2), eye_hz=some.sampled_from([30.0, 120.0, 200.0]), seed=some.integers(0, 99))
def test_every_picture_of_both_eyes_is_in_exactly_one_row(phase_ms, eye_hz, seed):
    """Whenever the cameras take their pictures and however many get lost: none twice, none dropped, none invented."""
    random, period_ns = np.random.default_rng(seed), 1e9 / eye_hz
    pairing = Pairing(frozenset({0, 1}), period_ns)
    pictures = [
        Pupil(round(number * period_ns + eye * phase_ms * 1e6), eye, float(2 * number + eye + 1), "mm", 0.9)
        for number in range(60)
        for eye in (0, 1)
        if random.random() > 0.1
    ]
    pictures.sort(key=lambda each: each.time_ns)
    ends = [Pupil(10**12 + eye + number, eye, math.nan, "mm", 0.0) for eye in (0, 1) for number in (0, 1)]
    found = [row for each in pictures + ends for row in pairing.push(each, 1)]
    sizes = [size for row in found for size in row.values[:2] if not math.isnan(size)]
    assert sorted(sizes) == sorted(each.diameter for each in pictures)


def test_eyes_are_paired_again_after_pupil_time_was_set_back():
    """What waits goes out alone, once; from then on both sizes are in each row and nothing piles up."""
    period_ns, rows = 8_000_000, []
    pairing = Pairing(frozenset({0, 1}), period_ns)
    for start_ns in (10**13, 10**9):
        for number in range(100):
            for eye in (0, 1):
                at_ns = start_ns + number * period_ns + eye * 1_000_000
                rows += pairing.push(Pupil(at_ns, eye, 3.0, "mm", 0.9), 1)
        if start_ns == 10**13:
            rows += pairing.push(Pupil(start_ns + 100 * period_ns, 0, 3.0, "mm", 0.9), 1)
    assert len(rows) == 201
    assert [at for at, row in enumerate(rows) if math.isnan(sum(row.values))] == [100]


def test_gaze_that_comes_late_sets_no_stamp_back():
    """In the order in which it was seen, stamped with the latest receipt up to it."""
    order = InOrder(100)
    came = [(1000, 10), (1050, 20), (1020, 30), (1200, 40), (1400, 50)]
    found = [row for time_ns, received_ns in came for row in order.push(Gaze(time_ns, 0, 0, 1), received_ns)]
    assert [(row.time_ns, row.received_ns) for row in found] == [(1000, 10), (1020, 30), (1050, 30), (1200, 40)]


def test_gaze_is_stamped_anew_where_the_host_s_clock_was_set_back():
    """By an hour: what comes from then on is not stamped an hour ahead until the old time is reached again."""
    order, hour_ns = InOrder(100), 3600 * 10**9
    came = [(at * 50, hour_ns + at * 50 - (hour_ns if at > 20 else 0)) for at in range(40)]
    found = [row for time_ns, received_ns in came for row in order.push(Gaze(time_ns, 0, 0, 1), received_ns)]
    assert all(row.received_ns == (row.time_ns if row.time_ns > 1000 else hour_ns + row.time_ns) for row in found)
    assert len(found) == 38


def test_losses_are_holes_of_as_many_periods():
    """Sizes that never came are missing by their stamps, or NaN where the other eye's came: to the sample."""
    virtual = capture(loss=0.05, seed=3)
    virtual.begin(12.705)
    items, _ = listen(virtual, 10.0, from_s=12.705)
    times_ns, sizes = rows(items, "pupillometry")
    missing = np.rint(np.diff(times_ns) * 120e-9).astype(int) - 1
    assert missing.sum() > 0
    assert 2 * missing.sum() + np.isnan(sizes).sum() == virtual.counts["pupil"].lost > 60
    steps = np.diff(times_ns) * 120e-9
    assert np.abs(steps - np.rint(steps)).max() < 0.01, "a row of one eye alone lies where the others do"


def test_one_camera_has_gaze_of_its_rate():
    """Of one eye nothing waits for another: gaze is regular, and what is lost is counted."""
    virtual = capture()
    told, items = Told(), []
    for topic, payload in [message for message in virtual.send(4.0) if b".1" not in message[0]]:
        reading = decode(topic.decode(), payload)
        if isinstance(reading, Pupil) and reading.unit == "mm":
            told.pupil(reading, 1)
            told.gaze(Gaze(reading.time_ns, 0.5, 0.5, 1.0), 1)
    items = list(told.items())
    assert items[0].streams["eye_tracking"].sampling_frequency_hz == 120.0
    assert items[0].streams["pupillometry"].channel_names == ("diameter_right", "confidence")


def test_without_a_model_sizes_are_px_and_with_one_later_the_stream_begins_again():
    """Pixels and millimetres never share a stream."""
    virtual = capture(model=False, calibrated=False)
    items, told = listen(virtual, 3)
    assert {name: each.unit for name, each in items[0].streams.items()} == {"pupillometry": "px"}
    virtual.model = True
    with pytest.raises(DeviceLost, match="3d model"):
        listen(virtual, 1, told, from_s=3.0)


@pytest.mark.parametrize("model", [True, False])
def test_what_came_before_the_end_is_handed_on(monkeypatch, model):
    """Capture is closed, or begins to fit its model: every picture, and every gaze once the eyes were known."""
    virtual = capture(model=model)
    reads = [virtual.send(0.2 * number) for number in range(1, 18)]
    kind = b".3d" if model else b".2d"
    pictures = sum(topic.endswith(kind) for read in reads for topic, _ in read)
    gaze = [decode(topic.decode(), payload) for read in reads for topic, payload in read if topic.startswith(b"gaze")]
    virtual.model = True
    ends = [] if model else [message for message in virtual.send(3.5) if message[0].endswith(b".3d")]
    played = iter([*reads[:-1], [*reads[-1], *ends]])

    class Played:
        def __init__(self, host, port):
            pass

        def read(self):
            if (messages := next(played, None)) is None:
                raise DeviceLost("Capture is closed")
            return [Heard(1, topic.decode(), payload) for topic, payload in messages]

        def hear_models_only(self):
            pass

        def close(self):
            pass

    items = []

    async def listen():
        async with aclosing(Core(PupilConfig(sensor_id="core_1", address="127.0.0.1"), {}).stream()) as stream:
            await until(stream, items.append)

    monkeypatch.setattr("driver_pupil_labs.device.CaptureLink", Played)
    with pytest.raises(DeviceLost, match="closed" if model else "3d model"):
        asyncio.run(listen())
    assert np.isfinite(rows(items, "pupillometry")[1][:, :2]).sum() == pictures
    times_ns = rows(items, "eye_tracking")[0].tolist()
    assert times_ns == sorted(each.time_ns for each in gaze if each.time_ns >= times_ns[0])


def test_a_reconnect_withdraws_no_stream_that_is_about_to_come():
    """Sizes are known a second before gaze: gaze of the connection before stays declared meanwhile."""
    known = Known()
    for _ in range(2):
        known.connected()
        items, _ = listen(capture(), 4, Told(known))
    declared = [set(each.streams) for each in items if isinstance(each, Declared)]
    assert declared == [{"eye_tracking", "pupillometry"}] * 2


def test_a_stream_that_is_missing_after_a_reconnect_is_withdrawn_in_the_end():
    """Once: after MISSED_S from the first stream of the new connection; it is declared again when it comes."""
    now_s = [0.0]
    known = Known(lambda: now_s[0])
    listen(capture(), 4, Told(known))
    known.connected()
    virtual = capture(calibrated=False)
    first, told = listen(virtual, 4, Told(known))
    now_s[0] = MISSED_S + 0.1
    later, _ = listen(virtual, 1, told, from_s=4.0)
    virtual.calibrated = True
    last, _ = listen(virtual, 3, told, from_s=5.0)
    declared = [[set(each.streams) for each in items if isinstance(each, Declared)] for items in (first, later, last)]
    both = {"eye_tracking", "pupillometry"}
    assert declared == [[both], [{"pupillometry"}], [both]]


def test_one_camera_has_one_channel():
    """Of an eye that has no camera there is no channel of NaN."""
    pairing = Pairing(frozenset({0}), 8e6)
    assert pairing.channels == ("diameter_right", "confidence")
    assert [row.values for row in pairing.push(Pupil(5, 0, 3.0, "mm", 0.5), 7)] == [(3.0, 0.5)]


def test_samples_without_a_rhythm_have_the_rate_0():
    """A rate is claimed only where four of five steps are one period."""
    random = np.random.default_rng(1)
    assert rate_hz(np.arange(0, 10**9, 8_333_333).tolist()) == 120.0
    assert rate_hz(np.cumsum(random.exponential(8e6, 100)).astype(int).tolist()) == 0.0


def test_events_and_notes_are_told_as_what_they_are():
    """Blinks, fixations, annotations and recordings, at their own time; our own annotations do not come back."""
    virtual = capture()
    virtual.annotate("stimulus", 0.5)
    virtual.record(True, 0.6)
    virtual.answer(list(annotation("sync", "1", 10**9)), 0.7)
    items, _ = listen(virtual, 6)
    notes = [each for each in items if isinstance(each, Note)]
    assert notes == [Note(5_000_500_000_000, "stimulus", ""), Note(5_000_600_000_000, "recording_started", "pilot")]
    names = {feature.name for each in items if isinstance(each, Event) for feature in each.features}
    assert {"blink_onset", "blink_offset", "fixation_duration", "fixation_dispersion"} <= names


@pytest.mark.parametrize(
    ("topic", "key", "spared"),
    [("pupil.0.3d", "diameter_3d", True), ("pupil.0.2d", "diameter", False), ("pupil.0", "diameter_3d", False)],
)
def test_2d_pictures_are_spared_only_where_others_carry_the_sizes(topic, key, spared):
    """Sizes in mm under a topic of their own; Capture before 2.0 has one topic for all, which must go on."""
    core, told, asked = Core(PupilConfig(sensor_id="core_1", address="127.0.0.1"), {}), Told(), []
    core._link = SimpleNamespace(hear_models_only=lambda: asked.append(told.in_mm))
    for number in range(150):
        said = {"id": 0, key: 3.0, "confidence": 1.0, "timestamp": 5000.0 + number / 120}
        assert not core._take(Heard(1, topic, msgpack.packb(said)), told, Silence([], 1.0))
    assert (bool(asked), all(asked)) == (spared, True)


NOW_NS = 1_795_000_000_000_000_000


@pytest.mark.parametrize(("said_s", "age_s"), [(5.0, 0.5), (-9.5, 15.0), (NOW_NS * 1e-9, 0.0), (900.0, 0.0)])
def test_an_annotation_of_another_clock_is_when_it_came(said_s, age_s):
    """A script that gives the time of day in place of Pupil time was stamped in 2083, which no message can say."""
    core, told, silence = Core(PupilConfig(sensor_id="core_1", address="127.0.0.1"), {}), Told(), Silence([], 10.0)
    measured = ClockMeasurement(NOW_NS, 5_500_000_000, NOW_NS - 5_500_000_000, 1e-4, "")
    assert list(core._take(measured, told, silence)) == [measured]
    note = msgpack.packb({"label": "stimulus", "timestamp": said_s})
    (marked,) = core._take(Heard(NOW_NS, "annotation", note), told, silence)
    assert marked.event_ns == NOW_NS - round(age_s * 1e9)


GOOD = {"norm_pos": [0.5, 0.5], "confidence": 1.0, "timestamp": 12.5}


@pytest.mark.parametrize(
    ("topic", "content", "said"),
    [
        ("gaze.3d.0.", GOOD | {"norm_pos": [0.5]}, "norm_pos"),
        ("gaze.3d.0.", GOOD | {"norm_pos": [0.5, math.nan]}, "norm_pos"),
        ("gaze.3d.0.", GOOD | {"timestamp": "now"}, "timestamp"),
        ("gaze.3d.0.", GOOD | {"timestamp": math.inf}, "timestamp"),
        ("gaze.3d.0.", GOOD | {"timestamp": 9.3e9}, "timestamp"),
        ("pupil.0.3d", GOOD | {"id": 0, "diameter_3d": 3.0, "timestamp": -9.3e9}, "timestamp"),
        ("notify.recording.started", {"subject": "recording.started", "start_time_synced": 1e11}, "start_time_synced"),
        ("pupil.2.3d", GOOD | {"id": 2, "diameter_3d": 3.0}, "id is 2"),
        ("pupil.0.3d", GOOD | {"id": 0, "diameter_3d": None}, "diameter_3d"),
        ("frame.world", {}, "not asked for"),
        ("fixations", GOOD, "duration"),
        ("gaze.3d.0.", [1, 2], "map"),
    ],
)
def test_what_cannot_be_is_said_with_its_field(topic, content, said):
    """A message that lacks something is refused by name."""
    with pytest.raises(FrameError, match=said):
        decode(topic, msgpack.packb(content))


@pytest.mark.parametrize("subject", [None, 5, ["recording.started"], {"recording.started": 1}])
def test_a_notice_whose_subject_is_no_text_concerns_nobody(subject):
    """It is passed over like any other notice that is no recording."""
    assert decode("notify.recording.started", msgpack.packb({"subject": subject})) is None


@given(seed=some.integers(0, 9999), cut=some.integers(0, 400), flip=some.integers(0, 3000))
def test_damaged_messages_are_frame_errors(seed, cut, flip):
    """Cut and flipped bytes of real messages never raise anything else."""
    messages = capture().send(0.1)
    topic, payload = messages[seed % len(messages)]
    damaged = bytearray(payload[: max(1, len(payload) - cut)])
    damaged[flip % len(damaged)] ^= 1 << (flip % 8)
    try:
        decode(topic.decode(), bytes(damaged))
    except FrameError:
        return


def test_a_frame_byte_by_byte():
    """The README's frame."""
    payload = bytes.fromhex(
        "84a8 6e6f726d5f706f73 92 cb3fe0000000000000 cb3fd8000000000000 aa 636f6e666964656e6365 cb3fef5c28f5c28f5c "
        "a9 74696d657374616d70 cb40b3884000000000 a9 626173655f64617461 90".replace(" ", "")
    )
    assert decode("gaze.3d.01.", payload) == Gaze(5_000_250_000_000, 0.5, 0.375, 0.98)


def test_while_pupil_time_stands_still_nothing_piles_up():
    """Gaze, and pictures of one of two eyes, are passed on though nothing tells any more what they wait for."""
    order, pairing = InOrder(1e8), Pairing(frozenset({0, 1}), 8e6)
    gaze = [row for _ in range(5000) for row in order.push(Gaze(10**12, 0.5, 0.5, 1.0), 1)]
    sizes = [row for _ in range(5000) for row in pairing.push(Pupil(10**12, 0, 3.0, "mm", 1.0), 1)]
    assert len(gaze) == len(sizes) == 5000 - MOST_HELD


def test_time_that_stands_still_is_told_at_the_end_too():
    """What waits of a Capture that is gone may be too much: a frame error then, which ends no driver."""
    _, told = listen(capture(calibrated=False), 2)
    for _ in range(MOST + MOST_HELD - 1):
        told.gaze(Gaze(1, 0.5, 0.5, 1.0), 1)
    assert any(isinstance(item, FrameError) for item in told.rest())


def test_a_first_second_that_never_ends_is_told():
    """Pictures of eyes all of one time say nothing of the cameras: they are left out, with their number."""
    told = Told()
    for _ in range(MOST):
        told.pupil(Pupil(10**12, 0, 3.0, "mm", 1.0), 1)
    with pytest.raises(FrameError, match=f"pictures of eyes: {MOST} readings within 1 s"):
        told.pupil(Pupil(10**12, 0, 3.0, "mm", 1.0), 1)
    assert told._first == []


def test_time_that_stands_still_ends_no_connection():
    """What is left out is handed on as an error like any other that cannot be used."""
    core, told = Core(PupilConfig(sensor_id="core_1", model="Core", address="127.0.0.1"), {}), Told()
    payload = msgpack.packb({"id": 0, "diameter_3d": 3.0, "confidence": 1.0, "timestamp": 1000.0})
    heard = Heard(1, "pupil.0.3d", payload)
    items = [item for _ in range(MOST + 1) for item in core._take(heard, told, Silence([], 1.0))]
    (error,) = items
    assert isinstance(error, FrameError)
