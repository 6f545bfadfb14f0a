"""Indices made of the band powers of named electrodes. Stateless."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from interpreter_eeg import montage as sites
from interpreter_eeg.features import BANDS, Spectrum
from interpreter_eeg.features import alpha_peak_hz as peak_hz
from interpreter_eeg.montage import Montage

THETA, ALPHA, BETA = (BANDS.index(name) for name in ("theta", "alpha", "beta"))

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Indices(NamedTuple):
    """NaN where an index cannot be computed; reasons says why. asymmetries: (left, right, ln right - ln left)."""

    engagement: float
    theta_alpha: float
    theta_alpha_all: float
    asymmetry: float
    asymmetries: list[tuple[str, str, float]]
    reasons: list[str]


def indices(powers: Floats, montage: Montage, bad: Bools) -> Indices:
    """Return the indices of band powers, shape (bands, channels) in any one unit.

    Engagement: beta / (alpha + theta) of Cz, Pz, P3, P4 together (Pope, Bogart & Bartolome 1995), of all electrodes of
    the scalp where there is none of these. Theta over alpha: frontal theta over parietal alpha (Gevins & Smith 2003).
    Asymmetry: ln right - ln left alpha (Allen, Coan & Nazarian 2004) of the first pair of `PAIRS` that there is.
    """
    reasons: list[str] = []
    every = [column for column in np.flatnonzero(montage.scalp) if not bad[column]]
    if not every:
        reason = "engagement_index, theta_alpha_ratio, frontal_alpha_asymmetry: no good electrode"
        return Indices(np.nan, np.nan, np.nan, np.nan, [], [reason])
    pope = _good(montage, sites.POPE, bad)
    if not pope:
        reasons.append("engagement_index: of all electrodes, none of Cz, Pz, P3, P4 is there and good")
    theta, alpha, beta = (powers[band, pope or every].mean() for band in (THETA, ALPHA, BETA))
    frontal, parietal = _good(montage, sites.FRONTAL, bad), _good(montage, sites.PARIETAL, bad)
    ratio = np.nan
    if frontal and parietal:
        ratio = powers[THETA, frontal].mean() / powers[ALPHA, parietal].mean()
    else:
        reasons.append("theta_alpha_ratio: needs a good frontal and a good parietal electrode (Fz, F1-F4; Pz, P1-P4)")
    overall = powers[THETA, every].mean() / powers[ALPHA, every].mean()
    asymmetries = [(left, right, _log_ratio(powers, montage, left, right)) for left, right in montage.pairs()]
    asymmetry = asymmetries[0][2] if asymmetries else np.nan
    if np.isnan(asymmetry):
        pair = f"{asymmetries[0][0]} or {asymmetries[0][1]} is bad" if asymmetries else "no frontal pair such as F3, F4"
        reasons.append(f"frontal_alpha_asymmetry: {pair}")
    return Indices(float(beta / (alpha + theta)), float(ratio), float(overall), asymmetry, asymmetries, reasons)


def alpha_peak_hz(spectrum: Spectrum, montage: Montage, bad: Bools) -> float:
    """Return the individual alpha peak of the posterior electrodes together, of all where none is there and good."""
    every = [column for column in np.flatnonzero(montage.scalp) if not bad[column]]
    columns = _good(montage, sites.POSTERIOR, bad) or every
    return peak_hz(spectrum.psd[:, columns].mean(axis=1), spectrum.step_hz) if columns else np.nan


def _good(montage: Montage, positions: tuple[str, ...], bad: Bools) -> list[int]:
    return [column for column in montage.present(positions) if not bad[column]]


def _log_ratio(powers: Floats, montage: Montage, left: str, right: str) -> float:
    lefts, rights = powers[ALPHA, montage.columns[left]], powers[ALPHA, montage.columns[right]]
    return float(np.log(rights) - np.log(lefts))
