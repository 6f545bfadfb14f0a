"""Real recordings, and what is known of them (../shared/data/REFERENCE.md, section 10)."""

import numpy as np
from brain_signals import (
    BIOSPPY_HZ,
    BLINKS_S,
    EEGLAB,
    EEGLAB_HZ,
    MUSE,
    MUSE_HZ,
    OPENBCI,
    OPENBCI_HZ,
    blink_times_s,
    brain,
    eeglab,
    extra,
    muse,
    openbci,
    play,
)


def shares(updates, name):
    """The median of a relative band power over the updates that have one, per channel."""
    return np.median([extra(update, name) for update in updates if len(extra(update, name))], axis=0)


def test_closed_eyes_have_twice_the_alpha_of_open_ones(shared_data):
    """The share of alpha is at least 2 times as high; raw counts, so no uV^2."""
    closed, opened = (
        play(np.loadtxt(shared_data / "eeg" / "biosppy" / f"eeg_{eyes}.txt")[:, None], BIOSPPY_HZ, ["EEG"], "counts")
        for eyes in ("ec", "eo")
    )
    assert shares(closed, "relative_alpha")[0] >= 2 * shares(opened, "relative_alpha")[0]
    assert np.isnan(closed[-1].alpha_uv2[0])


def test_eeglab_has_its_alpha_at_the_back_and_its_blinks_in_front(shared_data):
    """Peak at 10 Hz within 0.5 Hz; the share of alpha above .5 at Oz and POz, below .35 at Fz; 11 of 13 blinks."""
    updates = play(eeglab(shared_data), EEGLAB_HZ, EEGLAB)
    peaks_hz = [extra(update, "alpha_peak")[0] for update in updates if update.extra]
    assert abs(np.nanmedian(peaks_hz) - 10.0) < 0.5
    alpha = dict(zip(EEGLAB, shares(updates, "relative_alpha"), strict=True))
    assert alpha["Oz"] > 0.5
    assert alpha["POz"] > 0.5
    assert alpha["Fz"] < 0.35
    assert np.median([update.signal_quality for update in updates[3:]]) > 0.85
    found_s = np.array(blink_times_s(updates))
    assert sum(np.abs(found_s - at_s).min() < 0.2 for at_s in BLINKS_S) >= 11
    assert len(found_s) <= 14


def test_muse_muscle_at_the_forehead_is_told(shared_data):
    """AF8 is named for its flat spectrum; the ears' alpha goes on."""
    updates = play(muse(shared_data), MUSE_HZ, MUSE)
    told = [any("noise or muscle" in r and "AF8" in r for r in update.reasons) for update in updates]
    assert np.mean(told) > 0.5
    assert np.isfinite([update.alpha_uv2[3] for update in updates[3:]]).mean() > 0.9


def test_openbci_drifts_too_much_to_say_anything(shared_data):
    """A recording of a board that only drifts has no band powers, and the reason."""
    whole = play(openbci(shared_data)[:, 1:], OPENBCI_HZ, OPENBCI)
    assert all("drift or motion" in " ".join(update.reasons) for update in whole[3:])
    assert np.isnan(whole[-1].alpha_uv2).all()


def test_lost_packets_of_an_openbci_counter(shared_data):
    """Its counter runs without a gap; where packets are taken out by it, quality says how much and updates go on."""
    recorded = openbci(shared_data)
    counter = recorded[:, 0].astype(int)
    assert (np.diff(counter) % 256 == 1).all()
    samples = brain(len(counter) / OPENBCI_HZ, OPENBCI_HZ, 8)
    every_2_s = [(at_s, at_s + 0.06) for at_s in np.arange(1.0, 13.0, 2.0)]
    one_s = [(6.0, 7.0)]
    whole, short, long = (
        play(samples, OPENBCI_HZ, OPENBCI, sizes=[5] * 694, lost=lost)[-1] for lost in ([], every_2_s, one_s)
    )
    assert whole.signal_quality > short.signal_quality > long.signal_quality > 0.5
    np.testing.assert_allclose(short.alpha_uv2, whole.alpha_uv2, rtol=0.15)
    np.testing.assert_allclose(long.alpha_uv2, whole.alpha_uv2, rtol=0.4)


def test_no_recording_has_a_line(shared_data):
    """What EEGLAB, BioSPPy and a Muse recorded holds no line that is told."""
    raw = [np.loadtxt(shared_data / "eeg" / "biosppy" / f"eeg_{eyes}.txt")[:, None] for eyes in ("ec", "eo")]
    played = [play(samples, BIOSPPY_HZ, ["EEG"], "counts") for samples in raw]
    played += [play(eeglab(shared_data), EEGLAB_HZ, EEGLAB), play(muse(shared_data), MUSE_HZ, MUSE)]
    assert not [reason for updates in played for update in updates for reason in update.reasons if "a line" in reason]
