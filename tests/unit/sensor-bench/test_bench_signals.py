"""The simulated signals show exactly the beats that the heart is known to have."""

import itertools

import numpy as np
import pytest
from scipy.signal import find_peaks
from sensor_bench.signals import waveforms
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.playback import RecordedHeart
from sensor_bench.signals.sources import EcgSource, MotionSource, PpgSource, Wearing

FS_HZ = 130.17


@pytest.fixture(scope="module")
def shapes():
    return waveforms.stored()


def parabolic(values: np.ndarray, at: int) -> float:
    before, here, after = values[at - 1 : at + 2]
    return at + 0.5 * (before - after) / (before - 2 * here + after)


def quiet_ecg(heart, shapes, **options):
    return EcgSource(heart, Wearing(), shapes, seed=5, **{"noise_uv": 0.0, "wander_uv": 0.0, **options})


@pytest.mark.parametrize("rate_bpm", [45, 66, 120, 170])
def test_r_peaks_are_at_the_known_beats(shapes, rate_bpm):
    """In the noise-free ECG every known beat has its R peak (between samples) within 1.5 ms, and no other is found."""
    heart = Heart(seed=3, heart_rate_bpm=rate_bpm)
    ecg = quiet_ecg(heart, shapes).read(0, 60 * 130, FS_HZ)[:, 0]
    peaks, _ = find_peaks(ecg, height=700, distance=20)
    found_s = np.array([parabolic(ecg, p) for p in peaks]) / FS_HZ
    known_s = np.array([beat.time_s for beat in heart.beats(0.1, 59.8)])
    nearest = np.abs(found_s[:, None] - known_s[None, :])
    assert nearest.min(axis=0).max() < 0.0015
    inside = (found_s > 0.15) & (found_s < 59.7)
    assert nearest.min(axis=1)[inside].max() < 0.0015


@pytest.mark.parametrize("rate_bpm", [50, 75, 140])
def test_pulses_follow_the_beats_by_the_transit_time(shapes, rate_bpm):
    """Each beat makes one systolic dip of the counts, the transit time later, within 12 ms at 55 Hz."""
    heart = Heart(seed=4, heart_rate_bpm=rate_bpm)
    source = PpgSource(heart, Wearing(), shapes, seed=1, transit_s=0.25)
    source.NOISE, source.BREATH = np.zeros(4), np.zeros(4)
    ppg = -source.read(0, 55 * 60, 55.0)[:, 0].astype(float)
    peaks, _ = find_peaks(ppg, prominence=300)
    found_s = np.array([parabolic(ppg, p) for p in peaks]) / 55.0
    known_s = np.array([beat.time_s for beat in heart.beats(0.5, 59.0)]) + 0.25
    assert np.abs(found_s[:, None] - known_s[None, :]).min(axis=0).max() < 0.012
    assert len(peaks) == pytest.approx(len(known_s), abs=3)


def test_samples_do_not_depend_on_how_they_are_read(shapes):
    """Frame by frame or all at once, from any start, the same sample numbers have the same values."""
    heart = Heart(seed=1)
    sources = [
        EcgSource(heart, Wearing(), shapes, seed=2),
        PpgSource(heart, Wearing(), shapes, seed=2),
        MotionSource(heart, 2, (0.0, 0.0, 1000.0), 10.0, 4.0),
    ]
    for source in sources:
        whole = source.read(0, 730, FS_HZ)
        parts = np.concatenate([source.read(i, 73, FS_HZ) for i in range(0, 730, 73)])
        np.testing.assert_array_equal(whole, parts)
        np.testing.assert_array_equal(source.read(500, 100, FS_HZ), whole[500:600])


def test_the_same_seed_gives_the_same_heart_and_another_seed_another():
    """Beats depend on seed and rate alone, not on the order in which they are asked for."""
    one, two, other = Heart(7), Heart(7), Heart(8)
    two.beats(0, 100)
    assert one.beats(10, 60) == two.beats(10, 60)
    assert one.beats(10, 60) != other.beats(10, 60)


def test_the_rhythm_is_physiological_and_follows_the_knob():
    """Mean rate as asked, RMSSD and SDNN in the range of a resting adult, and a new rate holds soon after."""
    heart = Heart(seed=11, heart_rate_bpm=66)
    rr_ms = np.array([beat.rr_s for beat in heart.beats(0, 300)]) * 1000
    assert 60_000 / rr_ms.mean() == pytest.approx(66, rel=0.02)
    assert 10 < np.sqrt(np.mean(np.diff(rr_ms) ** 2)) < 80
    assert 15 < rr_ms.std(ddof=1) < 80
    heart.heart_rate_bpm = 120
    later_ms = np.array([beat.rr_s for beat in heart.beats(305, 340)]) * 1000
    assert 60_000 / later_ms.mean() == pytest.approx(120, rel=0.03)


def test_beats_tile_time():
    """Every beat's RR interval is the distance to the one before, and windows neither share nor miss a beat."""
    heart = Heart(seed=2)
    beats = heart.beats(0, 120)
    for before, beat in itertools.pairwise(beats):
        assert beat.time_s - before.time_s == pytest.approx(beat.rr_s)
    assert heart.beats(0, 50) + heart.beats(50, 120) == beats


def test_without_contact_there_is_no_heartbeat_in_the_signal(shapes):
    """Taken off, the strap gives large noise and the arm band daylight."""
    wearing = Wearing(contact=False)
    ecg = EcgSource(Heart(1), wearing, shapes, seed=1).read(0, 1300, FS_HZ)
    assert ecg.std() > 1000
    ppg = PpgSource(Heart(1), wearing, shapes, seed=1).read(0, 550, 55.0)
    assert ppg[:, 3].mean() > 100_000


def test_the_stored_waveforms_are_what_neurokit2_simulates(shapes):
    """Writing the waveforms anew would change no sample that a sensor sends by a tenth of a count.

    An R peak of 1 is about 1000 counts of 1 uV. What another CPU computes differs by 1e-5, and by 5e-5 samples of where
    the peaks are; 0.01 of these is 10 us.
    """
    pytest.importorskip("neurokit2")
    made = waveforms.simulate()
    np.testing.assert_allclose(made.ecg, shapes.ecg, rtol=0, atol=1e-4)
    np.testing.assert_allclose(made.ppg, shapes.ppg, rtol=0, atol=1e-4)
    assert (made.ecg_peak, made.ppg_peak) == pytest.approx((shapes.ecg_peak, shapes.ppg_peak), abs=0.01)


def test_a_recorded_heart_that_pauses_or_stumbles_still_makes_a_pulse_wave(shapes):
    """Pauses of ten seconds and beats 0.1 s apart neither break the simulated PPG nor leave its range."""
    heart = RecordedHeart(np.array([0.5, 1.4, 11.4, 12.3, 12.4, 13.3]), 20.0)
    ppg = PpgSource(heart, Wearing(), shapes, seed=1).read(0, 55 * 40, 55.0)
    assert 258_000 < ppg[:, 0].min() < ppg[:, 0].max() < 263_000
    ecg = EcgSource(heart, Wearing(), shapes, seed=1).read(0, 130 * 40, 130.0)
    assert np.abs(ecg).max() < 2500
