"""driver-lsl: samples keep LSL's own stamps, holes are told, events get the corrected time."""

import asyncio
import time
from itertools import chain, cycle

import driver_lsl.device
import numpy as np
import pylsl
import pytest
from driver_lsl.config import LslConfig
from driver_lsl.device import LslDevice, Tuned
from driver_lsl.transport import Measured, Opened, Pulled, Told, link
from listened import until
from lsl_descriptions import xml
from sense4hri import lsl_inlets
from sense4hri.arrivals import Arrival
from sense4hri.device import ClockMeasurement, Marked, Samples, number_text
from sense4hri.errors import DeviceLost
from sense4hri.holes import Holes, one_by_one
from sense4hri.intake import MOST_BYTES, check
from sense4hri.sample_clock import SampleClock
from sense4hri_msgs.msg import Marker

NOW_NS = 1_700_000_000_000_000_000
RATE_HZ, FRAME = 500, 25
EEG = xml("EEG", [("C3", "uV", ""), ("C4", "uV", "")], RATE_HZ)
EVENTS = xml("Markers", [("name", "", ""), ("value", "", "")], 0, "string", name="Keys")


def tuned(*descriptions, **more):
    return Tuned.to(descriptions, LslConfig(sensor_id="x", outlets=("name='a'",), **more))


def taken(device, news):
    return list(device.items(Arrival(NOW_NS, news)))


def frames(stamps_s, size=FRAME):
    """Return what an outlet sends, in frames: channel 0 counts."""
    for at in range(0, len(stamps_s), size):
        part = stamps_s[at : at + size]
        yield Pulled(0, np.column_stack([np.arange(at, at + len(part)), np.zeros(len(part))]).astype(float), part)


def through_the_kit(device, news):
    """Return how many samples came, how many the kit counts as lost."""
    clock, holes, came = SampleClock(RATE_HZ), Holes(RATE_HZ), 0
    for each in news:
        for item in taken(device, each):
            assert isinstance(item, Samples)
            chunks = [item.chunk] if item.times_ns is None else holes.cut(item.chunk, item.times_ns)
            for chunk in chunks:
                came += len(clock.place(chunk).samples)
    return came, clock.lost_samples_total


@pytest.mark.parametrize("seed", range(5))
def test_every_lost_sample_of_an_even_stream_is_counted(seed):
    """Ten minutes, 1 % lost one by one and in bursts: in = out + counted."""
    rng = np.random.default_rng(seed)
    sent = np.arange(RATE_HZ * 600)
    kept = rng.random(len(sent)) > 0.01
    kept[100_000:100_700] = False
    kept[:1000], kept[-50:] = True, True
    came, lost = through_the_kit(tuned(EEG), frames(1000 + sent[kept] / RATE_HZ))
    assert came == kept.sum()
    assert came + lost == len(sent)


@pytest.mark.parametrize("seed", range(3))
def test_jitter_of_a_sender_that_stamps_on_arrival_is_no_loss(seed):
    """Stamps that stray by 3 ms at 500 Hz lose nothing, and nothing is said to be lost."""
    rng = np.random.default_rng(seed)
    stamps = 1000 + np.arange(RATE_HZ * 60) / RATE_HZ + rng.uniform(0, 0.003, RATE_HZ * 60)
    assert through_the_kit(tuned(EEG), frames(stamps)) == (len(stamps), 0)


@pytest.mark.parametrize("chunk", [50, 75, 100])
@pytest.mark.parametrize("seed", range(3))
def test_jitter_of_a_sender_that_pushes_chunks_is_no_loss(seed, chunk):
    """liblsl spaces stamps evenly inside a pushed chunk: edges alone jitter, here by up to 10 ms at 500 Hz."""
    edges = np.random.default_rng(seed).uniform(0, 0.01, RATE_HZ * 60 // chunk)
    stamps = 1000 + np.arange(len(edges) * chunk) / RATE_HZ + np.repeat(edges, chunk)
    assert through_the_kit(tuned(EEG), frames(stamps, 37)) == (len(stamps), 0)


def test_a_sender_that_was_restarted_shows_its_new_clock():
    """Stamps go back: they are passed on as they are, and the kit sees a reset."""
    device = tuned(EEG)
    before = [item for news in frames(650_000 + np.arange(100) / RATE_HZ) for item in taken(device, news)]
    after = [item for news in frames(12 + np.arange(100) / RATE_HZ) for item in taken(device, news)]
    assert before[-1].chunk.device_ns == pytest.approx(650_000.198e9, abs=1000)
    assert after[0].chunk.device_ns == pytest.approx(12.048e9, abs=1000)


def test_irregular_samples_have_each_their_own_stamp():
    """Rate 0: the kit makes a message of each."""
    device = tuned(xml("Gaze", [("gaze_x", "px", ""), ("gaze_y", "px", "")], 0))
    stamps = np.array([5.0, 5.1, 5.15])
    items = taken(device, Pulled(0, np.ones((3, 2)), stamps))
    assert [item.times_ns.tolist() for item in items] == [[5_000_000_000, 5_100_000_000, 5_150_000_000]]
    assert [item.lost for item in items] == [None], "nobody can know what an irregular sender skipped"


def test_a_stamp_of_nothing_is_no_time():
    """0, NaN and what no clock can show are 'the device gives no time', never invented."""
    device = tuned(xml("Gaze", [("gaze_x", "px", ""), ("gaze_y", "px", "")], 0))
    (item,) = taken(device, Pulled(0, np.ones((3, 2)), np.array([0.0, np.nan, 1e300])))
    assert [each.device_ns for each in one_by_one(item.chunk, item.times_ns)] == [None, None, None]


@pytest.mark.parametrize("at", [5 * RATE_HZ, 5 * RATE_HZ + FRAME // 2, 6 * RATE_HZ - 1])
@pytest.mark.parametrize("stamp", [0.0, np.nan, 1e300])
def test_a_stamp_of_nothing_among_even_ones_is_no_loss(stamp, at):
    """Wherever in its frame: from 1970 to the next stamp half a million samples were missing."""
    stamps = 1000 + np.arange(RATE_HZ * 10) / RATE_HZ
    stamps[at] = stamp
    assert through_the_kit(tuned(EEG), frames(stamps)) == (len(stamps), 0)


def test_an_event_has_the_corrected_time():
    """What the sender stamped plus the offset measured both ways; name first, the other channels its value."""
    device = tuned(EVENTS)
    taken(device, Measured(50_000_000_000, NOW_NS - 50_500_000_000, 1e-4))
    (marked,) = taken(device, Told(0, [["stimulus", "face 3"]], np.array([50.25])))
    assert marked == Marked(NOW_NS - 250_000_000, 50_250_000_000, "stimulus", "face 3")


@pytest.mark.parametrize("measured_s", [36.0, 51.0])
def test_an_event_that_was_held_up_has_the_corrected_time(measured_s):
    """Sent again after 15 s of a bad network, before the clock is measured again or after: it is no other clock."""
    device, offset_ns = tuned(EVENTS), NOW_NS - 51_000_000_000
    taken(device, Measured(round(measured_s * 1e9), offset_ns, 1e-4))
    (marked,) = taken(device, Told(0, [["a", ""]], np.array([36.0])))
    (late,) = taken(device, Told(0, [["b", ""]], np.array([50.9])))
    assert (marked.event_ns, late.event_ns) == (NOW_NS - 15_000_000_000, NOW_NS - 100_000_000)


JSON = '{"trial": "' + 300 * "x" + '"}'


@pytest.mark.parametrize(
    ("row", "name", "value"),
    [
        (["", "only a value"], "only a value", ""),
        (["stimulus", "", "face 3"], "stimulus", "face 3"),
        ([JSON], "Keys", JSON),
        ([JSON, "b"], "Keys", f"{JSON} b"),
    ],
)
def test_whatever_an_event_says_is_in_its_marker(row, name, value):
    """A name has 256 characters at most, by which every service takes it in; a longer text is the value."""
    (marked,) = taken(tuned(EVENTS), Told(0, [row], np.array([50.25])))
    assert (marked.name, marked.value) == (name, value)
    check(Marker(name=marked.name, value=marked.value))


@pytest.mark.parametrize(
    ("row", "why"),
    [(["", ""], "without any text"), (["a", "x" * 65537], "with 65537 characters, at most 65536 can be")],
)
def test_an_event_that_no_marker_can_tell_is_counted(row, why):
    """There is nothing to tell of it, or more than any service takes in, which is told."""
    (error,) = taken(tuned(EVENTS), Told(0, [row], np.array([50.25])))
    assert str(error) == f"an event of 'Keys' {why}"


def test_an_event_of_an_unknown_clock_is_when_it_came():
    """Without a measurement of the clock of its stamp there is nothing to correct with."""
    device = tuned(EVENTS)
    taken(device, Measured(50_000_000_000, 7_000_000_000, 1e-4))
    items = taken(device, Told(0, [["a", ""]], np.array([1_700_000_000.0])))
    assert [item.event_ns for item in items] == [NOW_NS]


@pytest.mark.parametrize(
    ("value", "text"), [(16711680.0, "16711680"), (-3.0, "-3"), (float(np.float32(1.1)), "1.1"), (1 / 3, f"{1 / 3!r}")]
)
def test_numbers_of_events_keep_their_digits(value, text):
    """A trigger word of 24 bits is not rounded, and one of single precision has no digits it never had."""
    assert number_text(value) == text


def test_whole_numbers_are_events_too():
    """An int stream of markers names each event by its number."""
    device = tuned(xml("Markers", [("code", "", "")], 0, "int32"))
    assert [each.name for each in taken(device, Pulled(0, np.array([[7.0], [255.0]]), np.array([1.0, 2.0])))] == [
        "7",
        "255",
    ]


class Waiting:
    """An inlet in which samples wait, 0.5 ms apart."""

    def __init__(self, rows):
        self.channel_format, self.channel_count, self._rows = pylsl.cf_int64, rows.shape[1], rows

    def pull_chunk(self, timeout, max_samples, as_numpy):
        taken, self._rows = self._rows[:max_samples], self._rows[max_samples:]
        return taken, [5.0 + number / 2000 for number in range(len(taken))]


def test_an_event_of_64_bits_keeps_its_digits():
    """A time in ns, a word of 64 bits: a float64 would round it."""
    codes = [1_795_676_233_836_183_717, 2**53 + 1]
    (pulled,) = lsl_inlets._pulled(0, Waiting(np.array([codes], np.int64)))
    (marked,) = taken(tuned(xml("Markers", [("a", "", ""), ("b", "", "")], 0, "int64")), pulled)
    assert (marked.name, marked.value) == (str(codes[0]), str(codes[1]))


@pytest.mark.parametrize("channels", [1, 64, 256, 1024])
def test_what_has_waited_comes_in_messages_that_services_take_in(channels):
    """Two seconds of 256 channels at 2000 Hz, as they wait at a start, are 8 MB; nothing of them is left out."""
    parts = [pulled.samples for pulled in lsl_inlets._pulled(0, Waiting(np.ones((4000, channels), np.int64)))]
    assert sum(len(part) for part in parts) == 4000
    assert max(part.nbytes for part in parts) < MOST_BYTES / 2


class Going:
    """An inlet in which a row waits at each look, and whose outlet goes after so many."""

    channel_format, channel_count = pylsl.cf_int64, 1

    def __init__(self, rows):
        self._rows = iter(range(rows))

    def pull_chunk(self, timeout, max_samples, as_numpy):
        for number in self._rows:
            return np.array([[number]]), np.array([1000 + number / 50])
        raise pylsl.util.LostError


@pytest.mark.parametrize("rows", [(10, 1000), (1000, 10)])
def test_what_has_come_before_an_outlet_goes_is_handed_on(rows):
    """liblsl keeps it to itself once it knows: it is looked for often, of the others too, and comes together."""
    came = []
    with pytest.raises(pylsl.util.LostError):
        came.extend(lsl_inlets._gathered([Going(each) for each in rows], 5.0))
    assert [each.outlet for each in came] == [0, 1]
    for each in came:
        assert each.samples[:, 0].tolist() == list(range(len(each.stamps_s)))
        assert len(each.stamps_s) == pytest.approx(10, abs=1)


def test_a_measurement_of_another_clock_than_the_stamps_is_not_passed_on():
    """A sender that stamps with the time of day is not measured by LSL, which knows its machine's uptime."""
    own, foreign = tuned(EEG), tuned(EEG)
    measured = Measured(1000_000_000_000, 5, 1e-4)
    assert taken(own, measured) == []
    taken(own, next(frames(1000 + np.arange(25) / RATE_HZ)))
    taken(foreign, next(frames(1.7e9 + np.arange(25) / RATE_HZ)))
    assert [type(item) for item in taken(own, measured)] == [ClockMeasurement]
    assert taken(foreign, measured) == []


def test_outlets_of_two_machines_are_refused():
    """Their clocks differ, and a sensor has one."""
    with pytest.raises(Exception, match="one driver for each machine"):
        tuned(EEG, EVENTS.replace("lab-2", "lab-3"))


@pytest.mark.parametrize(("rate_hz", "patience_s"), [(0.1, 30.0), (0.5, 6.0), (250.0, 5.0), (0.0, 0.0)])
def test_a_slow_outlet_is_not_lost_between_two_of_its_samples(rate_hz, patience_s):
    """Silent is who misses three samples, and nobody before silence_s; an irregular one never is."""
    device = tuned(xml("Temperature", [("t", "degC", "")], rate_hz))
    assert device.patience_s(5.0) == ({"Amp": pytest.approx(patience_s)} if rate_hz else {})


@pytest.mark.parametrize(
    ("rate_hz", "samples"), [(250.0, 15_000), (48_000.0, 1 << 21), (1e6, 1 << 21), (1e-2, 16), (0.0, 36_000)]
)
def test_an_inlet_holds_a_minute_of_a_stream_as_far_as_memory_goes(rate_hz, samples):
    """liblsl takes memory for all of it at once: 270 MB of 48 kHz, by its own 360 s; with room for none it halts."""
    assert lsl_inlets._held(rate_hz) * (rate_hz or 100) == pytest.approx(samples, rel=0.5)


SLOW = xml("Temperature", [("t", "degC", "")], 0.1)
NEWS = next(frames(1000 + np.arange(float(FRAME))))


@pytest.mark.parametrize(("descriptions", "patience_s"), [((EEG, SLOW), (5.0, 30.0)), ((SLOW, EEG), (30.0, 5.0))])
def test_outlets_of_one_name_are_watched_each(descriptions, patience_s):
    """OpenSignals calls all its outlets alike: each is waited for as its own rate asks, in whichever order."""
    assert tuned(*descriptions).patience_s(5.0) == pytest.approx(dict(zip(("Amp", "Amp_1"), patience_s, strict=True)))


class OneOfTwo:
    """Two outlets of one name, of which the first alone goes on sending."""

    first = EEG

    def __init__(self, *_):
        self._news = chain([Opened((self.first, EEG.replace("EEG", "ECG")))], cycle([NEWS]))

    def read(self):
        time.sleep(0.05)
        return next(self._news)

    def close(self):
        pass


@pytest.mark.parametrize("rate_hz", [RATE_HZ, 0.1])
def test_an_outlet_that_falls_silent_is_not_hidden_by_another_of_its_name(monkeypatch, rate_hz):
    """It is lost after silence_s, while the other goes on, however slow that one is."""
    monkeypatch.setattr(driver_lsl.device, "link", OneOfTwo)
    monkeypatch.setattr(OneOfTwo, "first", EEG.replace(f">{RATE_HZ}<", f">{rate_hz}<"))

    async def listen():
        device = LslDevice(LslConfig(sensor_id="x", outlets=("type='EEG'", "type='ECG'"), silence_s=3.0), {})
        await until(device.stream(), lambda item: False)

    with pytest.raises(DeviceLost, match="no Amp_1 for 3 s"):
        asyncio.run(asyncio.wait_for(listen(), 20.0))


class Mute:
    """An outlet that is heard and answers nothing, as pylsl tells it; its description and its inlet."""

    def __init__(self, *args, **options):
        pass

    def channel_count(self):
        return 1

    def nominal_srate(self):
        return 250.0

    def open_stream(self, timeout):
        raise pylsl.util.TimeoutError("the operation failed due to a timeout.")


def test_an_outlet_that_is_heard_and_does_not_answer_is_a_lost_device(monkeypatch):
    """A firewall, or a program that hangs: the driver looks again; pylsl's TimeoutError is none of Python's."""
    monkeypatch.setattr(pylsl, "resolve_bypred", lambda *args: [Mute()])
    monkeypatch.setattr(pylsl, "StreamInlet", Mute)
    with pytest.raises(DeviceLost, match="heard and does not answer"):
        link(LslConfig(sensor_id="x", outlets=("name='a'",))).read()
