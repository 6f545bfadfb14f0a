"""What is published when the acceleration is poor, absent, or no motion."""

import numpy as np
import pytest
from interpreter_motion.config import Config
from interpreter_motion.stream import MotionStream
from quality_ladder import assert_falls, held, played_once
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import play as play_signal
from walking import GRAVITY, acceleration

FS_HZ, XYZ = 50.0, ("x", "y", "z")
WALK = acceleration(30, FS_HZ, [(5, 25, 105)])


def play(samples, unit="m/s^2", fs_hz=FS_HZ, **options):
    """Updates of an accelerometer."""
    return play_signal(lambda info: MotionStream(Config(), info), samples, fs_hz, "accelerometer", unit, XYZ, **options)


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full((1000, 3), 5.6), "flat"),
        (np.full((1000, 3), np.nan), "no number"),
        (np.where(np.random.default_rng(0).normal(size=(1000, 3)) > 0, 20.0, -20.0), "saturated"),
    ],
    ids=["constant", "nan", "saturated"],
)
def test_what_is_no_motion_is_told(samples, word):
    """A dead sensor, no number, the ends of the range: NaN throughout, quality 0 and the reason."""
    last = play(samples, range_min=-20.0, range_max=20.0)[-1]
    assert np.isnan([last.intensity_m_per_s2, last.step_rate_per_min, last.extra[0].values[0]]).all()
    assert last.posture == "unknown"
    assert last.signal_quality == 0
    assert word in last.reasons[0]


@pytest.mark.parametrize("sd", [1.0, 3.0, 10.0])
def test_noise_has_no_steps(sd):
    """Three minutes of white noise, with and without gravity: at most two steps a minute, quality below 0.5."""
    noise = np.random.default_rng(4).normal(0, sd, (9000, 3))
    for gravity in (0.0, GRAVITY):
        updates = play(noise + np.array([0, 0, gravity]))
        assert updates[-1].extra[0].values[0] <= 6
        assert np.median([update.signal_quality for update in updates]) < 0.5


def test_gestures_have_no_steps():
    """Three minutes of shaking in the band of steps, but without a rhythm: at most two steps a minute."""
    rng = np.random.default_rng(5)
    spectrum = np.fft.rfft(rng.normal(0, 1, (9000, 3)), axis=0)
    at_hz = np.fft.rfftfreq(9000, 1 / FS_HZ)
    spectrum[(at_hz < 0.5) | (at_hz > 4)] = 0
    shaking = np.fft.irfft(spectrum, axis=0)
    assert play(2 * shaking / shaking.std() + [0, 0, GRAVITY])[-1].extra[0].values[0] <= 6


ladder = played_once(play)
# no motion: it is the signal
LADDERS = {
    "noise": lambda x, t_s, k: x + np.random.default_rng(1).normal(0, 1.0 * k, x.shape),
    "drift": lambda x, t_s, k: x + 0.08 * k * t_s,
    "mains": lambda x, t_s, k: x + 2 * k * np.sin(2 * np.pi * 60.03 * t_s),
    "loss": lambda x, t_s, k: np.where(0.5 * k > t_s % 5, np.nan, x),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1, 0], 0.15 * k, 2.0),
}


@pytest.mark.parametrize("fs_hz", [FS_HZ, 100.0])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, fs_hz):
    """Each step of noise, drift, mains, loss and held values lowers the quality on average."""
    walk = acceleration(30, fs_hz, [(5, 25, 105)])
    t_s = np.arange(len(walk))[:, None] / fs_hz
    assert_falls(lambda k: ladder(LADDERS[kind](walk, t_s, k), fs_hz=fs_hz)[5:])


def test_quality_falls_with_the_range():
    """The smaller the range of the sensor the lower the quality of a walk that it cuts."""
    ranges = {0: 14.0, 1: 13.0, 2: 12.0, 4: 10.0}
    assert_falls(
        lambda k: play(np.clip(WALK, -ranges[k], ranges[k]), range_min=-ranges[k], range_max=ranges[k])[5:], least=0.8
    )


def test_another_unit_gives_steps_but_no_intensity():
    """Of raw counts gravity tells the scale: the same steps, and an intensity that is NaN and says why."""
    counts, metric = play(WALK * 417, unit="counts")[-1], play(WALK)[-1]
    assert counts.extra[0].values == metric.extra[0].values
    assert np.isnan(counts.intensity_m_per_s2)
    assert any("uncalibrated" in reason for reason in counts.reasons)


@pytest.mark.parametrize("unit", ["g", "m/s^2"])
def test_acceleration_without_gravity_has_a_poor_quality(unit):
    """A walk of which the device has taken gravity away, however strong and in whatever unit: below 0.3."""
    walk = acceleration(30, FS_HZ, [(2, 30, 110)], strength=10.0) - [0.0, GRAVITY, 0.0]
    assert max(update.signal_quality for update in play(walk, unit=unit)[8:]) < 0.3


def test_counts_that_cannot_be_negative_have_no_steps():
    """Where zero is in them nobody knows: a walk of 105 would have half of its steps. NaN, quality 0 and the reason."""
    options = {"unit": "counts", "range_min": 0.0, "range_max": 4095.0}
    for update in play(2000 + np.round(WALK * 40), **options):
        assert np.isnan([update.step_rate_per_min, update.extra[0].values[0]]).all()
        assert update.signal_quality == 0
        assert "zero" in update.reasons[0]


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0), (1, -1, 1), (1, -1, 0)])
@pytest.mark.parametrize(("zero", "per_g", "unit"), [(512, 102, "counts"), (2048, 1024, ""), (32768, 4096, "a.u.")])
def test_an_offset_is_told_without_a_range(zero, per_g, unit, up):
    """Unsigned converters whose range nobody declared, worn either way: NaN, quality 0 and the reason."""
    walk = acceleration(30, FS_HZ, [(5, 25, 105)], up)
    for update in play(np.round(zero + walk / GRAVITY * per_g), unit):
        assert np.isnan([update.step_rate_per_min, update.extra[0].values[0]]).all()
        assert update.signal_quality == 0
        assert "zero" in update.reasons[0]


def test_numbers_that_were_negative_have_their_zero():
    """Gravity on all axes alike, of counts after one that was negative, of g anyhow: the steps are counted."""
    walk = acceleration(30, FS_HZ, [(5, 25, 105)], (1, 1, 1))
    signed = np.vstack([[0, 0, -5], np.round(walk * 40)])
    for samples, unit in ((signed, "counts"), (walk / GRAVITY, "g")):
        assert play(samples, unit)[-1].extra[0].values[0] == pytest.approx(35, abs=2)


def test_a_hole_costs_the_steps_in_it_and_no_more():
    """Of 20 s of walking 4 s never came: the steps of the others are counted."""
    updates = play(acceleration(30, FS_HZ, [(2, 26, 120)]), lost=[(12.0, 16.0)])
    assert updates[-1].extra[0].values[0] == pytest.approx(40, abs=3)


@pytest.mark.parametrize("hole_s", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("blind", [False, True])
def test_a_hole_that_hides_a_step_changes_no_rate(hole_s, blind):
    """Samples that never came, or hold no number, in a walk of 120 steps a minute: no interval is measured across."""
    walk = acceleration(40, FS_HZ, [(2, 40, 120)])
    lost = [] if blind else [(20.05, 20.05 + hole_s)]
    if blind:
        walk[round(20.05 * FS_HZ) : round((20.05 + hole_s) * FS_HZ)] = np.nan
    rates = [update.step_rate_per_min for update in play(walk, sizes=[1] * len(walk), lost=lost)[12:]]
    np.testing.assert_allclose(rates, 120, atol=2)


def test_steps_before_and_behind_a_hole_are_not_in_a_row():
    """Four steps, a second without numbers, four steps in time with them: fewer than six in a row are none."""
    walk = acceleration(30, FS_HZ, [(10, 15, 120)])
    assert play(walk)[-1].extra[0].values[0] >= 8
    walk[round(12 * FS_HZ) : round(13 * FS_HZ)] = np.nan
    assert play(walk)[-1].extra[0].values[0] == 0


def test_a_walk_with_too_many_holes_is_not_told_as_none():
    """Holes every 4.5 s in a walk of a minute: no rate, never 0, and the reason; with holes every 12 s there is one."""
    walk = acceleration(60, FS_HZ, [(0, 60, 110)])
    for every_s in (4.5, 12.0):
        lost = [(begin_s, begin_s + 0.3) for begin_s in np.arange(3.0, 60.0, every_s)]
        updates = play(walk, sizes=[1] * len(walk), lost=lost)[13:]
        rates = np.array([update.step_rate_per_min for update in updates])
        if every_s < 5.0:
            assert np.isnan(rates).all()
            assert all(any("5 s without a hole" in reason for reason in update.reasons) for update in updates)
        else:
            np.testing.assert_allclose(rates, 110.0, rtol=0.1)


@pytest.mark.parametrize("fs_hz", [0.0, 5.0, 8000.0])
def test_a_rate_no_accelerometer_has_is_refused(fs_hz):
    """One sentence that names the parameter and the range; likewise for a missing axis."""
    name = StreamName("p1", "accelerometer", "s1")
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .*must be 10 to 4000 for motion"):
        MotionStream(Config(), StreamInfo(name, fs_hz, "m/s^2", XYZ))
    with pytest.raises(ValueError, match="motion needs x, y and z"):
        MotionStream(Config(), StreamInfo(name, 50.0, "m/s^2", ("x", "y")))


@pytest.mark.parametrize("stuck", [0.0, 9.8])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_an_axis_that_stands_still_while_the_others_move_is_told(axis, stuck):
    """A walk of which one axis shows one number: NaN, quality 0 and the reason, whichever it is; at rest nothing is."""
    walk = WALK.copy()
    walk[:, XYZ.index(axis)] = stuck
    updates = play(walk)
    for update in updates[12:24]:
        assert np.isnan([update.intensity_m_per_s2, update.step_rate_per_min]).all()
        assert update.signal_quality == 0
        assert f"{axis} does not change" in update.reasons[0]
    still = acceleration(20, FS_HZ)
    still[:, XYZ.index(axis)] = still[0, XYZ.index(axis)]
    assert np.isfinite(play(still)[-1].intensity_m_per_s2)


@pytest.mark.parametrize("held_s", [0.5, 1.0, 2.0])
def test_values_that_are_held_in_a_walk_are_lost_samples(held_s):
    """Every 6 s the device repeats its last values: the rate is that of the other time, the quality so much lower."""
    walk = acceleration(60, FS_HZ, [(2, 60, 110)])
    for begin_s in np.arange(8.0, 58.0, 6.0):
        walk[round(begin_s * FS_HZ) : round((begin_s + held_s) * FS_HZ)] = walk[round(begin_s * FS_HZ)]
    updates = play(walk)[14:]
    rates = np.array([update.step_rate_per_min for update in updates])
    assert np.isfinite(rates).any()
    np.testing.assert_allclose(rates[np.isfinite(rates)], 110, atol=4)
    assert np.mean([update.signal_quality for update in updates]) < 1 - 0.9 * held_s / 6


def test_a_coarse_sensor_that_rests_holds_nothing():
    """In steps of 0.15 m/s^2 rest is one value for long: after a walk as well, it is all there."""
    samples = np.round(acceleration(40, FS_HZ, [(2, 20, 110)]) / 0.153) * 0.153
    assert min(update.signal_quality for update in play(samples)[5:]) > 0.95


@pytest.mark.parametrize("strength", [8.0, 12.0, 15.0, 20.0])
def test_a_runner_too_strong_for_the_range_has_no_sure_intensity(strength):
    """Cut at 2 g a run seems to move less than it does: where it is sure the intensity is within a tenth."""
    run = acceleration(30, FS_HZ, [(0, 30, 170)], strength=strength)
    whole, cut = play(run), play(np.clip(run, -19.6, 19.6), range_min=-19.6, range_max=19.6)
    sure = [(a, b) for a, b in zip(whole[10:], cut[10:], strict=True) if b.signal_quality >= 0.7]
    assert bool(sure) == (strength == 8.0)
    for true, update in sure:
        assert update.intensity_m_per_s2 == pytest.approx(true.intensity_m_per_s2, rel=0.1)
