"""Simulated eyes whose blinks and saccades are known."""

import numpy as np
import pytest
from eog_signals import eyes
from interpreter_eog.config import Config
from interpreter_eog.mains import Mains
from interpreter_eog.stream import EogStream
from slow_signals import event_times_s
from slow_signals import play as play_signal

BLINKS_S = np.array([3.2, 9.0, 9.6, 17.4, 25.0, 36.3])
HORIZONTAL = [(5.0, 120.0), (7.1, -250.0), (12.0, 60.0), (20.0, 200.0), (28.0, -90.0)]
VERTICAL = [(14.0, -80.0), (22.0, 150.0), (31.0, -100.0)]
TRUTH = np.array(sorted([*HORIZONTAL, *VERTICAL]))
DURATION_MS = 200.0  # of a simulated blink between its half heights


def signal(fs_hz, **options):
    return eyes(40, fs_hz, BLINKS_S, HORIZONTAL, VERTICAL, **options)


def play(samples, fs_hz, unit="uV", names=("heog", "veog"), **options):
    """Updates of potentials."""
    return play_signal(lambda info: EogStream(Config(), info), samples, fs_hz, "eog", unit, names=names, **options)


def told(updates, field):
    return np.array([value for update in updates for value in getattr(update, field)])


@pytest.mark.parametrize("fs_hz", [50.0, 100.0, 256.0, 1000.0])
def test_blinks_and_saccades_are_where_they_are(fs_hz):
    """At any rate: greatest closure within 30 ms, duration within 30 ms; onset within 20 ms, amplitude within 10 %."""
    updates = play(signal(fs_hz), fs_hz)
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), BLINKS_S, atol=0.03)
    np.testing.assert_allclose(told(updates, "blink_durations_ms"), DURATION_MS, atol=30)
    np.testing.assert_allclose(event_times_s(updates, "saccade_timestamps"), TRUTH[:, 0], atol=0.02)
    np.testing.assert_allclose(told(updates, "saccade_amplitudes_uv"), TRUTH[:, 1], rtol=0.1)
    vertical = [value for update in updates for value in update.extra[-1].values]
    assert vertical == [float(tuple(each) in VERTICAL) for each in TRUTH.tolist()]


def test_events_are_told_once_in_order_and_within_two_seconds():
    """One update a second; no event is older than 2 s when it is told; counts and rates are those of the window."""
    updates = play(signal(100.0), 100.0)
    assert len(updates) == 39
    for update in updates:
        for event_ns in (*update.blink_timestamps, *update.saccade_timestamps):
            assert 0 <= update.device_ns - event_ns <= 2e9
    last = updates[-1]
    assert (last.blink_count, last.saccade_count) == (len(BLINKS_S), len(TRUTH))
    assert last.blink_rate_per_min == pytest.approx(60 * len(BLINKS_S) / last.window_s)
    assert last.blink_duration_ms == pytest.approx(DURATION_MS, abs=20)
    assert last.reasons == ()


def test_swapped_electrodes_change_the_signs_and_nothing_else():
    """Upside down: the same blinks and saccades, amplitudes negated, and a reason that says so."""
    upright, swapped = play(signal(100.0), 100.0), play(-signal(100.0), 100.0)
    for field in ("blink_timestamps", "blink_durations_ms", "saccade_timestamps"):
        np.testing.assert_array_equal(told(upright, field), told(swapped, field))
    amplitudes = [told(updates, "saccade_amplitudes_uv") for updates in (upright, swapped)]
    np.testing.assert_allclose(amplitudes[0], -amplitudes[1])
    assert any("upside down" in reason for reason in swapped[-1].reasons)


def test_drift_and_a_large_offset_do_not_matter():
    """3 mV per minute on an offset of 30 mV: the same events within 30 ms."""
    samples = signal(100.0) + 30_000.0 + 3000.0 * (np.arange(4000) / 6000.0)[:, None]
    updates = play(samples, 100.0)
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), BLINKS_S, atol=0.03)
    np.testing.assert_allclose(event_times_s(updates, "saccade_timestamps"), TRUTH[:, 0], atol=0.03)


def test_deflections_are_told_from_the_middle_of_the_last_half_minute():
    """Eyes that went 100 uV to the right 3 s ago: horizontal_uv is that, vertical_uv near 0, whatever the offset."""
    samples = eyes(40, 100.0, [12.0, 25.0], [(37.0, 100.0)], drift_uv_per_min=0.0)
    last = play(samples + np.array([400.0, -900.0]), 100.0)[-1]
    assert last.horizontal_uv == pytest.approx(100.0, abs=8)
    assert last.vertical_uv == pytest.approx(0.0, abs=8)


def test_a_pulse_is_no_saccade():
    """100 uV for a tenth of a second, as a lid shows them in heog: neither the way there nor the way back counts."""
    pulses = [
        (at_s, sign * 100.0) for start_s in (8.0, 16.0, 24.0) for at_s, sign in ((start_s, 1), (start_s + 0.12, -1))
    ]
    assert (
        len(event_times_s(play(eyes(30, 100.0, (), pulses)[:, 0], 100.0, names=("heog",)), "saccade_timestamps")) == 0
    )


def test_the_mains_are_no_movement():
    """Hum of 40 uV, of 50 or of 60 Hz, at 250 Hz: the same blinks, and no saccade that is none."""
    times_s = np.arange(10_000) / 250.0
    for mains_hz in (50.0, 60.0):
        updates = play(signal(250.0) + 40.0 * np.sin(2 * np.pi * mains_hz * times_s)[:, None], 250.0)
        np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), BLINKS_S, atol=0.03)
        found = event_times_s(updates, "saccade_timestamps")
        assert all(np.abs(TRUTH[:, 0] - at_s).min() < 0.03 for at_s in found)


@pytest.mark.parametrize(
    ("fs_hz", "mains_hz"),
    [(50.0, 60.0), (52.0, 50.0), (55.0, 50.0), (58.0, 60.0), (64.0, 50.0), (64.0, 60.0), (75.0, 50.0), (90.0, 50.0)],
)
def test_mains_that_sampling_folds_are_no_blinks(fs_hz, mains_hz):
    """Hum of 30 uV that appears at 2 to 40 Hz: every blink, and at most two others."""
    times_s = np.arange(round(40 * fs_hz)) / fs_hz
    updates = play(signal(fs_hz) + 30.0 * np.sin(2 * np.pi * (mains_hz + 0.02) * times_s)[:, None], fs_hz)
    told = event_times_s(updates, "blink_timestamps")
    assert all(np.abs(told - at_s).min() < 0.05 for at_s in BLINKS_S)
    assert sum(np.abs(BLINKS_S - at_s).min() > 0.05 for at_s in told) <= 2


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One signal, with missing samples, in frames of one, of 7 and of random sizes gives the same updates."""
    samples = signal(100.0)[:3000]
    samples[1500:1510, 0] = np.nan
    sizes = ([1] * 3000, [7] * 430, np.random.default_rng(2).integers(1, 60, 300).tolist())
    texts = [repr([update._replace(received_ns=0) for update in play(samples, 100.0, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000


def test_a_blink_before_a_short_time_without_a_number_is_told():
    """Each blink followed 0.45 s later by 0.3 s of NaN, in one channel or in both: all are told, within 2 s."""
    blinks_s = np.arange(2.0, 38.0, 1.4)
    for columns in ([1], [0, 1]):
        samples = eyes(40, 100.0, blinks_s)
        for at_s in blinks_s:
            samples[round(100 * (at_s + 0.45)) : round(100 * (at_s + 0.75)), columns] = np.nan
        updates = play(samples, 100.0)
        np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), blinks_s, atol=0.03)
        assert all(u.device_ns - told_ns <= 2e9 for u in updates for told_ns in u.blink_timestamps)


def test_a_hole_hides_what_is_in_it_and_nothing_else():
    """Of 2 s that never came the events in them are missing; all others are told, none at the edges of the hole."""
    updates = play(signal(100.0), 100.0, lost=[(16.5, 18.5)])
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), np.delete(BLINKS_S, 3), atol=0.03)
    np.testing.assert_allclose(event_times_s(updates, "saccade_timestamps"), TRUTH[:, 0], atol=0.02)


def test_a_blink_is_told_also_where_a_hole_follows_an_update_at_once():
    """Its summit half a second before the last sample, that of an update, before 12 s that never came: it is told."""
    samples = eyes(30, 100.0, [4.0, 9.5, 25.0])
    updates = play(samples, 100.0, sizes=[1] * len(samples), lost=[(10.005, 22.0)])
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), [4.0, 9.5, 25.0], atol=0.03)


def test_the_mains_go_on_elsewhere_in_their_period_after_a_hole():
    """50 Hz folded to 30 by sampling at 80 Hz: half a period is missing, and after a second little of it is left."""
    mains, n = Mains(80.0), 800
    line_uv = 100.0 * np.sin(2 * np.pi * 50.02 * np.arange(2 * n) / 80.0)
    mains.without(line_uv[:n])
    mains.interrupted()
    after_uv = np.concatenate([mains.without(part) for part in np.split(line_uv[n + 1 : n + 161], 10)])
    assert np.abs(after_uv[80:]).max() < 35
