"""The stateless functions of interpreter_ppg.features."""

import numpy as np
import pytest
from interpreter_ppg import features


def test_slope_of_a_ramp_is_its_slope():
    """The slope of a straight line is its slope at any level, a constant has slope exactly 0."""
    times_s = np.arange(0, 4, 1 / 55)
    np.testing.assert_allclose(features.slope(1e6 + 250 * times_s, 55.0)[20:-20], 250, rtol=1e-9)
    assert not features.slope(np.full(200, 8_388_607.0), 55.0).any()


@pytest.mark.parametrize("fs_hz", [25, 100, 1000])
@pytest.mark.parametrize("offset", [0.0, 0.3, 0.77])
def test_steepest_rise_between_the_samples(fs_hz, offset):
    """The steepest rise of a smooth step is found to 0.1 ms wherever it lies between two samples."""
    times_s = np.arange(0, 2, 1 / fs_hz)
    truth_s = 1.0 + offset / fs_hz
    step = 1e6 + 500 / (1 + np.exp(-(times_s - truth_s) / 0.05))
    near_s = times_s[np.argmin(np.abs(times_s - truth_s))]
    assert features.steepest(step, times_s, near_s, fs_hz) == pytest.approx(truth_s, abs=1e-4)


def test_steepest_gives_back_the_guess_where_there_is_none():
    """On a flat line there is no rise: the guess is returned."""
    times_s = np.arange(0, 2, 0.01)
    assert features.steepest(np.full(200, 7.0), times_s, 1.0, 100.0) == 1.0


@pytest.mark.parametrize("period_s", [0.3, 0.6, 1.0, 1.6])
def test_period_of_a_train_with_a_second_wave(period_s):
    """The period of a train of pulses with a dicrotic wave is that of the train, not of the waves."""
    phase = np.arange(0, 8, 0.01) % period_s
    train = np.exp(-(((phase - 0.1) / 0.06) ** 2)) + 0.3 * np.exp(-(((phase - 0.45 * period_s) / 0.06) ** 2))
    found_s, strength = features.period(train - train.mean(), 100.0)
    assert found_s == pytest.approx(period_s, abs=0.011)
    assert strength > 0.9
    assert np.isnan(features.period(np.zeros(800), 100.0)[0])
    assert np.isnan(features.period(np.ones(20), 100.0)[0])


def test_maxima_have_a_summit():
    """A summit of one or two samples is a maximum; a plateau, a shoulder and the ends are none."""
    values = np.array([9.0, 0, 1, 0, 2, 2, 0, 3, 3, 3, 0, 1, 1, 2, 1, 5])
    assert features.maxima(values).tolist() == [2, 4, 13]


def test_prominence_ends_at_a_higher_neighbour():
    """The prominence is the height above the higher of the two valleys, each sought up to a higher maximum."""
    values = np.array([0.0, 5, 1, 3, 2, 9, 0])
    assert features.prominence(values, 1, 100.0) == 4.0
    assert features.prominence(values, 3, 100.0) == 1.0
    assert features.prominence(values, 5, 100.0) == 9.0


def test_the_greater_of_two_close_rises_stays():
    """Of two maxima closer than two pulses can be the greater one is kept, a distant small one too."""
    rise = np.zeros(300)
    rise[[50, 75, 200]] = 1.0, 2.0, 0.5
    assert features.rises(rise, 100.0, 1.0).tolist() == [75, 200]
    assert features.rises(rise, 100.0, 0.5).tolist() == [50, 75, 200]


def test_heart_rate_needs_three_intervals():
    """Fewer than three plausible intervals give NaN; a missed and an extra pulse do not count."""
    none, every = np.zeros(6, bool), np.ones(6, bool)
    assert np.isnan(features.heart_rate(np.array([800.0, 800.0]), none[:2]))
    assert np.isnan(features.heart_rate(np.array([np.nan] * 6), every))
    assert features.heart_rate(np.array([800.0, 1600, 800, 300, 800, 800]), none) == 75.0
    trusted = np.array([True, True, True, False, False, False])
    assert features.heart_rate(np.array([600.0, 600, 600, 500, 500, 500]), trusted) == 100.0


def test_missing_pulses_are_no_disorder_of_the_intervals():
    """Two doubled intervals among steady ones leave an order; intervals by chance have none, three tell nothing."""
    assert not features.irregular(np.array([800.0, 810, 1620, 790, 805, 800, 1590, 810, 795, 800, 805]))
    chance_ms = np.array([735.0, 881, 463, 478, 552, 1016, 876, 994, 852, 691, 556, 814])
    assert features.irregular(chance_ms)
    assert not features.irregular(chance_ms[:5])


def test_amplitude_is_foot_to_crest():
    """The amplitude is the crest after the rise less the foot before it; NaN where one of them is missing."""
    times_s = np.arange(0, 2, 0.01)
    pulse = 1e5 + 300 * np.exp(-(((times_s - 1.0) / 0.15) ** 2))
    assert features.amplitude(pulse, times_s, 0.9) == pytest.approx(300, rel=0.01)
    assert np.isnan(features.amplitude(pulse, times_s, -1.0))
