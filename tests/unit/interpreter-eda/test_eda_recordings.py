"""Real recordings, and what established tools find in them (../shared/data/REFERENCE.md, section 8)."""

import numpy as np
from interpreter_eda.config import Config
from interpreter_eda.stream import EdaStream
from slow_signals import PHYSIOKIT_HZ, event_times_s
from slow_signals import play as play_signal

PICTURES_S = (10.24, 49.57, 129.84)


def play(samples, fs_hz, unit="uS", config=None, **options):
    """Updates of conductances."""
    return play_signal(lambda info: EdaStream(config or Config(), info), samples, fs_hz, "eda", unit, **options)


def peaks_s(updates):
    """When the responses that were told have their peaks."""
    return event_times_s(updates, "scr_peak_timestamps")


def wandering(updates):
    """Those that call the responses of real skin a random walk."""
    return [update for update in updates if any("falls are as steep as rises" in each for each in update.reasons)]


def physiokit(folder, name, column="EDA"):
    path = folder / "multimodal" / "physiokit" / f"{name}.csv"
    return play(np.genfromtxt(path, delimiter=",", names=True)[column], PHYSIOKIT_HZ[name], "counts")


def test_biosppy_recording(shared_data):
    """Within two responses of NeuroKit2 (7) and of BioSPPy (6), and the five that both see are among them."""
    updates = play(np.loadtxt(shared_data / "eda" / "biosppy" / "eda.txt"), 1000.0, "counts")
    found = peaks_s(updates)
    assert 5 <= len(found) <= 8
    assert not wandering(updates)
    for both_s in (69.3, 75.9, 106.5, 116.4, 134.7):
        assert np.abs(found - both_s).min() < 1.2, both_s


def test_pictures_are_answered(shared_data):
    """A response 1 to 5 s after the first, second and fourth picture; within two of the 9 that NeuroKit2 counts.

    After the third picture there is none: the slope does not change in these seconds, and NeuroKit2 has none either.
    """
    path = shared_data / "multimodal" / "neurokit" / "bio_eventrelated_100hz.csv"
    updates = play(np.genfromtxt(path, delimiter=",", names=True)["EDA"], 100.0)
    found = peaks_s(updates)
    assert 7 <= len(found) <= 11
    for picture_s in PICTURES_S:
        after_s = found - picture_s
        assert ((after_s >= 0.9) & (after_s <= 5.0)).any(), picture_s
    assert not ((found > 92.24) & (found < 98.0)).any()
    amplitudes = np.array([a for update in updates for a in update.scr_amplitudes_us])
    for at_s, least_us in ((14.95, 3.1), (47.48, 2.4), (70.23, 2.3), (147.41, 1.9)):
        near = int(np.abs(found - at_s).argmin())
        assert abs(found[near] - at_s) < 0.4
        assert least_us < amplitudes[near] < 1.25 * least_us
    assert np.median([update.signal_quality for update in updates]) > 0.9
    assert not wandering(updates)


def test_a_belt_is_no_skin(shared_data):
    """A real belt as if it were 6 uS: most updates say that responses come as evenly as breaths, few are sure."""
    path = shared_data / "multimodal" / "neurokit" / "bio_eventrelated_100hz.csv"
    chest = np.genfromtxt(path, delimiter=",", names=True)["RSP"]
    updates = play(6 + 0.4 * (chest - chest.mean()) / chest.std(), 100.0)[30:]
    assert np.mean(["as evenly as breaths" in " ".join(update.reasons) for update in updates]) > 0.6
    assert np.mean([update.signal_quality >= 0.7 for update in updates]) < 0.4


def test_physiokit_p11_is_skin_and_p12_is_flat(shared_data):
    """P11 has responses, its great ones among them; P12 is told to be flat once half a minute has been seen."""
    p11 = physiokit(shared_data, "P11_baseline_1675943915_070305")
    found = peaks_s(p11)
    assert 8 <= len(found) <= 60
    for at_s in (96.5, 227.3, 247.6):
        assert np.abs(found - at_s).min() < 0.6
    assert not wandering(p11)
    p12 = physiokit(shared_data, "P12_baseline_1675943910_462031")
    assert len(peaks_s(p12)) == 0
    assert all(update.scr_count == -1 and "flat" in update.reasons[0] for update in p12[35:])


def test_a_pulse_sensor_in_the_wrong_socket_is_told(shared_data):
    """P11's finger PPG under the name of EDA: most updates say that it shows the heart's pulse, none a response."""
    updates = physiokit(shared_data, "P11_baseline_1675943915_070305", "PPG_Finger")
    told = [update for update in updates if "heart's pulse" in update.reasons[0]]
    assert len(told) > 0.75 * len(updates)
    assert len(peaks_s(updates)) == 0


def test_the_noise_floor_of_a_wrist_band_is_no_response(shared_data):
    """42 min of an E4 at 0.06 to 0.11 uS, where NeuroKit2 counts 238 responses: none; with a floor of 0.05 uS a few."""
    conductance = np.loadtxt(shared_data / "e4" / "flirt" / "EDA.csv")[2:]
    updates = play(conductance, 4.0)
    assert len(peaks_s(updates)) == 0
    assert all("loose electrode" in update.reasons[0] for update in updates)
    assert len(peaks_s(play(conductance[3000:4000], 4.0, config=Config(least_level_us=0.05)))) <= 2
