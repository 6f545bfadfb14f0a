"""Simulated EEG whose powers, peaks and indices are known."""

import numpy as np
import pytest
from brain_signals import CAP, brain, extra, play
from interpreter_eeg.config import Config
from interpreter_eeg.montage import montage_of, position_of

BANDS = ("delta_uv2", "theta_uv2", "alpha_uv2", "beta_uv2", "gamma_uv2")
INSIDE_HZ = (2.5, 6.0, 10.5, 20.0, 38.0)


def rhythm(hz, amplitude_uv, fs_hz, seconds=24.0):
    """A sine, shape (n,)."""
    return amplitude_uv * np.sin(2 * np.pi * hz * np.arange(round(seconds * fs_hz)) / fs_hz + 0.3)


@pytest.mark.parametrize("fs_hz", [100.0, 128.0, 250.0, 500.0, 2048.0])
def test_a_rhythm_has_its_power_in_its_band(fs_hz):
    """At any rate a rhythm of 40 uV adds 800 uV^2 to the band it lies in, within 8 %, and to no other."""
    quiet = brain(24, fs_hz, 1, alpha_uv=0.0)
    base = play(quiet, fs_hz, ["Cz"])[-1]
    for band, hz in zip(BANDS[:-1], INSIDE_HZ[:-1], strict=True):
        last = play(quiet + rhythm(hz, 40.0, fs_hz)[:, None], fs_hz, ["Cz"])[-1]
        added = {name: getattr(last, name)[0] - getattr(base, name)[0] for name in BANDS}
        assert added.pop(band) == pytest.approx(800.0, rel=0.08), band
        np.testing.assert_allclose(list(added.values()), 0.0, atol=2.0)


def test_relative_powers_are_shares_of_all_bands():
    """They add up to 1 and are the absolute ones over their sum; indices are made of the same powers."""
    last = play(brain(24, 250.0, len(CAP)), 250.0, CAP)[-1]
    absolute = np.array([getattr(last, band) for band in BANDS])
    shares = np.array([extra(last, f"relative_{band.removesuffix('_uv2')}") for band in BANDS])
    np.testing.assert_allclose(shares, absolute / absolute.sum(axis=0))
    pope = [CAP.index(name) for name in ("Cz", "Pz", "P3", "P4")]
    _, theta, alpha, beta, _ = absolute
    assert last.engagement_index == pytest.approx(beta[pope].mean() / (alpha[pope] + theta[pope]).mean())
    frontal, parietal = ([CAP.index(name) for name in sites] for sites in (("Fz", "F3", "F4"), ("Pz", "P3", "P4")))
    assert last.theta_alpha_ratio == pytest.approx(theta[frontal].mean() / alpha[parietal].mean())
    assert last.reasons == ()
    assert last.signal_quality > 0.9


def test_asymmetry_is_right_against_left_by_name():
    """Twice the alpha amplitude at F4 gives ln 4, wherever the channels stand; without such a pair NaN and why."""
    samples = brain(24, 128.0, 2, alpha_uv=0.0) * 0.3
    samples += np.stack([rhythm(10, 20.0, 128.0), rhythm(10, 10.0, 128.0)], axis=1)
    for names in (("F4", "F3"), ("EEG F4-REF", "EEG F3-REF"), ("af8", "af7")):
        assert play(samples, 128.0, names)[-1].frontal_alpha_asymmetry == pytest.approx(np.log(4), abs=0.05)
    assert play(samples[:, ::-1], 128.0, ("F4", "F3"))[-1].frontal_alpha_asymmetry == pytest.approx(
        -np.log(4), abs=0.05
    )
    without = play(samples, 128.0, ("ch1", "ch2"))[-1]
    assert np.isnan(without.frontal_alpha_asymmetry)
    assert any("no frontal pair" in reason for reason in without.reasons)


@pytest.mark.parametrize("peak_hz", [8.3, 9.7, 11.0, 12.2])
def test_the_individual_alpha_peak(peak_hz):
    """Found within 0.15 Hz; told as NaN with a reason where no peak stands out of the background."""
    samples = brain(24, 250.0, 1, alpha_uv=0.0)
    found = play(samples + rhythm(peak_hz, 10.0, 250.0)[:, None], 250.0, ["Pz"])[-1]
    assert extra(found, "alpha_peak")[0] == pytest.approx(peak_hz, abs=0.15)
    none = play(samples, 250.0, ["Pz"])[-1]
    assert np.isnan(extra(none, "alpha_peak")[0])
    assert any("alpha_peak" in reason for reason in none.reasons)


@pytest.mark.parametrize("true_hz", [275.16, 258.83, 240.0])
def test_frequencies_are_those_of_the_true_rate(true_hz):
    """A board declared with 250 Hz that comes faster or slower: alpha at 10.0 Hz all the same, and it is said."""
    updates = play(brain(40, true_hz, 2), 250.0, ["O1", "O2"], true_hz=true_hz)
    assert extra(updates[-1], "alpha_peak")[0] == pytest.approx(10.0, abs=0.12)
    assert updates[-1].reasons[0].startswith("sampling_frequency_hz is 250, measured 2")
    assert [update.signal_quality > 0.9 for update in updates[7:]] == [True] * len(updates[7:])
    assert not np.isfinite([update.alpha_uv2[0] for update in updates[:7]]).any()


def test_the_average_reference_takes_off_what_all_share():
    """What is in all channels is gone, and a bad channel does not get into the others by it."""
    samples = brain(24, 128.0, len(CAP), alpha_uv=0.0)
    shared = samples + rhythm(10, 50.0, 128.0)[:, None]
    shared[:, 5] += 2000 * np.random.default_rng(1).normal(size=len(samples))
    alpha = np.array(play(shared, 128.0, CAP, config=Config(reference="average"))[-1].alpha_uv2)
    plain = np.array(play(samples, 128.0, CAP)[-1].alpha_uv2)
    good = np.arange(len(CAP)) != 5
    assert np.isnan(alpha[5])
    np.testing.assert_allclose(alpha[good], plain[good], rtol=0.5)


@pytest.mark.parametrize(("left", "told"), [(5, True), (4, False), (2, False)])
def test_what_is_left_of_few_electrodes_is_no_average(left, told):
    """Of eight electrodes five are an average, four are none: two would have each other's powers, and no doubt."""
    samples = brain(24, 128.0, 8)
    samples[:, left:] = 0.0
    last = play(samples, 128.0, CAP[:8], config=Config(reference="average"))[-1]
    assert np.isfinite(last.alpha_uv2[:left]).all() == told
    assert np.isnan(last.alpha_uv2).all() != told
    assert told != any("reference 'average' needs 5 electrodes with a signal" in reason for reason in last.reasons)


def test_the_linked_reference():
    """Half of each ear is taken off; where an ear is no electrode, or is not there, that is said."""
    fs_hz, config = 128.0, Config(reference="linked")
    samples = brain(24, fs_hz, 3, alpha_uv=0.0)
    samples += rhythm(10, 50.0, fs_hz)[:, None] * [1.0, 0.9, 1.1]
    assert play(samples, fs_hz, ("Cz", "A1", "A2"), config=config)[-1].alpha_uv2[0] < 20
    samples[:, 1] = 7.0
    lost = play(samples, fs_hz, ("Cz", "A1", "A2"), config=config)[-1]
    assert np.isnan(lost.alpha_uv2[0])
    assert any("one of them gives no signal" in reason for reason in lost.reasons)
    with pytest.raises(ValueError, match="'reference' is 'linked', the stream has neither A1 and A2"):
        play(samples, fs_hz, ("Cz", "A1", "C3"), config=config)
    with pytest.raises(ValueError, match="'reference' is 'average', which needs 8 electrodes, not 3"):
        play(samples, fs_hz, ("Cz", "C4", "C3"), config=Config(reference="average"))


def test_the_names_of_biosemi_are_no_places():
    """Where a channel is named as only BioSemi does, A1 and A2 are no ears and C3 and C4 no frontal neighbours."""
    cap = montage_of(tuple(f"{letter}{k}" for letter in "ABCD" for k in range(1, 33)))
    assert cap.columns == {}
    assert cap.scalp.all()
    assert set(montage_of(("A1", "A2", "C3", "C4")).columns) == {"A1", "A2", "C3", "C4"}
    assert set(montage_of(("A1", "B1", "Cz")).columns) == {"Cz"}


@pytest.mark.parametrize("name", ["VEO", "HEOL", "EXG1", "STI 014", "Sample Counter", "Timestamp", "Pulse", "Photic"])
def test_channels_that_are_no_electrode_of_the_scalp(name):
    """Eyes, triggers, counters and other signals do not enter averages."""
    assert montage_of(("Cz", name)).scalp.tolist() == [True, False]


def test_names_of_electrodes():
    """As devices write them; what is none of a position is none, and eyes or triggers are not of the scalp."""
    written = ["EEG Fp1-REF", "FP2", "fz.", "T3", "EEG T6-LE", "POz", "M1", "AFF1h", "TP10", "Fp1-F7", "ch1", "EEG"]
    usual = ["Fp1", "Fp2", "Fz", "T7", "P8", "POz", "M1", "", "TP10", "", "", ""]
    assert [position_of(name) for name in written] == usual
    others = ["EEG.AF3", "eeg-t8", "RAW_TP9", "F3-M1M2", "F3-AVE", "C4-LER", "Pz:A1", "O1/A2", "Fz (uV)"]
    assert [position_of(name) for name in others] == ["AF3", "T8", "TP9", "F3", "F3", "C4", "Pz", "O1", "Fz"]
    assert montage_of(("Cz", "ch2", "EOG1", "Right AUX", "A1")).scalp.tolist() == [True, True, False, False, False]


@pytest.mark.parametrize(
    ("sizes", "lost"), [((1, 5, 25), [(12.0, 12.5)]), ((1, 5), [(7.0, 7.05), (12.0, 12.5), (14.0, 14.1)])]
)
def test_the_result_does_not_depend_on_how_samples_are_cut(sizes, lost):
    """One signal with samples missing, short holes and a long one in it, in frames of any size, gives the same."""
    samples = brain(24, 100.0, 2)
    samples[700:705, 0] = np.nan
    texts = []
    for size in sizes:
        updates = play(samples, 100.0, ("F3", "F4"), sizes=[size] * (2400 // size), lost=lost)
        texts.append(repr([update._replace(received_ns=0) for update in updates]))
    assert len(set(texts)) == 1
    assert len(updates) >= 20


@pytest.mark.parametrize("fs_hz", [50.0, 20_000.0])
def test_a_rate_that_no_eeg_has_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 64 to 16384 for EEG"):
        play(np.zeros((100, 1)), fs_hz, ["Cz"])


@pytest.mark.parametrize("edges", [(1.0, 4.0, 8.0, 13.0, 30.0), (1.0, 4.0, 8.0, 8.0, 30.0, 45.0)])
def test_band_edges_that_are_none(edges):
    """Six rising numbers, or one sentence."""
    with pytest.raises(ValueError, match=r"band_edges_hz.*six rising numbers"):
        Config(band_edges_hz=edges)
