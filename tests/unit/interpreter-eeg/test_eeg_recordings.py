"""Real recordings, and what is known of them (../shared/data/REFERENCE.md, section 10)."""

import numpy as np
from brain_signals import BIOSPPY_HZ, EEGLAB, EEGLAB_HZ, MUSE, MUSE_HZ, OPENBCI_HZ, eeglab, extra, muse, openbci, play


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


def test_eeglab_has_its_alpha_at_the_back(shared_data):
    """Peak at 10 Hz within 0.5 Hz; the share of alpha above .5 at Oz and POz, below .35 at Fz; quality is high."""
    updates = play(eeglab(shared_data), EEGLAB_HZ, EEGLAB)
    peaks_hz = [extra(update, "alpha_peak")[0] for update in updates if update.extra]
    assert abs(np.nanmedian(peaks_hz) - 10.0) < 0.5
    alpha = dict(zip(EEGLAB, shares(updates, "relative_alpha"), strict=True))
    assert alpha["Oz"] > 0.5
    assert alpha["POz"] > 0.5
    assert alpha["Fz"] < 0.35
    assert np.median([update.signal_quality for update in updates[3:]]) > 0.85


def test_muse_muscle_at_the_forehead_is_told(shared_data):
    """AF8 is named for its flat spectrum; the ears' alpha goes on."""
    updates = play(muse(shared_data), MUSE_HZ, MUSE)
    told = [any("noise or muscle" in r and "AF8" in r for r in update.reasons) for update in updates]
    assert np.mean(told) > 0.5
    assert np.isfinite([update.alpha_uv2[3] for update in updates[3:]]).mean() > 0.9


def test_openbci_with_lost_packets(shared_data):
    """A recording that only drifts has no band powers and says so; lost packets are counted by the quality."""
    samples = openbci(shared_data)[:, 1:]
    names = [f"ch{k}" for k in range(1, 9)]
    whole = play(samples, OPENBCI_HZ, names)
    assert all("drift or motion" in " ".join(update.reasons) for update in whole[2:])
    assert np.isnan(whole[-1].alpha_uv2).all()
