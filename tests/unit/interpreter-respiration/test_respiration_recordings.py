"""Real belts, and what established tools count (../shared/data/REFERENCE.md, sections 4, 5 and 13)."""

from functools import cache

import numpy as np
import pytest
from interpreter_respiration.config import Config
from interpreter_respiration.stream import RespirationStream
from slow_signals import PHYSIOKIT_HZ, event_times_s
from slow_signals import play as play_signal

PHYSIOKIT = {"range_min": 0.0, "range_max": 4095.0}


def play(samples, fs_hz, **options):
    return play_signal(lambda info: RespirationStream(Config(), info), samples, fs_hz, "respiration", "a.u.", **options)


def breaths_s(updates):
    return event_times_s(updates, "breath_timestamps")


@cache
def column(path, name):
    return np.genfromtxt(path, delimiter=",", names=True)[name]


def test_five_minutes_of_rest(shared_data):
    """77 breaths, as NeuroKit2 and BioSPPy count, one more or less; the mean rate is theirs within 1 /min."""
    path = shared_data / "multimodal" / "neurokit" / "bio_resting_5min_100hz.csv"
    updates = play(column(path, "RSP"), 100.0)
    assert abs(len(breaths_s(updates)) - 77) <= 1
    assert np.nanmean([update.breaths_per_min for update in updates]) == pytest.approx(15.7, abs=1.0)
    assert np.nanmedian([update.signal_quality for update in updates]) > 0.7


def test_pictures_and_a_ward(shared_data):
    """NeuroKit2 counts 40 breaths while pictures are shown, and 195 in ten minutes of a ventilated patient."""
    wfdb = pytest.importorskip("wfdb")
    path = shared_data / "multimodal" / "neurokit" / "bio_eventrelated_100hz.csv"
    assert abs(len(breaths_s(play(column(path, "RSP"), 100.0))) - 40) <= 1
    record = wfdb.rdrecord(str(shared_data / "multimodal" / "mimicdb" / "03700181"), smooth_frames=False)
    patient = play(record.e_p_signal[record.sig_name.index("RESP")], 125.0)
    assert abs(len(breaths_s(patient)) - 195) <= 2


def test_irregular_and_clipped(shared_data):
    """The tools count 12 to 16 breaths; that the belt is at its end is told."""
    belt = np.loadtxt(shared_data / "resp" / "biosppy" / "resp.txt")
    updates = play(belt, 1000.0, range_min=0.0, range_max=4095.0)
    assert 12 <= len(breaths_s(updates)) <= 16
    assert any("end of its range" in reason for update in updates for reason in update.reasons)


def test_physiokit_p11_breathes_and_p12_is_saturated(shared_data):
    """P11: 55 breaths at 11.25 /min by NeuroKit2; P12 sits at the end of its range: nothing but the reason."""
    names = {name[:3]: name for name in PHYSIOKIT_HZ}
    belts = {
        short: column(shared_data / "multimodal" / "physiokit" / f"{name}.csv", "Resp") for short, name in names.items()
    }
    p11 = play(belts["P11"], PHYSIOKIT_HZ[names["P11"]], **PHYSIOKIT)
    assert abs(len(breaths_s(p11)) - 55) <= 3
    assert np.nanmean([update.breaths_per_min for update in p11]) == pytest.approx(11.25, abs=0.75)
    p12 = play(belts["P12"], PHYSIOKIT_HZ[names["P12"]], **PHYSIOKIT)
    assert len(breaths_s(p12)) == 0
    assert all(np.isnan(update.breaths_per_min) for update in p12)
    assert all("saturated" in update.reasons[0] for update in p12[12:])
