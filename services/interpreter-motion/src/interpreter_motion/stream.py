"""The state of one accelerometer: samples in, one update per grid point out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.living import frozen
from sense4hri.motion import UNIT, Moved
from sense4hri.slow import drawn_through, runs
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_motion import features
from interpreter_motion.config import Config

FS_HZ = (10.0, 4000.0)
BRIDGED_S = 0.25  # a shorter hole hides no step: the signal is drawn through it
STEP_HZ = 40.0  # the rate at which steps are looked for, or less
SETTLED_S = 3.0  # a step is counted when it is so old: what follows it has been seen
LOOK_S = 12.0  # in which steps are looked for
NEEDS_S = 5.0  # of signal before steps and posture are told
LEARNED_IN_LOOK, LEARNED_BY = 12, 20  # steps in LOOK_S, and altogether, by which upright is learned
KNOWN = 0.5  # share of the window that has to be there
GRAVITIES = ("g", "mg")  # units whose zero is zero
STILL_M_S2 = 0.5  # of motion up to which all that is measured is gravity

Floats = NDArray[np.float64]


class MotionUpdate(NamedTuple):
    """What the features message says; NaN where it cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    intensity_m_per_s2: float
    step_rate_per_min: float
    posture: str
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class MotionStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no accelerometer has."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, names = info.sampling_frequency_hz, info.channel_names
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for motion")
        missing = [axis for axis in "xyz" if axis not in names]
        if missing:
            raise ValueError(f"channel_names are {', '.join(names)}, motion needs x, y and z")
        self._config, self._info, self._fs_hz = config, info, fs_hz
        self._axes, self._calibrated = [names.index(axis) for axis in "xyz"], info.unit == UNIT
        place = str(info.parameters.get("body_location", "")).lower()
        self._on_trunk = any(part.strip() in place for part in config.trunk.lower().split(",") if part.strip())
        self._coarse = max(1, round(fs_hz / STEP_HZ))
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S, filled=True)
        self._begin_segment()

    def push(self, timed: TimedChunk) -> list[MotionUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _begin_segment(self) -> None:
        self._raw, self._times_ns = np.empty((0, 3)), np.empty(0, np.int64)
        self._samples = self._raw  # without those that are held
        self._upright, self._learned_ns = self._axis(), 0
        self._steps_ns = np.empty(0, np.int64)  # of the window
        self._total, self._signed = 0, False  # signed: a number was negative
        self._chain_ns = self._counted_ns = -(2**62)  # the samples before a hole; the last step that was counted

    def _axis(self) -> Floats:
        """The direction of gravity while upright, as the parameter says; NaN where it is to be learned."""
        axis = self._config.upright_axis
        if not axis:
            return np.full(3, np.nan)
        return np.asarray((-1.0 if axis[0] == "-" else 1.0) * np.array([axis[-1] == name for name in "xyz"], float))

    def _interpret(self, block: Block) -> list[MotionUpdate]:
        if block.begins:
            self._begin_segment()
        kept_ns = block.end_ns - round(max(LOOK_S, self._config.window_s) * SECOND_NS)
        kept = slice(int(np.searchsorted(self._times_ns, kept_ns, side="right")), None)
        self._raw = np.concatenate([self._raw[kept], block.samples[:, self._axes]])
        self._times_ns = np.concatenate([self._times_ns[kept], block.times_ns])
        held = frozen(self._raw, round(BRIDGED_S * self._fs_hz))
        self._samples = np.where(held[:, None], np.nan, self._raw)
        self._signed = self._signed or bool((block.samples[:, self._axes] < 0).any())
        if block.hole is None:
            return [self._update(block)]
        self._count(block.end_ns, settled_s=0.0)
        self._chain_ns = block.end_ns
        if block.hole is not Hole.CHAIN:
            self._begin_segment()
        return []

    def _update(self, block: Block) -> MotionUpdate:
        window_s = block.window_s(self._config.window_s)
        start_ns = block.end_ns - round(self._config.window_s * SECOND_NS)
        here = slice(int(np.searchsorted(self._times_ns, start_ns, side="right")), None)
        samples = self._samples[here]
        known = samples[np.isfinite(samples).all(axis=1)]
        filled = min(1.0, len(known) / max(1.0, self._fs_hz * window_s))
        problem = self._problem(known, self._raw[here], filled)
        if problem:
            nothing = self._extra(np.nan, np.nan)
            return MotionUpdate(
                block.device_ns, block.received_ns, window_s, np.nan, np.nan, "unknown", 0.0, nothing, (problem,)
            )
        seen = self._count(block.end_ns, SETTLED_S)
        self._steps_ns = self._steps_ns[self._steps_ns > start_ns]
        enough = window_s >= NEEDS_S
        step_rate = self._rate(seen) if enough else np.nan
        sways = step_rate == 0 and self._sways(known)
        step_rate = np.nan if sways else step_rate
        gravity = self._gravity()
        tilted_deg = features.tilt_deg(gravity, self._upright) if self._on_trunk and enough else np.nan
        moved = Moved(known, self._fs_hz)
        return MotionUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=window_s,
            intensity_m_per_s2=moved.rms_m_s2 if self._calibrated else np.nan,
            step_rate_per_min=step_rate,
            posture=features.posture(tilted_deg),
            signal_quality=self._quality(known, filled, moved.rms_m_s2),
            extra=self._extra(float(self._total), tilted_deg),
            reasons=tuple(self._reasons(enough, bool(np.isnan(step_rate)), sways)),
        )

    def _scale(self, known: Floats) -> float:
        """What makes the samples m/s^2; where the unit is another, by gravity."""
        size = float(np.median(np.linalg.norm(known, axis=1))) if len(known) else 0.0
        return 1.0 if self._calibrated or not size > 0 else features.GRAVITY / size

    def _count(self, end_ns: int, settled_s: float) -> bool:
        """Count the steps that are certain now, and learn what is upright from a wearer who walks.

        Return whether there is enough signal without a hole to see steps in it.
        """
        chain = self._times_ns > max(self._chain_ns, end_ns - round(LOOK_S * SECOND_NS))
        samples, times_ns = self._samples[chain], self._times_ns[chain]
        samples = np.column_stack([drawn_through(column, times_ns, BRIDGED_S) for column in samples.T])
        looks = [self._steps_in(samples[part], times_ns[part]) for part in runs(samples.sum(axis=1))]
        found = np.concatenate([np.empty(0, np.int64), *(steps_ns for steps_ns in looks if steps_ns is not None)])
        apart_ns = round(features.PERIOD_S[0] * SECOND_NS)
        fresh = found[(found > self._counted_ns + apart_ns) & (found <= end_ns - settled_s * SECOND_NS)]
        if len(fresh):
            self._total, self._counted_ns = self._total + len(fresh), int(fresh[-1])
            self._steps_ns = np.append(self._steps_ns, fresh)
        walks = len(found) >= LEARNED_IN_LOOK and self._total >= LEARNED_BY
        if walks and not self._config.upright_axis:
            walked = samples[(times_ns >= found[0]) & (times_ns <= found[-1])]
            self._upright, self._learned_ns = np.nanmean(walked, axis=0), int(found[-1])
        return bool(looks) and looks[-1] is not None

    def _steps_in(self, samples: Floats, times_ns: NDArray[np.int64]) -> NDArray[np.int64] | None:
        """Return the times of the steps in samples without a hole; None where they are too few to see any."""
        n = len(samples) // self._coarse * self._coarse
        if n < NEEDS_S * self._fs_hz:
            return None
        first = len(samples) - n
        coarse = (samples[first:] * self._scale(samples)).reshape(-1, self._coarse, 3).mean(axis=1)
        coarse_ns = times_ns[first + self._coarse // 2 :: self._coarse]
        magnitude = np.linalg.norm(coarse, axis=1)
        return coarse_ns[features.steps(magnitude, self._fs_hz / self._coarse, self._config.least_step)]

    def _rate(self, seen: bool) -> float:
        """Steps per minute while the wearer walked in the window, by the certain steps; 0 where nobody walked.

        seen: steps could be seen now; NaN where not, and there are none from before.
        """
        intervals_s = np.diff(self._steps_ns) / SECOND_NS
        holes_before = np.searchsorted(self._holes_ns(), self._steps_ns)
        walked = intervals_s[(intervals_s <= features.PERIOD_S[1]) & (np.diff(holes_before) == 0)]
        if not len(walked):
            return 0.0 if seen else np.nan
        return float(60 / walked.mean())

    def _sways(self, known: Floats) -> bool:
        """Whether the window shows a rhythm that is too slow to tell whether it is one of steps."""
        n = len(known) // self._coarse * self._coarse
        coarse = (known[len(known) - n :] * self._scale(known)).reshape(-1, self._coarse, 3).mean(axis=1)
        return features.sways(np.linalg.norm(coarse, axis=1), self._fs_hz / self._coarse, self._config.least_step)

    def _holes_ns(self) -> NDArray[np.int64]:
        """The last samples before holes that may hide a step."""
        known_ns = self._times_ns[np.isfinite(self._samples).all(axis=1)]
        return known_ns[:-1][np.diff(known_ns) > BRIDGED_S * SECOND_NS]

    def _gravity(self) -> Floats:
        """The mean of the last second, in which the wearer turns little."""
        newest = self._samples[-max(1, round(self._fs_hz)) :]
        newest = newest[np.isfinite(newest).all(axis=1)]
        return np.asarray(newest.mean(axis=0)) if len(newest) else np.full(3, np.nan)

    def _quality(self, known: Floats, filled: float, motion: float) -> float:
        scale = self._scale(known)
        off = abs(float(np.linalg.norm(known.mean(axis=0))) * scale - features.GRAVITY)
        off -= min(max(0.0, motion * scale - STILL_M_S2), features.GRAVITY / 2, off)
        return features.quality(features.noise_rms(known * scale), off, filled, self._clipped(known))

    def _clipped(self, known: Floats) -> float:
        low, high = self._info.range_min, self._info.range_max
        return float(np.mean(((known <= low) | (known >= high)).any(axis=1))) if low < high else 0.0

    def _problem(self, known: Floats, raw: Floats, filled: float) -> str:
        """Why nothing can be said of the window; empty where something can."""
        if filled < KNOWN:
            numbers = np.isfinite(raw).all(axis=1).sum() > 2 * len(known)
            why = "is flat: its values do not change" if numbers else "holds no number"
            return f"accelerometer {why} for most of the window"
        if not np.ptp(known, axis=0).any():
            return "accelerometer is flat: its values do not change"
        still = np.ptp(known, axis=0) == 0
        if still.any() and np.linalg.norm(known.std(axis=0)) * self._scale(known) > STILL_M_S2:
            axes = ", ".join(np.array(list("xyz"))[still])
            return f"accelerometer: {axes} does not change while the others move"
        if not self._calibrated and self._has_offset(known):
            return f"uncalibrated: {self._info.unit or 'unknown'} without negative numbers, its zero is not known"
        if self._clipped(known) > KNOWN:
            return "accelerometer is saturated: at an end of its range"
        return ""

    def _has_offset(self, known: Floats) -> bool:
        """Whether zero is in the midst of the numbers: by the range that is declared, or without one by themselves."""
        low, high = self._info.range_min, self._info.range_max
        if low < high:
            return low >= 0
        return not self._signed and self._info.unit not in GRAVITIES and features.has_offset(known)

    def _extra(self, total: float, tilted_deg: float) -> tuple[Feature, ...]:
        return Feature("steps_total", "1", (total,)), Feature("tilt", "deg", (tilted_deg,))

    def _reasons(self, enough: bool, uncounted: bool, sways: bool) -> list[str]:
        reasons = []
        if not enough:
            reasons.append(f"step_rate_per_min, posture need {NEEDS_S:g} s")
        elif sways:
            reasons.append("step_rate_per_min: a rhythm slower than 46 a minute, of slow steps or a sway")
        elif uncounted:
            reasons.append(f"step_rate_per_min needs {NEEDS_S:g} s without a hole; steps_total lacks steps of now")
        if not self._on_trunk:
            place = str(self._info.parameters.get("body_location", "")) or "unknown"
            reasons.append(f"posture: body_location is {place}, posture is told of a sensor at the trunk")
        elif np.isnan(self._upright).any():
            reasons.append(f"posture: upright is learned while the wearer walks {LEARNED_BY} steps, or by upright_axis")
        elif not self._config.upright_axis:
            ago_s = (self._times_ns[-1] - self._learned_ns) / SECOND_NS
            reasons.append(f"posture: upright was learned {ago_s:.0f} s ago, from a rhythm taken for a walk")
        if not self._calibrated:
            reasons.append(f"uncalibrated: the unit is {self._info.unit or 'unknown'}, intensity_m_per_s2 needs {UNIT}")
        return reasons
