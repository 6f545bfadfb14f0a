"""Simulated muscles whose amplitude, spectrum and times of work are known."""

import numpy as np
import pytest
from emg_signals import density, muscle
from interpreter_emg.cleaning import Cleaner
from interpreter_emg.config import Config
from interpreter_emg.effort import greatest_rms
from interpreter_emg.stream import EmgStream
from sense4hri.step import Marker
from slow_signals import T0_NS, event_times_s
from slow_signals import play as play_signal

BURSTS_S = [(5.0, 7.0), (10.0, 10.3), (13.0, 16.0), (20.0, 24.0)]
NAMES = ("biceps", "triceps", "deltoid")


def play(samples, fs_hz, unit="uV", names=("biceps",), config=None, **options):
    """Updates of electromyograms."""
    make = options.pop("make", lambda info: EmgStream(config or Config(), info))
    return play_signal(make, samples, fs_hz, "emg", unit, names, **options)


@pytest.mark.parametrize("true_hz", [930.0, 1100.0])
def test_frequencies_are_those_of_the_true_rate(true_hz):
    """A board declared with 1000 Hz that comes faster or slower: the muscle's frequencies all the same; it is said."""
    samples = muscle(20, true_hz, [(7.0, 20.0)])
    known, declared = play(samples, true_hz)[15], play(samples, 1000.0, true_hz=true_hz)[15]
    assert declared.mean_frequency_hz[0] == pytest.approx(known.mean_frequency_hz[0], rel=0.02)
    assert any(reason.startswith("sampling_frequency_hz is 1000, measured") for reason in declared.reasons)
    assert known.rms_uv[0] == pytest.approx(declared.rms_uv[0], rel=0.05)


@pytest.mark.parametrize("fs_hz", [200.0, 500.0, 1000.0, 2048.0])
def test_work_is_found_when_it_is(fs_hz):
    """At any rate: every burst, also one of 0.3 s, once; onset within 30 ms, end within 80 ms; rest at the end."""
    updates = play(muscle(27, fs_hz, BURSTS_S), fs_hz)
    np.testing.assert_allclose(event_times_s(updates, "onset_timestamps"), [b for b, _ in BURSTS_S], atol=0.03)
    np.testing.assert_allclose(event_times_s(updates, "offset_timestamps"), [e for _, e in BURSTS_S], atol=0.08)
    assert [updates[i].active[0] for i in (8, 14, 21, 25)] == [False, True, True, False]


def test_events_are_told_once_soon_and_with_their_channel():
    """Three channels that work at different times: each event names its channel, in order, less than 2 s old."""
    begins = {"biceps": 4.0, "triceps": 5.0, "deltoid": 6.0}
    samples = np.array([muscle(12, 1000.0, [(b, b + 3)], seed=i) for i, b in enumerate(begins.values())]).T
    updates = play(samples, 1000.0, names=NAMES)
    told = dict(
        zip(*([x for u in updates for x in getattr(u, f)] for f in ("onset_channels", "onset_timestamps")), strict=True)
    )
    assert list(told) == list(NAMES)
    for name, begin_s in begins.items():
        assert (told[name] - T0_NS) / 1e9 == pytest.approx(begin_s, abs=0.02)
    assert [x for u in updates for x in u.offset_channels] == list(NAMES)
    for update in updates:
        assert all(0 <= update.device_ns - at < 2e9 for at in (*update.onset_timestamps, *update.offset_timestamps))


def test_events_of_all_channels_are_in_order_from_update_to_update():
    """Muscles that begin exactly together, and a weak one, seen later, 50 ms before them, have one order."""
    begins = np.arange(7.66, 29, 3.03)  # passes through the phases of the grid
    alike = muscle(32, 1000.0, [(b, b + 1.5) for b in begins], seed=1)
    weak = muscle(32, 1000.0, [(b - 0.05, b + 1.5) for b in begins], rms_uv=2.5, rest_uv=1.0, seed=2)
    updates = play(np.array([alike, alike, weak]).T, 1000.0, names=NAMES)
    for field in ("onset_timestamps", "offset_timestamps"):
        times_ns = [x for update in updates for x in getattr(update, field)]
        assert len(times_ns) == 3 * len(begins)
        assert np.all(np.diff(times_ns) > 0)
        assert all(update.device_ns - x < 2e9 for update in updates for x in getattr(update, field))
    assert [name for update in updates for name in update.onset_channels][::3] == ["deltoid"] * len(begins)


@pytest.mark.parametrize("fs_hz", [1000.0, 2048.0])
def test_amplitude_and_frequencies_are_those_of_the_muscle(fs_hz):
    """On average over 20 s of work: RMS within 5 %, MAV that of a Gaussian, mean and median frequency within 8 %."""
    updates = play(muscle(25, fs_hz, [(3, 25)]), fs_hz)[4:]
    at_hz = np.arange(20.0, 450.0)
    power = density(at_hz)
    mean_hz, median_hz = power @ at_hz / power.sum(), at_hz[np.searchsorted(np.cumsum(power), power.sum() / 2)]
    found = {
        name: np.mean([getattr(u, name)[0] for u in updates])
        for name in ("rms_uv", "mav_uv", "mean_frequency_hz", "median_frequency_hz")
    }
    assert found["rms_uv"] == pytest.approx(
        100 * np.sqrt(power.sum() / density(np.arange(0.0, fs_hz / 2)).sum()), rel=0.05
    )
    assert found["mav_uv"] / found["rms_uv"] == pytest.approx(np.sqrt(2 / np.pi), rel=0.02)
    assert found["mean_frequency_hz"] == pytest.approx(mean_hz, rel=0.08)
    assert found["median_frequency_hz"] == pytest.approx(median_hz, rel=0.08)


class Marked(EmgStream):
    """Is told a marker `mvc` before the first samples at its time; at_s and values by the test."""

    markers: tuple[tuple[float, str], ...] = ()

    def push(self, timed):
        due = [each for each in self.markers if T0_NS + each[0] * 1e9 <= timed.received_ns]
        self.markers = self.markers[len(due) :]
        for at_s, value in due:
            self.marker(Marker(T0_NS + round(at_s * 1e9), None, 0.0, "", "p1", "mvc", value, ""))
        return super().push(timed)


def marked(*markers, config=None):
    """A maker of steps that are told these markers."""

    def make(info):
        step = Marked(config or Config(), info)
        step.markers = markers
        return step

    return make


def test_effort_is_told_against_the_greatest_one():
    """After a marker `mvc` half the amplitude is 50 %; of two efforts the greater counts; before, nothing is told."""
    strong, weak, half = (muscle(3, 1000.0, [(0.5, 2.5)], rms_uv=rms, seed=i) for i, rms in enumerate((200, 150, 100)))
    rest = muscle(4, 1000.0, [])
    updates = play(np.concatenate([rest, weak, rest, strong, rest, half]), 1000.0, make=marked((4.0, ""), (11.0, "")))
    assert np.isnan(updates[3].mvc_percent[0])
    assert any("no marker mvc" in reason for reason in updates[3].reasons)
    assert updates[12].mvc_percent[0] > 110 * 200 / 150 * 0.7
    assert updates[19].mvc_percent[0] == pytest.approx(43, abs=8)
    assert not any("mvc" in reason for reason in updates[-1].reasons)


def test_one_huge_sample_is_no_greatest_effort():
    """20 mV in a single sample, within an effort or beside it, change its greatest RMS by no more than a fifth."""
    samples = muscle(12, 1000.0, [(5, 7.5)], rms_uv=300)
    for at_s in (4.2, 5.01, 6.0, 7.52, 8.0):
        popped = samples.copy()
        popped[round(1000 * at_s)] += 20_000.0
        last, plain = (play(each, 1000.0, make=marked((4.0, "")))[-1] for each in (popped, samples))
        assert last.extra[1].values[0] == pytest.approx(plain.extra[1].values[0], rel=0.2)


@pytest.mark.parametrize("length_s", [0.4, 0.5, 1.0, 3.0])
def test_an_ordinary_effort_is_not_cut(length_s):
    """Wherever it begins, the greatest RMS of an effort is that of its samples within 5 %."""
    for begin_s in (5.0, 5.1, 5.2, 5.3, 5.4):
        samples = muscle(12, 1000.0, [(begin_s, begin_s + length_s)], seed=3)
        values = Cleaner(1000.0, 1, (0.0, 0.0)).push(samples[:, None]).values[4000:9000, 0]
        whole = np.sqrt(np.convolve(values**2, np.ones(500) / 500, "valid").max())
        assert greatest_rms(values, 500) == pytest.approx(whole, rel=0.05)


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("most_uv", [150.0, 250.0])
def test_an_effort_beyond_the_range_is_no_hundred_percent(most_uv, declared):
    """It rises to 200 uV, cut at 150 or 250: what was before is not the greatest; a whole one after it counts."""
    rises = np.interp(np.arange(18_000) / 1000, [4.5, 7.5, 8.5, 8.6], [0.0, 1.0, 1.0, 0.0])
    samples = muscle(18, 1000.0, [(4.5, 8.6)], rms_uv=200) * rises + muscle(18, 1000.0, [(12, 14)], rms_uv=30)
    limits = {"range_min": -most_uv, "range_max": most_uv} if declared else {}
    updates = play(np.clip(samples, -most_uv, most_uv), 1000.0, make=marked((4.0, ""), (11.0, "")), **limits)
    assert np.isnan(updates[9].extra[1].values[0])
    assert any("mvc of biceps: the range ends" in reason for reason in updates[9].reasons)
    assert updates[-1].extra[1].values[0] == pytest.approx(32, rel=0.25)


def test_a_marker_for_one_channel_and_one_without_effort():
    """The marker's value names the muscle; where nobody pulled, or there is no such channel, that is told."""
    samples = np.array([muscle(14, 1000.0, [(5, 8)], seed=1), muscle(14, 1000.0, [], seed=2)]).T
    only = play(samples, 1000.0, names=NAMES[:2], make=marked((4.0, "biceps")))[-1]
    assert np.isnan(only.mvc_percent).tolist() == [False, True]
    assert any("triceps" in reason for reason in only.reasons)
    both = play(samples, 1000.0, names=NAMES[:2], make=marked((4.0, "")))[-1]
    assert np.isnan(both.mvc_percent).tolist() == [False, True]
    assert any("mvc of triceps: no effort" in reason for reason in both.reasons)
    strange = play(samples, 1000.0, names=NAMES[:2], make=marked((4.0, "soleus")))[-1]
    assert any("'soleus'" in reason for reason in strange.reasons)


def test_an_effort_needs_no_sample_before_its_marker():
    """A marker before the first sample is for those that follow, and is judged when rest is known."""
    samples = muscle(12, 1000.0, [(3, 4.5)])
    last = play(samples, 1000.0, make=marked((-1.0, "")))[-1]
    assert last.extra[1].values[0] == pytest.approx(95, rel=0.15)
    assert not any("mvc" in reason for reason in last.reasons)


def test_rest_is_no_effort_before_rest_is_known():
    """Of 1 s of rest at the very beginning nothing is 100 %, and the reason changes when rest is known."""
    updates = play(muscle(6, 1000.0, []), 1000.0, make=marked((0.0, ""), config=Config(mvc_s=1.0)))
    assert np.isnan([update.mvc_percent[0] for update in updates]).all()
    assert any("not judged before" in reason for reason in updates[1].reasons)
    assert any("no effort" in reason for reason in updates[-1].reasons)


def test_an_effort_outlives_lost_frames_and_no_lost_minute():
    """One lost frame within an effort changes its maximum by little; after a long hole the effort is none."""
    samples = muscle(30, 1000.0, [(5, 7.5)])
    options = {"make": marked((4.0, "")), "sizes": [100] * 300}
    maxima = [play(samples, 1000.0, lost=lost, **options)[-1].extra[1].values[0] for lost in ([], [(6.0, 6.1)])]
    assert maxima[1] == pytest.approx(maxima[0], rel=0.1)
    last = play(samples, 1000.0, lost=[(6.0, 26.0)], **options)[-1]
    assert np.isnan(last.extra[1].values[0])
    assert any("samples are missing after the marker" in reason for reason in last.reasons)


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One signal, with missing samples, in frames of one, of 70 and of random sizes gives the same updates."""
    samples = np.array([muscle(14, 250.0, BURSTS_S, seed=i) for i in range(2)]).T
    samples[900:1000, 0] = np.nan
    sizes = ([1] * 3500, [70] * 50, np.random.default_rng(2).integers(1, 200, 400).tolist())
    texts = [
        repr([update._replace(received_ns=0) for update in play(samples, 250.0, names=NAMES[:2], sizes=cut)])
        for cut in sizes
    ]
    assert texts[0] == texts[1] == texts[2]
    assert "onset_channels=('biceps'" in texts[0]
