"""The state of one EEG stream: the measured segments of its window; an update per grid point."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.hum import folds_hz
from sense4hri.motion import Motion
from sense4hri.rate import TrueRate
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_eeg import indices
from interpreter_eeg.config import Config
from interpreter_eeg.features import BANDS, relative
from interpreter_eeg.montage import montage_of
from interpreter_eeg.segments import FEWEST_FOR_AVERAGE, FEWEST_LEFT, Measured, Segments, Signal
from interpreter_eeg.window import FEWEST, Window, window_of

FS_HZ = (64.0, 16_384.0)
MOST_CHANNELS = 128
BRIDGED_S = 0.1  # a shorter hole is drawn through
EARLIER = 0.5  # of a segment, that one begins before the window at most: its grid is not that of the updates
NAMED = 8  # channels that a reason names

Floats = NDArray[np.float64]


class EegUpdate(NamedTuple):
    """What the EEG message says; arrays follow channel_names, NaN where something cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    channel_names: tuple[str, ...]
    delta_uv2: tuple[float, ...]
    theta_uv2: tuple[float, ...]
    alpha_uv2: tuple[float, ...]
    beta_uv2: tuple[float, ...]
    gamma_uv2: tuple[float, ...]
    channel_quality: tuple[float, ...]
    engagement_index: float
    theta_alpha_ratio: float
    frontal_alpha_asymmetry: float
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class EegStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate, montage or reference it cannot work with."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, names = info.sampling_frequency_hz, info.channel_names
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for EEG")
        if not 1 <= len(names) <= MOST_CHANNELS:
            raise ValueError(f"the stream has {len(names)} channels, must be 1 to {MOST_CHANNELS} for EEG")
        self._config, self._unit = config, info.unit
        self._montage = montage_of(names)
        self._check_reference()
        limits = config.blink_uv, info.range_min, info.range_max
        self._signal = Signal(fs_hz, self._montage, config.reference, info.unit == "uV", *limits)
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S, filled=True)
        self._rate, self._motion = TrueRate(fs_hz), Motion()
        self._begin(0)

    def _begin(self, begun_ns: int) -> None:
        """Everything begins anew with the samples from begun_ns on, at the rate that is known now."""
        self._begun_ns = begun_ns
        self._segments = Segments(self._signal._replace(fs_hz=self._rate.hz), self._config.segment_s)
        self._window: deque[Measured] = deque()

    def _check_reference(self) -> None:
        montage, reference = self._montage, self._config.reference
        if reference == "linked" and not montage.linked():
            raise ValueError(
                "parameter 'reference' is 'linked', the stream has neither A1 and A2, M1 and M2 nor TP9 and TP10"
            )
        if reference == "average" and montage.scalp.sum() < FEWEST_FOR_AVERAGE:
            count = int(montage.scalp.sum())
            raise ValueError(
                f"parameter 'reference' is 'average', which needs {FEWEST_FOR_AVERAGE} electrodes, not {count}"
            )

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def push(self, timed: TimedChunk) -> list[EegUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _interpret(self, block: Block) -> list[EegUpdate]:
        if self._rate.take(block):
            self._begin(int(block.times_ns[0]))
        if len(block.times_ns):
            self._window.extend(self._segments.push(block.samples, block.times_ns))
        updates = [self._update(block)] if block.due else []
        if block.hole is not None:
            self._segments.restart()
        if block.hole not in (None, Hole.CHAIN):
            self._window.clear()
        return updates

    def _update(self, block: Block) -> EegUpdate:
        window_s, segment_s = block.window_s(self._config.window_s), self._config.segment_s
        oldest_ns = block.end_ns - round((self._config.window_s - EARLIER * segment_s) * SECOND_NS)
        while self._window and self._window[0].end_ns <= oldest_ns:
            self._window.popleft()
        known_s = min(window_s, (block.end_ns - self._begun_ns) / SECOND_NS)
        expected = int(2 * (known_s - segment_s) / segment_s + 1e-6) + 1
        if expected < FEWEST:
            return self._nothing(block, window_s, np.nan, f"band powers need {segment_s * (1 + FEWEST) / 2:g} s")
        if self._window:
            doubts = 1 + self._motion.at(block.received_ns, self._config.window_s).strength
            window = window_of(list(self._window), expected, self._config.min_quality, doubts)
            return self._told(block, window_s, window)
        return self._nothing(block, window_s, 0.0, f"no {segment_s:g} s without a hole: too many samples are lost")

    def _told(self, block: Block, window_s: float, window: Window) -> EegUpdate:
        edges, montage = self._config.band_edges_hz, self._montage
        powers = np.array([window.spectrum.power(*edges[band : band + 2]) for band in range(len(BANDS))])
        scale = 1.0 if self._unit == "uV" else np.nan
        delta, theta, alpha, beta, gamma = (tuple((scale * band).tolist()) for band in powers)
        found = indices.indices(powers, montage, window.bad)
        peak_hz = indices.alpha_peak_hz(window.spectrum, montage, window.bad)
        heads = montage.scalp if montage.scalp.any() else np.ones(len(montage.names), bool)
        return EegUpdate(
            block.device_ns,
            block.received_ns,
            window_s,
            montage.names,
            delta,
            theta,
            alpha,
            beta,
            gamma,
            tuple(window.quality.tolist()),
            found.engagement,
            found.theta_alpha,
            found.asymmetry,
            float(window.quality[heads].mean()),
            self._extra(block, window, powers, found, peak_hz),
            tuple(self._reasons(window, powers, found, peak_hz)),
        )

    def _extra(
        self, block: Block, window: Window, powers: Floats, found: indices.Indices, peak_hz: float
    ) -> tuple[Feature, ...]:
        ages_s = tuple((block.end_ns - ns) / SECOND_NS for segment in self._window for ns in segment.blinks_ns)
        shares = zip(BANDS, relative(powers), strict=True)
        return (
            *(Feature(f"relative_{band}", "1", tuple(share)) for band, share in shares),
            Feature("alpha_peak", "Hz", (peak_hz,)),
            Feature("theta_alpha_ratio_all", "1", (found.theta_alpha_all,)),
            *(Feature(f"alpha_asymmetry_{right}_{left}", "1", (ln,)) for left, right, ln in found.asymmetries),
            Feature("blink_count", "1", (float(len(ages_s)) if self._montage.has_forehead() else np.nan,)),
            Feature("blink_age", "s", ages_s),
            Feature("pop_count", "1", tuple(window.pops.astype(float))),
            Feature("muscle_segments", "1", tuple(window.muscle.astype(float))),
            Feature("excluded", "1", tuple(window.excluded)),
            Feature("mains_rms", self._unit or "1", tuple(window.hum)),
        )

    def _reasons(self, window: Window, powers: Floats, found: indices.Indices, peak_hz: float) -> list[str]:
        reasons = (
            self._rate.reasons() + self._folded() + self._bad(window) + self._left_out(window) + self._lines(window)
        )
        if self._config.reference == "linked" and window.bad[self._montage.linked()].any():
            reasons.append("reference 'linked' needs both ears, and one of them gives no signal")
        if self._config.reference == "average" and (~window.bad & self._montage.scalp).sum() < FEWEST_LEFT:
            reasons.append(f"reference 'average' needs {FEWEST_LEFT} electrodes with a signal")
        if self._unit != "uV":
            reasons.append(f"uncalibrated: the unit is {self._unit or 'unknown'}, band powers need uV; ratios are told")
        short = [name for name, power in zip(BANDS, powers, strict=True) if np.isnan(power).all()]
        if short and not window.bad.all():
            reasons.append(f"{', '.join(f'{name}_uv2' for name in short)}: above what the sampling rate shows")
        if np.isnan(peak_hz) and not window.bad.all():
            reasons.append("alpha_peak: none stands out")
        if not self._montage.has_forehead():
            reasons.append("blink_count: no electrode at the forehead; blinks may be in delta")
        return reasons + list(found.reasons)

    def _folded(self) -> list[str]:
        """A reason where mains appear among the bands, as sampling folds them."""
        edges_hz = self._config.band_edges_hz
        shown = [f"{hz:.3g} Hz" for hz in folds_hz(self._rate.hz) if edges_hz[0] <= hz < edges_hz[-1]]
        return [f"mains would appear at {' and '.join(shown)}: what is left of them is in the bands"] if shown else []

    def _bad(self, window: Window) -> list[str]:
        """A reason per cause that names the bad channels."""
        causes: dict[str, list[str]] = {}
        for name, bad, cause in zip(self._montage.names, window.bad, window.cause, strict=True):
            if bad:
                causes.setdefault(cause, []).append(name)
        return [f"bad channels ({cause}): {_listed(names)}" for cause, names in causes.items()]

    def _left_out(self, window: Window) -> list[str]:
        """A reason per artefact that names the channels of which parts are left out."""
        good = ~window.bad
        shown = {
            what: [self._montage.names[column] for column in np.flatnonzero(where & good)]
            for what, where in window.left_out.items()
        }
        return [f"parts left out ({what}): {_listed(names)}" for what, names in shown.items() if names]

    def _lines(self, window: Window) -> list[str]:
        """A reason per frequency at which channels show what is narrower than a rhythm of the brain."""
        at_hz = np.unique(window.line_hz[np.isfinite(window.line_hz)])
        shown = [(hz, [self._montage.names[column] for column in np.flatnonzero(window.line_hz == hz)]) for hz in at_hz]
        told = "a line, as of steps, a pump or a screen, is in the bands"
        return [f"{told}, at {hz:.3g} Hz: {_listed(names)}" for hz, names in shown]

    def _nothing(self, block: Block, window_s: float, quality: float, reason: str) -> EegUpdate:
        nan = np.nan
        names, stamps = self._montage.names, (block.device_ns, block.received_ns, window_s)
        none = (nan,) * len(names)
        each = (quality,) * len(names)
        return EegUpdate(*stamps, names, none, none, none, none, none, each, nan, nan, nan, quality, (), (reason,))


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
