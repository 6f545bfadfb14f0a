"""What the segments of a window say together: spectra, quality and artefacts of each channel. Stateless."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from interpreter_eeg.features import LINE, LINE_LEAVES, Spectrum, lines, quality_terms
from interpreter_eeg.segments import Measured

FEWEST = 3  # segments without an artefact that a channel's spectrum is made of
FEWEST_FOR_LINE = 8  # of them: in fewer, chance makes lines
LINE_TOLD = 36.0  # times what is beside it
LARGE = "too large for EEG: is the unit right?"
MARKS = {"flat": "flat", "saturated": "saturated", LARGE: "large", "electrode pops": "popped", "blinks": "blinked"}
TOLD = (LARGE, "blinks", "electrode pops", "muscle")  # what is told of channels that are not bad
MUSCLE, MUSCLE_WHITE = 4.0, 0.15  # times the channel's usual fast power, and flatness of the spectrum, of muscle
OWN = 0.03  # share of the electrodes' power that is not the same at all of them: side by side on a head it is 0.13

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Window(NamedTuple):
    """All but spectrum of shape (channels,). spectrum: mean over the good segments, NaN of bad channels.

    quality 0..1. bad: below the least quality, or too few good segments; cause: the main reason of each. excluded:
    share of the segments left out; left_out: by artefact, whether any was. pops, muscle: how many pops, how many
    segments with muscle. hum: rms of the mains. line_hz: where a line is that no brain makes, NaN without one.
    """

    spectrum: Spectrum
    quality: Floats
    bad: Bools
    cause: list[str]
    excluded: Floats
    left_out: dict[str, Bools]
    pops: NDArray[np.int64]
    muscle: NDArray[np.int64]
    hum: Floats
    line_hz: Floats


def window_of(segments: list[Measured], expected: int, min_quality: float, doubts: float = 1.0) -> Window:
    """Sum up at least one segment; expected: how many there were, had no sample been lost.

    doubts: how often those about a channel count; 2 where the device moves.
    """
    muscle = _muscle(_each(segments, "fast"), _each(segments, "white"))
    spoilt = {**{what: _each(segments, name) for what, name in MARKS.items()}, "muscle": muscle}
    missing = _each(segments, "missing")
    good = ~np.any([missing, *spoilt.values()], axis=0)
    found = Spectrum(_mean(_each(segments, "psd"), good), segments[0].step_hz)
    hum = _each(segments, "hum").mean(axis=0)
    came, alike = (~missing).sum(axis=0), np.median(_each(segments, "alike"), axis=0)
    line, line_hz = lines(found)
    line = np.where(good.sum(axis=0) >= FEWEST_FOR_LINE, line, 0.0)
    terms = {
        "samples missing": _each(segments, "filled").mean(axis=0) * np.minimum(1.0, came / max(expected, 1)),
        **{what: 1 - where.sum(axis=0) / np.maximum(came, 1) for what, where in spoilt.items()},
        "the same at all electrodes: bridged, or a noisy reference": np.minimum(1.0, (1 - alike) / OWN),
        "a line": np.maximum(LINE_LEAVES, 1 / (1 + (line / LINE) ** 4)),
        **quality_terms(found, hum, _each(segments, "drift").mean(axis=0)),
    }
    shares = np.nan_to_num(np.stack(list(terms.values())), nan=1.0)
    quality = np.where(good.sum(axis=0) < FEWEST, 0.0, np.clip(shares.prod(axis=0), 0.0, 1.0) ** doubts)
    bad = (quality < min_quality) | (good.sum(axis=0) < FEWEST)
    found.psd[:, bad] = np.nan
    return Window(
        found,
        quality,
        bad,
        cause=[list(terms)[worst] for worst in shares.argmin(axis=0)],
        excluded=1 - good.mean(axis=0),
        left_out={what: np.asarray(spoilt[what].any(axis=0)) for what in TOLD},
        pops=_each(segments, "pops").sum(axis=0),
        muscle=muscle.sum(axis=0),
        hum=hum,
        line_hz=np.where((line >= LINE_TOLD) & ~bad, line_hz, np.nan),
    )


def _each(segments: list[Measured], name: str) -> NDArray[Any]:
    """One field of all segments, shape (segments, ..., channels)."""
    return np.stack([getattr(segment, name) for segment in segments])


def _muscle(fast: Floats, white: Floats) -> Bools:
    """Which segments, shape (segments, channels), have far more fast power than the channel usually has."""
    return np.asarray((fast > MUSCLE * np.median(fast, axis=0)) & (white > MUSCLE_WHITE))


def _mean(psd: Floats, good: Bools) -> Floats:
    """The mean over the good segments, NaN where there is none."""
    total = (psd * good[:, None, :]).sum(axis=0)
    counts = good.sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)
