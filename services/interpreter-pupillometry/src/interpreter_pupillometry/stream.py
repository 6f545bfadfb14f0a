"""The state of one stream of pupils: cleaned samples, the baseline, what is kept for the index of activity."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.forward import Forward
from sense4hri.rate import UsualStep
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature, Marker
from sense4hri.stream_info import StreamInfo

from interpreter_pupillometry import features
from interpreter_pupillometry.baseline import Baseline
from interpreter_pupillometry.cleaning import DELAY_S, Cleaning, Settled
from interpreter_pupillometry.config import Config

FS_HZ = (25.0, 2000.0)
BRIDGED_S = 0.25  # a longer hole between samples restarts what is pending
FROZEN_S = 5.0  # no pupil has the same size for so long to the last digit
NEEDS_S = 10.0  # of signal before there is a baseline or a trend
COUNT_S = 60.0  # over which blinks are counted and the trend is taken
NOISY, NOISY_SHARE = 0.7, 0.05  # noise that is this share of all change, and of the size, is all there is
DRAWN_MOST = 0.3  # share of lost samples beyond which there is no index of activity
ACTIVITY_HZ = 50.0  # least rate of the index of activity

Floats = NDArray[np.float64]


class PupilUpdate(NamedTuple):
    """What the Pupillometry message says; NaN where something cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    unit: str
    diameter_left: float
    diameter_right: float
    diameter: float
    baseline: float
    change: float
    change_percent: float
    dilation_speed_per_s: float
    missing_ratio: float
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class _Window(NamedTuple):
    """The settled samples of the window. overlapping: sizes, also of MOVING_S before it; missing: share of no pupil."""

    seconds: float
    times_ns: NDArray[np.int64]
    pupils: features.Pupils
    overlapping: Floats
    missing: float


class PupilStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no tracker has, or without an eye."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, names = info.sampling_frequency_hz, info.channel_names
        if fs_hz and not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(
                f"sampling_frequency_hz is {fs_hz:g}, must be 0 or {FS_HZ[0]:g} to {FS_HZ[1]:g} for pupillometry"
            )
        if not {"diameter_left", "diameter_right"} & set(names):
            raise ValueError(f"channels are {', '.join(names) or 'unknown'}, diameter_left or diameter_right is needed")
        self._config, self._fs_hz, self._step = config, fs_hz, None if fs_hz else UsualStep()
        self._unit = info.unit or "a.u."
        self._columns = [names.index(name) if name in names else None for name in ("diameter_left", "diameter_right")]
        self._confidence = names.index("confidence") if "confidence" in names else None
        self._forward, self._blocks = Forward(BRIDGED_S), Blocks(config.update_interval_s, bridged_s=BRIDGED_S)
        self._newest_ns: int | None = None
        self._baseline = Baseline(config.baseline_s)
        self._cleaning = Cleaning(self._unit == "mm", config.longest_gap_s, config.window_s)
        self._begin_segment()

    def push(self, timed: TimedChunk) -> list[PupilUpdate]:
        """Take the next samples; return the updates that became due."""
        forward = self._forward.take(timed)
        if forward is None:
            return []
        blocks = self._blocks.take(forward)
        self._newest_ns = int(forward.times_ns[-1])
        return [update for block in blocks for update in self._interpret(block)]

    def marker(self, marker: Marker) -> None:
        """Take a marker of the study: `baseline_start` or `baseline_end`."""
        if marker.name == "baseline_start":
            self._baseline.start(self._newest_ns, marker.received_ns)
        elif marker.name == "baseline_end":
            self._baseline.end(self._newest_ns, marker.received_ns, self._fs_hz)

    def _begin_segment(self) -> None:
        self._begin_activity()
        self._means: deque[tuple[int, float]] = deque()  # of updates
        self._gaps: deque[tuple[int, float]] = deque()  # end, and how long, of those drawn through
        self._moved_ns = np.zeros(2, np.int64)  # when the size of each eye was not the same for the last time
        self._last = np.full(2, np.nan)

    def _begin_activity(self) -> None:
        """Forget the samples of the index of activity: those that follow come at another rate."""
        self._times_ns, self._sizes, self._valid = np.empty(0, np.int64), np.empty(0), np.empty(0, bool)

    def _interpret(self, block: Block) -> list[PupilUpdate]:
        if block.begins:
            self._begin_segment()
        settled = self._take(block) if len(block.times_ns) else self._cleaning.end()
        self._keep(settled, block.end_ns)
        gaps_ns = settled.gaps_ns
        if block.hole is None:
            return [self._update(block, gaps_ns)]
        update = [self._update(block, gaps_ns)] if gaps_ns else []
        self._cleaning.restart()
        if block.hole is Hole.CLOCK:
            self._baseline.restart_clock()
        return update

    def _take(self, block: Block) -> Settled:
        """Take a block's samples; return those that are settled now."""
        eyes = self._eyes(block.samples)
        if self._step is not None and len(block.times_ns) > 1:
            if self._step.take(block.times_ns):
                self._begin_activity()
            self._fs_hz = 1 / self._step.seconds
        moved = eyes != np.concatenate([self._last[None], eyes[:-1]])
        self._moved_ns = np.where(moved, block.times_ns[:, None], self._moved_ns).max(axis=0)
        self._last = eyes[-1].copy()
        for eye in np.flatnonzero(self._stuck(block.end_ns)).tolist():
            self._cleaning.void(eye, int(self._moved_ns[eye]))
            eyes[block.times_ns >= self._moved_ns[eye], eye] = np.nan
        return self._cleaning.push(block.times_ns, np.where(eyes > 0, eyes, np.nan), whole=block.hole is not None)

    def _eyes(self, samples: Floats) -> Floats:
        """Sizes of the left and the right eye, shape (n, 2): 0 where lost, or doubted by the tracker."""
        columns = [np.zeros(len(samples)) if k is None else samples[:, k] for k in self._columns]
        eyes = np.nan_to_num(np.column_stack(columns), posinf=0.0, neginf=0.0)
        if self._confidence is not None:
            eyes[~(samples[:, self._confidence] >= self._config.least_confidence)] = 0.0
        return eyes

    def _keep(self, settled: Settled, end_ns: int) -> None:
        start_ns = end_ns - round((self._config.activity_s + 1) * SECOND_NS)
        kept = slice(int(np.searchsorted(self._times_ns, start_ns)), None)
        self._times_ns = np.concatenate([self._times_ns[kept], settled.times_ns])
        self._sizes = np.concatenate([self._sizes[kept], settled.sizes])
        self._valid = np.concatenate([self._valid[kept], settled.valid])
        seen = settled.valid & (not self._frozen(end_ns))
        self._baseline.take(settled.times_ns, settled.sizes, seen, end_ns)
        self._gaps.extend((end, (end - begin) / SECOND_NS) for begin, end in settled.gaps_ns)
        while self._gaps and self._gaps[0][0] <= end_ns - round(COUNT_S * SECOND_NS):
            self._gaps.popleft()

    def _still(self, end_ns: int) -> NDArray[np.bool_]:
        """Which eye's size has not changed for FROZEN_S."""
        return np.asarray(end_ns - self._moved_ns >= FROZEN_S * SECOND_NS)

    def _stuck(self, end_ns: int) -> NDArray[np.bool_]:
        """Which eye has a size, and always the same."""
        return np.asarray(self._still(end_ns) & (self._last > 0))

    def _frozen(self, end_ns: int) -> bool:
        return bool(self._still(end_ns).all() and self._stuck(end_ns).any())

    def _update(self, block: Block, gaps_ns: list[tuple[int, int]]) -> PupilUpdate:
        window = self._window(block)
        problem = self._problem(window.pupils.size, block.end_ns)
        if problem:
            return self._nothing(block, window, gaps_ns, problem)
        diameter, baseline = mean(window.pupils.size), self._baseline.value(self._since_s(block))
        self._remember(block.end_ns, diameter)
        noise = features.noise_of(self._cleaning.pupils.size) / diameter
        trend = self._trend_per_min() / diameter
        return PupilUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=window.seconds,
            unit=self._unit,
            diameter_left=mean(window.pupils.left),
            diameter_right=mean(window.pupils.right),
            diameter=diameter,
            baseline=baseline,
            change=diameter - baseline,
            change_percent=100 * (diameter - baseline) / baseline,
            dilation_speed_per_s=features.slope_per_s(window.pupils.size, window.times_ns),
            missing_ratio=window.missing,
            signal_quality=features.quality(1 - window.missing, noise, trend),
            extra=self._extra(block, gaps_ns, features.extremes(window.overlapping, self._fs_hz), baseline),
            reasons=tuple(self._reasons(baseline, window.pupils, self._stuck(block.end_ns))),
        )

    def _window(self, block: Block) -> _Window:
        times_ns, pupils = self._cleaning.times_ns, self._cleaning.pupils
        end_ns = block.end_ns - round(DELAY_S * SECOND_NS)
        start_ns = end_ns - round(self._config.window_s * SECOND_NS)
        here = (times_ns > start_ns) & (times_ns <= end_ns)
        overlapping = (times_ns > start_ns - round(features.MOVING_S * SECOND_NS)) & (times_ns <= end_ns)
        seconds = block.window_s(self._config.window_s)
        seen = features.Pupils(pupils.left[here], pupils.right[here], pupils.size[here], pupils.valid[here])
        missing = self._missing(seen.valid, max(0.0, min(self._since_s(block) - DELAY_S, seconds)))
        return _Window(seconds, times_ns[here], seen, pupils.size[overlapping], missing)

    @staticmethod
    def _since_s(block: Block) -> float:
        return (block.end_ns - block.first_ns) / SECOND_NS

    def _missing(self, valid: NDArray[np.bool_], window_s: float) -> float:
        """Share of the samples of the window that are no pupil, or never came."""
        due = max(len(valid), round(window_s * self._fs_hz))
        return float(1 - valid.sum() / due) if due else np.nan

    def _remember(self, end_ns: int, diameter: float) -> None:
        self._means.append((end_ns, diameter))
        while self._means[0][0] <= end_ns - round(COUNT_S * SECOND_NS):
            self._means.popleft()

    def _trend_per_min(self) -> float:
        times_ns, means = (np.array(column) for column in zip(*self._means, strict=True))
        if times_ns[-1] - times_ns[0] < NEEDS_S * SECOND_NS:
            return np.nan
        return 60 * features.slope_per_s(means, times_ns)

    def _problem(self, sizes: Floats, end_ns: int) -> str:
        """Why nothing can be said of the window; empty where something can."""
        if self._fs_hz and not FS_HZ[0] <= self._fs_hz <= FS_HZ[1]:
            return f"{self._fs_hz:.3g} samples per s came, {FS_HZ[0]:g} to {FS_HZ[1]:g} are needed"
        if self._frozen(end_ns):
            return f"the pupil is frozen: the same size to the last digit for {FROZEN_S:g} s"
        if not np.isfinite(sizes).any():
            return "no pupil in the window: eyes closed, lost by the tracker, or one size held"
        known = self._cleaning.pupils.size[self._cleaning.pupils.valid]
        noise = features.noise_of(known)
        if noise > max(NOISY * float(np.std(known)), NOISY_SHARE * float(np.median(known))):
            return "the pupil is noise: sizes change as much from sample to sample as over seconds"
        return ""

    def _activity_per_s(self, end_ns: int) -> float:
        """The index of pupillary activity over activity_s; NaN with too much lost or too few samples."""
        span_s = self._config.activity_s
        here = self._times_ns > end_ns - round(span_s * SECOND_NS)
        if self._fs_hz < ACTIVITY_HZ or here.sum() < 0.9 * span_s * self._fs_hz:
            return np.nan
        if np.mean(self._valid[here]) < 1 - DRAWN_MOST:
            return np.nan
        sizes, known = self._sizes[here], np.isfinite(self._sizes[here])
        times_ns = self._times_ns[here]
        whole = np.interp(times_ns, times_ns[known], sizes[known])
        return features.lhipa_per_s(whole, span_s)

    def _extra(
        self, block: Block, gaps_ns: list[tuple[int, int]], extremes: tuple[float, float], baseline: float
    ) -> tuple[Feature, ...]:
        begin_s = tuple((block.end_ns - begin) / SECOND_NS for begin, _ in gaps_ns)
        end_s = tuple((block.end_ns - end) / SECOND_NS for _, end in gaps_ns)
        blinks = sum(seconds > features.GAP_S for _, seconds in self._gaps)
        return (
            Feature("interpolated_begin_s", "s", begin_s),
            Feature("interpolated_end_s", "s", end_s),
            Feature("interpolated_gaps", "1", (float(len(self._gaps)),)),
            Feature("blink_gaps", "1", (float(blinks),)),
            Feature("change_least", self._unit, (extremes[0] - baseline,)),
            Feature("change_most", self._unit, (extremes[1] - baseline,)),
            Feature("baseline_by_marker", "1", (float(self._baseline.marked),)),
            Feature("lhipa", "1/s", (self._activity_per_s(block.end_ns) if np.isfinite(extremes[0]) else np.nan,)),
            Feature("backward_stamps", "1", (float(self._forward.late()),)),
        )

    def _reasons(self, baseline: float, pupils: features.Pupils, stuck: NDArray[np.bool_]) -> list[str]:
        reasons = []
        if np.isnan(baseline):
            reasons.append(f"baseline, change need {NEEDS_S:g} s, or markers baseline_start and baseline_end")
        if self._baseline.failed:
            reasons.append(self._baseline.failed)
        for side, sizes, frozen in (("left", pupils.left, stuck[0]), ("right", pupils.right, stuck[1])):
            if frozen:
                reasons.append(f"diameter_{side}: frozen, the same size to the last digit for {FROZEN_S:g} s")
            elif not np.isfinite(sizes).any():
                reasons.append(f"diameter_{side}: no pupil of this eye in the window, or one size held")
        if self._unit != "mm":
            reasons.append(f"uncalibrated: sizes are in {self._unit}, not in mm; change_percent is relative to them")
        return reasons

    def _nothing(self, block: Block, window: _Window, gaps_ns: list[tuple[int, int]], problem: str) -> PupilUpdate:
        nan, stamps = np.nan, (block.device_ns, block.received_ns)
        unknown = nan, nan, nan, nan, nan, nan, nan
        extra = self._extra(block, gaps_ns, (nan, nan), nan)
        return PupilUpdate(*stamps, window.seconds, self._unit, *unknown, window.missing, 0.0, extra, (problem,))


def mean(sizes: Floats) -> float:
    """Return the mean of the numbers among them; NaN without any."""
    known = sizes[np.isfinite(sizes)]
    return float(known.mean()) if len(known) else np.nan
