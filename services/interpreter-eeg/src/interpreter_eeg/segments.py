"""Segments of one stream, half over each other, each measured once: what the updates are averages of."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.hum import STANDS_OUT, folds_hz, hum
from sense4hri.living import held

from interpreter_eeg import artefacts
from interpreter_eeg.features import (
    BRAIN_HZ,
    PEAK_HZ,
    Spectrum,
    fast_density,
    mended,
    rms,
    spectrum,
    whiteness,
    without_line,
)
from interpreter_eeg.montage import Montage

FEWEST_FOR_AVERAGE = 8  # electrodes that tell the head's from the reference's
FEWEST_LEFT = 5  # of them with a signal that are an average still
FOLDED_STANDS_OUT = 4.0  # times the amplitude beside it: no rhythm but alpha is as narrow
HELD_S = 0.05  # exactly the same for longer is no signal
ROUNDED = 1e-9  # of a channel, that is left of it where the reference is the same
LOUD = 4.0  # times the usual spread from which on a channel does not enter the average reference

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Signal(NamedTuple):
    """What the segments are of. blink_uv: the parameter. low, high: range; calibrated: the unit is uV."""

    fs_hz: float
    montage: Montage
    reference: str
    calibrated: bool
    blink_uv: float
    low: float
    high: float

    def floor(self, microvolts: float) -> float:
        """Return this height in the signal's unit, 0 where no scale is known."""
        return microvolts if self.calibrated else 0.0

    def ceiling(self, microvolts: float) -> float:
        """Return this height in the signal's unit, infinite where no scale is known."""
        return microvolts if self.calibrated else np.inf


class Measured(NamedTuple):
    """One segment. psd: shape (bins, channels), step_hz apart; all others but the last two of shape (channels,).

    fast, white: density of fast frequencies, and what that is of the slow ones. hum, drift: rms, in the signal's unit.
    filled: share of the samples that came. pops: how many begin in its middle
    half, so that each is counted by one segment; blinks_ns: times of the blinks there. alike: how much of their
    power is the same at all electrodes.
    """

    end_ns: int
    step_hz: float
    psd: Floats
    fast: Floats
    white: Floats
    alike: Floats
    hum: Floats
    drift: Floats
    filled: Floats
    missing: Bools
    flat: Bools
    saturated: Bools
    large: Bools
    popped: Bools
    blinked: Bools
    pops: NDArray[np.int64]
    blinks_ns: tuple[int, ...]


class Segments:
    """Cuts samples into segments that begin with the first one, so that the cut into chunks cannot matter."""

    def __init__(self, signal: Signal, segment_s: float) -> None:
        self._signal = signal
        self._hop = max(1, round(segment_s * signal.fs_hz / 2))
        self.restart()

    def restart(self) -> None:
        """Samples are missing: the next one begins anew."""
        self._samples = np.empty((0, len(self._signal.montage.names)))
        self._times_ns = np.empty(0, np.int64)

    def push(self, samples: Floats, times_ns: NDArray[np.int64]) -> list[Measured]:
        """Take samples, shape (n, channels), lost ones NaN, at their times; return the segments complete now."""
        self._samples = np.concatenate([self._samples, samples])
        self._times_ns = np.concatenate([self._times_ns, times_ns])
        return self._complete()

    def _complete(self) -> list[Measured]:
        found, first = [], 0
        while first + 2 * self._hop <= len(self._samples):
            here = slice(first, first + 2 * self._hop)
            found.append(measured(self._samples[here], self._times_ns[here], self._signal))
            first += self._hop
        self._samples, self._times_ns = self._samples[first:], self._times_ns[first:]
        return found


class _Potentials(NamedTuple):
    """A segment, shape (n, channels), without its straight line, which rises by `rise` over it; what channels lack."""

    segment: Floats
    rise: Floats
    missing: Bools
    flat: Bools
    saturated: Bools

    @property
    def usable(self) -> Bools:
        """Which channels show a signal."""
        return ~(self.missing | self.flat | self.saturated)


def measured(raw: Floats, times_ns: NDArray[np.int64], signal: Signal) -> Measured:
    """Measure one segment, shape (n, channels)."""
    fs_hz = signal.fs_hz
    raw = _without_held(raw, fs_hz)
    recorded = _recorded(raw, signal)
    referred = _referred(recorded, signal)
    mains = hum(referred.segment, fs_hz, _folded_stands_out(fs_hz))
    segment = referred.segment - mains
    pops = artefacts.pops(segment, fs_hz, signal.floor(artefacts.JUMP_UV))
    popped = np.array([len(found) > 0 for found in pops])
    seeing = recorded.usable & ~referred.missing & ~popped
    blinks = artefacts.blinks(segment, fs_hz, signal.montage, seeing, signal.floor(signal.blink_uv))
    middle = range(len(raw) // 4, len(raw) // 4 + len(raw) // 2)
    psd = spectrum(segment, fs_hz)
    if mains.any():
        psd = mended(psd, spectrum(mains, fs_hz))
    return Measured(
        end_ns=int(times_ns[-1]),
        step_hz=psd.step_hz,
        psd=psd.psd,
        fast=fast_density(psd),
        white=whiteness(psd),
        alike=_alike(segment, psd, signal, referred.usable),
        hum=mains.std(axis=0),
        drift=np.abs(referred.rise) / np.sqrt(12),
        filled=artefacts.known(raw).mean(axis=0),
        missing=referred.missing,
        flat=referred.flat,
        saturated=referred.saturated,
        large=rms(psd) > signal.ceiling(artefacts.LARGE_UV),
        popped=popped,
        blinked=blinks.spoilt,
        pops=np.array([sum(int(at) in middle for at in found) for found in pops]),
        blinks_ns=tuple(int(times_ns[peak]) for peak in blinks.peaks if peak in middle),
    )


def _without_held(raw: Floats, fs_hz: float) -> Floats:
    """NaN where a channel stays exactly the same for long; one that never changes is flat, not missing."""
    same = held(raw, HELD_S * fs_hz)
    return np.where(same & ~same.all(axis=0), np.nan, raw)


def _recorded(raw: Floats, signal: Signal) -> _Potentials:
    """Return the segment against the reference with which it was recorded."""
    segment, missing = artefacts.drawn_through(raw, signal.fs_hz)
    flat = artefacts.flat(segment, signal.floor(artefacts.FLAT_UV)) & ~missing
    saturated = artefacts.saturated(segment, signal.low, signal.high)
    return _Potentials(*without_line(segment), missing, flat, saturated)


def _referred(recorded: _Potentials, signal: Signal) -> _Potentials:
    """Return the segment against the chosen reference; a channel that is the same as that is flat."""
    both = np.vstack([recorded.segment, recorded.rise])
    both, missing = rereferenced(both, signal, recorded.usable, recorded.missing)
    segment = both[:-1]
    least = np.maximum(signal.floor(artefacts.FLAT_UV), ROUNDED * np.ptp(recorded.segment, axis=0))
    flat = recorded.flat | (artefacts.flat(segment, least) & ~missing)
    return _Potentials(segment, both[-1], missing, flat, recorded.saturated)


def _alike(segment: Floats, psd: Spectrum, signal: Signal, usable: Bools) -> Floats:
    """How much of the electrodes' power is in the mean of them, shape (channels,); 0 of few and of other channels."""
    heads = usable & signal.montage.scalp
    out = np.zeros(len(heads))
    if heads.sum() >= FEWEST_FOR_AVERAGE:
        mean = spectrum(segment[:, heads].mean(axis=1, keepdims=True), signal.fs_hz)
        out[heads] = mean.power(*BRAIN_HZ) / psd.power(*BRAIN_HZ)[heads].mean()
    return out


def _folded_stands_out(fs_hz: float) -> float:
    """How far mains that sampling folds into the bands stand out: little, but where alpha does."""
    beside_alpha = all(not PEAK_HZ[0] <= hz <= PEAK_HZ[1] for hz in folds_hz(fs_hz))
    return FOLDED_STANDS_OUT if beside_alpha else STANDS_OUT


def rereferenced(segment: Floats, signal: Signal, usable: Bools, missing: Bools) -> tuple[Floats, Bools]:
    """Return the segment, shape (n, channels), against the chosen reference, and which channels are missing then.

    Channels that are not usable, and those far louder than the others, do not enter an average.
    """
    if signal.reference == "linked":
        ears = signal.montage.linked()
        both = usable[ears].all()
        return segment - segment[:, ears].mean(axis=1, keepdims=True), missing if both else np.ones_like(missing)
    if signal.reference == "none":
        return segment, missing
    good = np.flatnonzero(usable & signal.montage.scalp)
    if len(good) < FEWEST_LEFT:
        return segment, np.ones_like(missing)
    spread = segment[:-1, good].std(axis=0)
    good = good[spread <= LOUD * np.median(spread)]
    return segment - segment[:, good].mean(axis=1, keepdims=True), missing
