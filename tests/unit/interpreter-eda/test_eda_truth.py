"""Simulated skin whose responses and level are known."""

import numpy as np
import pytest
from interpreter_eda.config import Config
from interpreter_eda.features import tonic
from interpreter_eda.stream import EdaStream
from slow_signals import T0_NS, event_times_s, skin
from slow_signals import play as play_signal

ONSETS_S = np.array([20.0, 33.0, 41.0, 60.0, 75.0, 82.0, 100.0])
AMPLITUDES_US = np.array([0.5, 0.2, 1.0, 0.05, 0.4, 0.3, 0.8])
PEAK_AFTER_S = 0.6 * 5.0 / (5.0 - 0.6) * np.log(5.0 / 0.6)


def play(samples, fs_hz, unit="uS", config=None, **options):
    """Updates of conductances."""
    return play_signal(lambda info: EdaStream(config or Config(), info), samples, fs_hz, "eda", unit, **options)


def peaks_s(updates):
    """When the responses that were told have their peaks."""
    return event_times_s(updates, "scr_peak_timestamps")


@pytest.mark.parametrize("fs_hz", [4.0, 15.0, 100.0, 1000.0])
def test_responses_are_found_where_they_are(fs_hz):
    """At any rate: onset within 0.5 s, peak within 0.3 s, amplitude within 15 % or what the slope before takes off."""
    updates = play(skin(125, fs_hz, ONSETS_S, AMPLITUDES_US), fs_hz)
    np.testing.assert_allclose(event_times_s(updates, "scr_onset_timestamps"), ONSETS_S, atol=0.5)
    np.testing.assert_allclose(peaks_s(updates), ONSETS_S + PEAK_AFTER_S, atol=0.3)
    found = np.array([a for update in updates for a in update.scr_amplitudes_us])
    np.testing.assert_allclose(found, AMPLITUDES_US, rtol=0.15, atol=0.05)


def test_responses_are_told_once_in_order_and_soon():
    """Each peak is told by an update at most 10 s younger; onset, peak and amplitude are of one length."""
    updates = play(skin(125, 25.0, ONSETS_S, AMPLITUDES_US), 25.0)
    told = peaks_s(updates)
    assert len(told) == len(ONSETS_S)
    assert (np.diff(told) > 0).all()
    for update in updates:
        assert len(update.scr_onset_timestamps) == len(update.scr_peak_timestamps) == len(update.scr_amplitudes_us)
        for peak_ns in update.scr_peak_timestamps:
            assert 0 <= update.device_ns - peak_ns <= 10e9


def test_rise_and_half_recovery_are_those_of_the_curve():
    """One response of a known shape: rise 1.4 s, half of it lost 3.8 s after the peak."""
    t_s = np.linspace(0, 20, 20001)
    curve = np.exp(-t_s / 5.0) - np.exp(-t_s / 0.6)
    top = int(curve.argmax())
    half_s = t_s[top + int(np.argmax(curve[top:] <= curve[top] / 2))] - t_s[top]
    last = play(skin(50, 50.0, [20.0], [0.6], drift_us_per_min=0.0), 50.0)[-1]
    assert last.scr_count == 1
    assert last.scr_rise_time_s == pytest.approx(PEAK_AFTER_S, abs=0.6)
    assert last.scr_half_recovery_s == pytest.approx(half_s, abs=0.4)


def test_the_level_does_not_drift_away():
    """After 10 minutes with a response every 12 s the tonic level is still that of the skin, within 3 %."""
    onsets = np.arange(10, 590, 12.0)
    updates = play(skin(600, 4.0, onsets, np.full(len(onsets), 0.3), drift_us_per_min=0.02), 4.0)
    middle_s = np.array([(update.device_ns - T0_NS) / 1e9 - update.window_s / 2 for update in updates])
    late = middle_s > 60
    levels = np.array([update.tonic_us for update in updates])[late]
    truth = 5.0 + 0.02 * middle_s[late] / 60
    assert np.abs(levels / truth - 1).max() < 0.03
    assert np.median([update.tonic_slope_us_per_min for update in updates[60:]]) == pytest.approx(0.02, abs=0.02)
    assert updates[-1].scr_count == 5
    assert updates[-1].scr_rate_per_min == pytest.approx(5.0)


def test_the_tonic_line_is_under_the_signal_and_touches_its_troughs():
    """Never above the conductance, never further below a trough than where it was."""
    conductance = skin(60, 10.0, [20.0, 33.0], [1.0, 1.0], drift_us_per_min=0.0)
    line = tonic(conductance, np.nan)
    assert (line <= conductance).all()
    assert np.abs(line - 5.0).max() < 0.25


def test_the_threshold_is_a_parameter_and_told():
    """A response of 0.03 uS counts by the computer's threshold and not by the hand's; `extra` says which was used."""
    conductance = skin(60, 20.0, [30.0], [0.03], drift_us_per_min=0.0)
    by_computer, by_hand = (play(conductance, 20.0, config=Config(scr_threshold_us=us)) for us in (0.01, 0.05))
    assert (len(peaks_s(by_computer)), len(peaks_s(by_hand))) == (1, 0)
    assert [update[-1].extra[0].values[0] for update in (by_computer, by_hand)] == pytest.approx([0.01, 0.05])
    assert by_computer[-1].extra[0].name == "scr_threshold"


DRY_US, AT_S = 1.0, np.arange(8.0, 90.0, 13.0)  # level of a dry hand; when something happens to it


@pytest.mark.parametrize("rise_s", [0.7, 1.0, 1.8])
@pytest.mark.parametrize("fs_hz", [4.0, 50.0])
def test_a_strong_response_of_a_dry_hand_is_no_jump(fs_hz, rise_s):
    """Responses of 1 uS on a level of 1 uS are told, at a quality above 0.85."""
    times_s = np.arange(round(100 * fs_hz)) / fs_hz
    since_s = times_s[:, None] - AT_S
    up = (1 - np.cos(np.pi * np.clip(since_s / rise_s, 0, 1))) / 2
    skin_us = DRY_US + (up * np.exp(-np.maximum(since_s - rise_s, 0) / 4)).sum(axis=1)
    updates = play(skin_us + np.random.default_rng(1).normal(0, 0.002, len(skin_us)), fs_hz)
    np.testing.assert_allclose(peaks_s(updates), AT_S + rise_s, atol=0.5)
    assert min(update.signal_quality for update in updates[20:]) > 0.85
    assert not any("jumps" in reason for update in updates for reason in update.reasons)


@pytest.mark.parametrize("takes_s", [0.01, 0.3])
@pytest.mark.parametrize("fs_hz", [2.0, 4.0, 50.0])
def test_a_level_that_jumps_is_doubted(fs_hz, takes_s):
    """Of a dry hand by 0.8 uS up and down, from one sample to the next or in 0.3 s: jumps, and no quality of 0.7."""
    times_s = np.arange(round(100 * fs_hz)) / fs_hz
    steps = np.clip((times_s[:, None] - AT_S) / takes_s, 0, 1)
    level = DRY_US + 0.8 * steps @ np.where(np.arange(len(AT_S)) % 2, -1, 1)
    for update in play(level + np.random.default_rng(1).normal(0, 0.002, len(level)), fs_hz)[70:]:
        assert update.signal_quality < 0.7
        assert any("jumps faster than skin" in reason for reason in update.reasons)


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One signal, with a hole, in frames of one, of 7 and of random sizes gives the same updates."""
    conductance = skin(70, 20.0, ONSETS_S[:4], AMPLITUDES_US[:4]) + np.random.default_rng(1).normal(0, 1e-3, 1400)
    conductance[600:700] = np.nan
    sizes = ([1] * 1400, [7] * 200, np.random.default_rng(2).integers(1, 40, 400).tolist())
    texts = [repr([update._replace(received_ns=0) for update in play(conductance, 20.0, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000
