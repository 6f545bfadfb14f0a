"""What is published when the signal is poor, absent, or no eye."""

import numpy as np
import pytest
from eog_signals import eyes
from interpreter_eog.config import Config
from interpreter_eog.features import speed_limit
from interpreter_eog.stream import EogStream
from quality_ladder import assert_falls, held, played_once
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import event_times_s
from slow_signals import play as play_signal

FS_HZ, SECONDS = 100.0, 50
TIMES_S = np.arange(round(SECONDS * FS_HZ))[:, None] / FS_HZ
BLINKS_S = np.arange(4.0, 48.0, 4.0)
GAZE = [(at_s + 2.0, 100.0 * (-1) ** k) for k, at_s in enumerate(BLINKS_S)]
CLEAN = eyes(SECONDS, FS_HZ, BLINKS_S, GAZE)
NOISE = np.random.default_rng(1).normal(size=CLEAN.shape)


def play(samples, unit="uV", names=("heog", "veog"), fs_hz=FS_HZ, **options):
    """Updates of potentials."""
    return play_signal(lambda info: EogStream(Config(), info), samples, fs_hz, "eog", unit, names=names, **options)


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full(CLEAN.shape, 12.0), "flat"),
        (5.0 * NOISE, "nothing but noise"),
        (60.0 * NOISE[:2500], "below"),
        (np.full(CLEAN.shape, np.nan), "no number"),
        (CLEAN + 620.0, "saturated"),
    ],
    ids=["flat", "soft noise", "loud noise", "nan", "rail"],
)
def test_what_is_no_eye_is_told(samples, word):
    """A flat line, bare noise, no number, the end of the range: the reason, and no number at all."""
    updates = play(samples, range_min=-500.0, range_max=500.0)
    last = updates[-1]
    assert (last.blink_count, last.saccade_count) == (-1, -1)
    assert np.isnan([last.blink_rate_per_min, last.blink_duration_ms, last.saccade_rate_per_min]).all()
    assert np.isnan([last.horizontal_uv, last.vertical_uv]).all()
    assert last.signal_quality < 0.2
    assert all(any(channel in r and word in r for r in last.reasons) for channel in ("heog", "veog")), last.reasons
    assert not [each for update in updates for each in (*update.blink_timestamps, *update.saccade_timestamps)]


@pytest.mark.parametrize(
    ("blind", "options"),
    [
        (None, {"lost": [(30.0, 39.5)]}),
        (np.nan, {}),
        (600.0, {"range_min": -500.0, "range_max": 500.0}),
    ],
    ids=["lost", "nan", "rail"],
)
def test_a_rate_is_that_of_the_time_in_which_something_could_be_seen(blind, options):
    """A blink and a saccade every 2.5 s, and 9.5 s of which nothing is known: every sure rate is 24 a minute to 3.5."""
    at_s = np.arange(2.0, 78.0, 2.5)
    samples = eyes(80, FS_HZ, at_s, [(each + 1.2, 100.0 * (-1) ** k) for k, each in enumerate(at_s)])
    if blind is not None:
        samples[3000:3950] = blind
    sure = [update for update in play(samples, **options)[29:] if update.signal_quality >= 0.7]
    assert len(sure) > 20
    np.testing.assert_allclose([update.blink_rate_per_min for update in sure], 24, atol=3.5)
    np.testing.assert_allclose([update.saccade_rate_per_min for update in sure], 24, atol=3.5)


ladder = played_once(play)
LADDERS = {
    "noise": lambda x, t_s, k: x + 6 * k * np.random.default_rng(1).normal(size=x.shape),
    "drift": lambda x, t_s, k: x + 400 * k * t_s / 60,
    "mains": lambda x, t_s, k: x + 8 * k * np.sin(2 * np.pi * 50.3 * t_s),
    "motion": lambda x, t_s, k: x + np.where(1.2 * k > t_s % 20, 3000.0, 0.0),
    "loss": lambda x, t_s, k: np.where(1.4 * k > t_s % 10, np.nan, x),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1, 0], 0.15 * k, 5.0),
}


@pytest.mark.parametrize("fs_hz", [FS_HZ, 250.0])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, fs_hz):
    """Each step of noise, drift, mains, motion, loss and held values lowers the quality on average."""
    clean = eyes(SECONDS, fs_hz, BLINKS_S, GAZE)
    t_s = np.arange(len(clean))[:, None] / fs_hz
    assert_falls(lambda k: ladder(LADDERS[kind](clean, t_s, k), fs_hz=fs_hz)[10:])


def test_of_one_channel_the_features_of_the_other_are_missing():
    """heog alone has saccades and no blinks, veog alone blinks and no horizontal_uv; each says what is missing."""
    heog, veog = (play(CLEAN[:, k], names=(name,))[-1] for k, name in enumerate(("heog", "veog")))
    assert (heog.blink_count, heog.saccade_count) == (-1, len(GAZE))
    assert np.isnan([heog.blink_rate_per_min, heog.blink_duration_ms, heog.vertical_uv]).all()
    assert any("veog is not among the channels" in reason for reason in heog.reasons)
    assert (veog.blink_count, veog.saccade_count) == (len(BLINKS_S), 0)
    assert np.isnan(veog.horizontal_uv)
    assert np.isfinite([heog.horizontal_uv, veog.vertical_uv]).all()
    assert any("heog is not among the channels" in reason for reason in veog.reasons)


def test_a_channel_without_electrodes_does_not_take_the_other_with_it():
    """heog without a number: blinks as with veog alone, the quality halved."""
    samples = CLEAN.copy()
    samples[:, 0] = np.nan
    both, alone = play(samples)[-1], play(CLEAN[:, 1], names=("veog",))[-1]
    assert both.blink_count == alone.blink_count == len(BLINKS_S)
    assert both.signal_quality == pytest.approx(alone.signal_quality / 2)
    assert "heog holds no number: horizontal_uv, horizontal saccades" in both.reasons


def test_counts_give_events_but_no_microvolts():
    """Of an uncalibrated channel come blinks, counts and times; whatever would be in uV is NaN and says why."""
    last = play(30_000 + 13 * CLEAN, unit="counts")[-1]
    assert last.blink_count == len(BLINKS_S)
    assert last.saccade_count == len(GAZE)
    assert np.isnan([last.horizontal_uv, last.vertical_uv]).all()
    assert any("uncalibrated" in reason for reason in last.reasons)


def test_a_step_that_no_eye_makes_is_no_saccade():
    """An electrode that pops by 5 mV tells no event and lowers the quality."""
    samples = CLEAN.copy()
    samples[2550:] += 5000.0
    updates = play(samples)
    near = [s for s in event_times_s(updates, "saccade_timestamps") if abs(s - 25.5) < 0.3]
    assert not near
    assert updates[27].signal_quality < 0.95 * updates[24].signal_quality


def test_a_steady_drift_has_a_speed_limit():
    """A level whose speed never changes has a limit of about 0, whatever rounding leaves of it, and no warning."""
    limits = [speed_limit(12.3 + slope * np.arange(301.0)) for slope in np.linspace(0.1, 10, 100)]
    np.testing.assert_allclose(limits, 0.0, atol=1e-3)


@pytest.mark.parametrize("fs_hz", [0.0, 20.0, 10_000.0])
def test_a_rate_that_no_eog_has_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 50 to 8000 for EOG"):
        EogStream(Config(), StreamInfo(StreamName("p1", "eog", "s1"), fs_hz, "uV", ("veog",)))


def test_channels_that_are_no_eog_are_refused():
    """Names other than heog and veog, in whatever case, are named."""
    info = StreamInfo(StreamName("p1", "eog", "s1"), 100.0, "uV", ("left", "right"))
    with pytest.raises(ValueError, match="channels are left, right; EOG needs heog, veog or both"):
        EogStream(Config(), info)


@pytest.mark.parametrize("swings_hz", [2.0, 2.5])
def test_what_swings_faster_than_lids_is_no_blink(swings_hz):
    """A swing of 300 uV: from the tenth second on no blinks and quality 0, with the reason."""
    samples = 300 * np.sin(2 * np.pi * swings_hz * np.arange(round(30 * FS_HZ)) / FS_HZ)
    updates = play(samples, names=("veog",))
    assert [update.blink_count for update in updates[10:]] == [-1] * (len(updates) - 10)
    assert {update.signal_quality for update in updates[10:]} == {0.0}
    assert any("times a minute, as no lid does" in reason for reason in updates[-1].reasons)


@pytest.mark.parametrize("length", [1, 2])
@pytest.mark.parametrize("fs_hz", [50.0, 100.0, 250.0, 1000.0])
def test_pops_of_the_electrodes_are_no_blinks(fs_hz, length):
    """500 uV in one sample or two every 1.2 s: no lid is as quick; no gaze either."""
    samples = np.random.default_rng(1).normal(0, 1.0, (round(120 * fs_hz), 2))
    for at_s in np.arange(1, 99) * 1.2:
        begin = round(at_s * fs_hz)
        samples[begin : begin + length, 1] += 500.0
    updates = play_signal(lambda info: EogStream(Config(), info), samples, fs_hz, "eog", "uV", names=("heog", "veog"))
    assert not [each for update in updates for each in (*update.blink_timestamps, *update.saccade_timestamps)]


def test_lids_may_be_fast_for_a_while():
    """Twenty blinks in ten seconds after half a minute of a usual few are all told."""
    blinks_s = [*np.arange(3.0, 40.0, 4.0), *np.arange(41.0, 51.0, 0.5)]
    updates = play(eyes(60, FS_HZ, blinks_s))
    assert len(event_times_s(updates, "blink_timestamps")) == len(blinks_s)
    assert updates[-1].blink_count >= len(blinks_s) - 1


def test_what_nothing_is_known_before_is_no_saccade():
    """Lids that open where a gap ends, or where the stream begins, are no saccades: there are none."""
    blinks_s = np.arange(3.0, 40.0, 5.0)
    samples = eyes(40, 250.0, blinks_s)
    samples[20 * 250 : 23 * 250] = np.nan
    for signal in (samples, samples[3 * 250 :]):
        updates = play_signal(lambda info: EogStream(Config(), info), signal, 250.0, "eog", "uV", ("heog", "veog"))
        assert event_times_s(updates, "saccade_timestamps").tolist() == []
        assert updates[-1].blink_count >= 6


@pytest.mark.parametrize("sd_uv", [50.0, 100.0])
@pytest.mark.parametrize("on_s", [1.0, 3.0])
def test_a_muscle_that_works_for_a_moment_makes_no_blinks(on_s, sd_uv):
    """Jaws that close every 10 s: at most two blinks more than there are, and a lower quality the longer they do."""
    bursts = np.where(on_s > TIMES_S % 10, sd_uv, 0.0) * NOISE
    updates = play(CLEAN + bursts)
    found = event_times_s(updates, "blink_timestamps")
    assert len(found) <= len(BLINKS_S) + 2
    assert updates[-1].signal_quality < play(CLEAN)[-1].signal_quality - 0.5 * on_s / 10


def test_values_that_are_held_hide_blinks_and_lower_no_rate():
    """Every 7.3 s the device repeats its last value for 3 s: the rate is that of the others, 15, quality lower."""
    samples = CLEAN.copy()
    for begin_s in np.arange(5.2, 48.0, 7.3):
        samples[round(begin_s * FS_HZ) : round((begin_s + 3.0) * FS_HZ)] = samples[round(begin_s * FS_HZ)]
    told = [update for update in play(samples)[25:] if np.isfinite(update.blink_rate_per_min)]
    assert len(told) > 10
    assert max(update.signal_quality for update in told) < 0.7
    np.testing.assert_allclose([update.blink_rate_per_min for update in told], 15.0, atol=3.5)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("fs_hz", [100.0, 250.0])
def test_channels_that_are_swapped_are_told(fs_hz, sign):
    """Blinks in heog, and a veog that only looks aside: from the ninth on no rate is sure, and why is said."""
    blinks_s = np.arange(4.0, 78.0, 3.0)
    gaze = [(at_s + 1.5, 150.0 * (-1) ** k) for k, at_s in enumerate(blinks_s)]
    right = eyes(80, fs_hz, blinks_s, gaze)
    swapped = play(sign * right[:, ::-1], fs_hz=fs_hz)[34:]
    assert max(update.signal_quality for update in swapped) < 0.7
    assert all(any("channels are swapped" in reason for reason in update.reasons) for update in swapped)
    as_named = play(sign * right, fs_hz=fs_hz)
    assert not any("channels are swapped" in reason for update in as_named for reason in update.reasons)
