"""What is published when the signal is poor, absent, or better on another channel."""

from itertools import pairwise

import numpy as np
import pytest
from interpreter_ppg.config import Config
from interpreter_ppg.stream import DeviceRate, PpgStream
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

FS_HZ = 55
TIMES_S = np.arange(0, 90, 1 / FS_HZ)
BEATS = np.arange(0.3, 95, 0.86) + 0.02 * np.sin(np.arange(111))


def info(fs_hz, names=("ppg_0",), **limits):
    """What the kit knows of the stream."""
    return StreamInfo(StreamName("p1", "ppg", "s1"), fs_hz, "counts", names, **limits)


def pleth(noise=0.0, seed=0, times_s=TIMES_S):
    """A pulse wave of 3000 counts on 4e5 counts, with white noise of the given share."""
    random = np.random.default_rng(seed)
    after = times_s[:, None] - BEATS
    x = (np.exp(-0.5 * ((after - 0.2) / 0.085) ** 2) + 0.35 * np.exp(-0.5 * ((after - 0.47) / 0.13) ** 2)).sum(1)
    return 4e5 + 3000 * (x + noise * random.normal(size=len(times_s)))


def play(channels, config=None, reports=(), **limits):
    """Every update of a recording given by channel name; reports: (s, name, value) of the device."""
    samples = np.stack(list(channels.values()), 1)
    clock, step, updates = SampleClock(FS_HZ), PpgStream(config or Config(), info(FS_HZ, tuple(channels), **limits)), []
    reports = list(reports)
    for start in range(0, len(samples), 11):
        part = samples[start : start + 11]
        stamp_ns = round((start + len(part)) / FS_HZ * 1e9) + 10**18
        while reports and reports[0][0] * 1e9 + 10**18 <= stamp_ns:
            at_s, name, value = reports.pop(0)
            step.device_reported(name, value, round(at_s * 1e9) + 10**18)
        updates += step.push(clock.place(Chunk(tuple(channels), part, stamp_ns, stamp_ns)))
    return updates


def nothing_is_claimed(updates):
    for update in updates:
        assert not update.peak_timestamps
        assert np.isnan(update.heart_rate_bpm)
        assert np.isnan(update.rr_interval_ms)
        assert np.isnan(update.pulse_amplitude)
        assert not update.signal_quality > 0
        assert any("no pulse" in reason for reason in update.reasons)


@pytest.mark.parametrize("level", [0.0, 4e5, 8_388_607.0, -1e6])
def test_a_flat_line_has_no_pulse(level):
    """A constant signal gives no pulse and no rate, and says that it is flat."""
    updates = play({"ppg_0": np.full(len(TIMES_S), level)})
    nothing_is_claimed(updates)
    assert "ppg_0 is flat" in updates[-1].reasons


def test_a_saturated_signal_says_so():
    """A signal at the end of its range gives no pulse and says that it is saturated."""
    updates = play({"ppg_0": np.full(len(TIMES_S), 4095.0)}, range_min=0, range_max=4095)
    nothing_is_claimed(updates)
    assert "ppg_0 is saturated" in updates[-1].reasons


def test_a_step_on_a_flat_line_is_no_pulse_train():
    """A dead sensor whose level steps once gives at most that one event, and no rate."""
    updates = play({"ppg_0": np.where(TIMES_S < 40, 1e5, 2e5)})
    assert sum(len(update.peak_timestamps) for update in updates) <= 1
    assert all(np.isnan(update.heart_rate_bpm) for update in updates)


def test_what_is_not_a_number_is_no_signal():
    """NaN and infinity in the samples hide the pulses they cover and harm nothing else."""
    x = pleth()
    x[(TIMES_S > 30) & (TIMES_S < 34)] = np.nan
    x[1000] = np.inf
    updates = play({"ppg_0": x})
    times_s = np.array([(t - 10**18) / 1e9 for update in updates for t in update.peak_timestamps])
    assert not np.any((times_s > 30.4) & (times_s < 33.9))
    assert len(times_s) > 94
    nothing_is_claimed(play({"ppg_0": np.full(len(TIMES_S), np.nan)}))


def test_quality_falls_with_noise_and_withholds_results():
    """Each step of a noise ladder lowers the quality; below the stated one rate and variability are withheld."""
    ladder = [play({"ppg_0": pleth(noise)})[20:] for noise in (0.0, 0.2, 0.4, 0.8, 1.6)]
    quality = [np.mean([update.signal_quality for update in updates]) for updates in ladder]
    assert quality[0] > 0.97
    assert all(one > other for one, other in pairwise(quality))
    assert quality[-1] < 0.35
    for update in ladder[-1]:
        if update.signal_quality < 0.5:
            assert np.isnan(update.heart_rate_bpm)
            assert np.isnan(update.hrv.mean_nn_ms)
            assert any("signal_quality below 0.5" in reason for reason in update.reasons)


def test_noise_alone_has_no_heart_rate():
    """White, pink and brown noise are never called a good signal."""
    random = np.random.default_rng(1)
    f = np.maximum(np.fft.rfftfreq(len(TIMES_S)), 1e-3)
    for power in (0.0, 0.5, 1.0):
        spectrum = (random.normal(size=len(f)) + 1j * random.normal(size=len(f))) / f**power
        updates = play({"ppg_0": 4e5 + 100 * np.fft.irfft(spectrum, len(TIMES_S))})
        rates = [update.heart_rate_bpm for update in updates]
        assert np.isfinite(rates).sum() <= 3, power


def test_the_best_channel_is_chosen_and_kept():
    """Features come from the clean channel, whichever it is, and never from the ambient light."""
    for clean in (0, 1, 2):
        channels = {f"ppg_{i}": pleth(0.02 if i == clean else 1.0, seed=i) for i in range(3)}
        updates = play({**channels, "ambient": pleth()})
        names = [update.channel_name for update in updates[5:]]
        assert names == [f"ppg_{clean}"] * len(names)


def test_a_channel_that_fails_is_left():
    """When the chosen channel loses its signal another one takes over within 12 s; the change makes no interval."""
    failing, other = pleth(), pleth(0.05, seed=3)
    failing[TIMES_S > 40] = 4e5
    updates = play({"ppg_0": failing, "ppg_1": other})
    names = [update.channel_name for update in updates]
    assert names[30] == "ppg_0"
    change = names.index("ppg_1", 40)
    assert change < 52
    assert set(names[change:]) == {"ppg_1"}
    times_ns = [t for update in updates for t in update.peak_timestamps]
    assert np.all(np.diff(times_ns) > 0)
    rr_ms = [rr for update in updates[change : change + 2] for rr in update.rr_intervals_ms]
    assert np.isnan(rr_ms[0])


def test_similar_channels_are_not_alternated():
    """Channels of equal quality never alternate."""
    updates = play({f"ppg_{i}": pleth(0.1, seed=i) for i in range(3)})
    assert len({update.channel_name for update in updates[5:]}) == 1


def test_the_device_is_compared_at_a_fixed_age():
    """The difference is to the newest rate the device reported 1 to 6 s before; zeros do not count."""
    rate = DeviceRate()
    for at_s, value in ((10.0, 60.0), (12.0, 64.0), (12.5, 0.0), (14.0, 90.0)):
        rate.add("heart_rate", value, round(at_s * 1e9))
    assert rate.at(13_000_000_000) == 64.0
    assert rate.at(12_900_000_000) == 60.0
    assert rate.at(20_000_000_000) == 90.0
    assert np.isnan(rate.at(20_100_000_000))
    assert np.isnan(rate.at(9_000_000_000))


def test_intervals_stand_in_for_a_rate():
    """A device that reports pulse intervals but no rate is compared by the rate of these."""
    reports = [(at_s, "pp_interval", 1000.0) for at_s in np.arange(1, 89, 1.0)]
    last = play({"ppg_0": pleth()}, reports=reports)[-1]
    assert last.device_heart_rate_difference_bpm == pytest.approx(last.heart_rate_bpm - 60.0, abs=1e-9)
    assert np.isnan(play({"ppg_0": pleth()})[-1].device_heart_rate_difference_bpm)


def test_every_missing_value_has_a_reason():
    """Where a value of an update is NaN there is a reason, and where nothing is there is none."""
    reports = [(at_s, "heart_rate", 70.0) for at_s in np.arange(0, 400, 1.0)]
    for update in play({"ppg_0": pleth()}, reports=reports):
        values = [value for value in (*update, *update.hrv) if isinstance(value, float)]
        assert np.isnan(values).any() == bool(update.reasons)


@pytest.mark.parametrize(
    ("fs_hz", "names", "reason"),
    [(10.0, ("ppg_0",), "is 10, below 20 Hz"), (55.0, ("ambient",), "no pulse channel among ambient")],
)
def test_a_stream_without_pulses_is_refused(fs_hz, names, reason):
    """A rate below 20 Hz and a stream of ambient light alone are refused, each with its reason."""
    with pytest.raises(ValueError, match=reason):
        PpgStream(Config(), info(fs_hz, names))


def test_a_rate_that_turns_out_too_low_is_named():
    """Where the rate is not declared and the samples are too far apart nothing is computed, and the reason names it."""
    clock, step = SampleClock(0.0), PpgStream(Config(), info(0.0))
    updates = []
    for i in range(600):
        stamp_ns = 10**18 + (i + 1) * 10**8
        part = pleth(times_s=np.array([i / 10]))[:, None]
        updates += step.push(clock.place(Chunk(("ppg_0",), part, stamp_ns, stamp_ns)))
    nothing_is_claimed(updates)
    assert "sampling rate 10 Hz is below 20 Hz" in updates[-1].reasons


@pytest.mark.parametrize(
    ("name", "value"),
    [("update_interval_s", 0.0), ("window_s", 1.0), ("hrv_window_s", 5.0), ("min_quality", 2.0), ("polarity", "up")],
)
def test_wrong_parameters_are_named(name, value):
    """A parameter out of its range is an error that names it."""
    with pytest.raises(ValueError, match=name):
        Config(**{name: value})


def test_given_polarity_is_kept():
    """With a given polarity the pulse is timed on that edge, whatever the shape looks like."""
    (right, wrong) = (play({"ppg_0": pleth()}, config=Config(polarity=polarity)) for polarity in ("normal", "inverted"))
    first, second = (
        np.array([t for update in updates for t in update.peak_timestamps]) / 1e9 for updates in (right, wrong)
    )
    shift_s = np.median(second[np.searchsorted(second, first[5:-5])] - first[5:-5])
    assert 0.1 < shift_s < 0.4
