"""The state of one stream of gaze: what has arrived, what is settled, what lies in the window."""

from collections import deque

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks
from sense4hri.chunk import TimedChunk
from sense4hri.forward import Forward
from sense4hri.rate import UsualStep
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_eye_tracking.arrival import ABSENT, FROZEN_S, Arrival, Arrived
from interpreter_eye_tracking.config import Config
from interpreter_eye_tracking.features import (
    REACH_S,
    SIGMAS,
    Kind,
    cell_of,
    deg_per_unit,
    entropy_bits,
    noise_speed,
    quality,
    share,
)
from interpreter_eye_tracking.settling import Settled, Settling
from interpreter_eye_tracking.update import EyeUpdate, nothing
from interpreter_eye_tracking.window import Tally, Told, Window, mean, spread, sums_of, told

FS_HZ = (25.0, 2000.0)
BRIDGED_S = 0.25  # a longer hole between samples restarts what is pending
NOISE_S = 10.0  # of signal from which the noise is estimated
NEEDS_S = 10.0  # of signal before a rate is told
LEAST_SPREADS_PER_S = 2.0  # no saccade is slower than this many spreads of gaze per s, where degrees are not known
NOISY, NOISY_DEG = 0.6, 1.0  # noise that is this share of the spread of gaze, and in deg so large, is all there is
WORST_DEG_PER_S, WORST_SPREADS_PER_S = 25.0, 3.0  # velocity noise that halves the quality
WORST_DEG, WORST_SPREADS = 0.7, 0.25  # noise of single samples that does
DRIFT_DEG_PER_S, DRIFT_SPREADS_PER_S = 1.0, 0.2  # drift at rest that does
MOST_BLINKS_PER_MIN, FLICKERS = 100.0, 0.5  # more are a tracker that loses the eyes; by which the quality is multiplied

COUNTED = (("missing_samples", "missing"), ("irregular_intervals", "irregular"), ("backward_stamps", "backward"))

Floats = NDArray[np.float64]


class EyeStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no tracker has, or a channel that is missing."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz = info.sampling_frequency_hz
        if fs_hz and not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(
                f"sampling_frequency_hz is {fs_hz:g}, must be 0 or {FS_HZ[0]:g} to {FS_HZ[1]:g} for eye tracking"
            )
        self._config, self._unit, self._areas = config, info.unit or "unknown", config.areas()
        self._declared_s = 1 / fs_hz if fs_hz else np.nan
        self._deg, self._cell = deg_per_unit(info), cell_of(info)
        self._arrival = Arrival(info, config.least_confidence)
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S)
        self._forward = Forward(BRIDGED_S)
        self._begin_segment()

    def push(self, timed: TimedChunk) -> list[EyeUpdate]:
        """Take the next samples; return the updates that became due."""
        forward = self._forward.take(timed)
        if forward is None:
            return []
        return [update for block in self._blocks.take(forward) for update in self._interpret(block)]

    def _begin_segment(self) -> None:
        self._window = Window(self._config.window_s)
        self._noises: deque[float] = deque(maxlen=max(1, round(NOISE_S / self._config.update_interval_s)))
        self._period_s, self._step = self._declared_s, UsualStep()
        self._here = np.full(2, np.nan)  # newest gaze
        self._newest_ns: int | None = None  # the sample that the next one follows; None after a hole
        self._arrival.restart()
        self._begin_run()

    def _begin_run(self) -> None:
        self._settling: Settling | None = None
        self._arrival.interrupted()

    def _interpret(self, block: Block) -> list[EyeUpdate]:
        if block.begins:
            self._begin_segment()
        fresh = self._take(block) if len(block.times_ns) else self._rest()
        if block.hole is None:
            return [self._update(block, fresh)]
        self._begin_run()
        self._newest_ns = None
        return [self._update(block, fresh)] if any(fresh) else []

    def _take(self, block: Block) -> Told:
        """Take a block's samples; return the events that are certain now."""
        if np.isnan(self._declared_s):
            if self._step.take(block.times_ns):
                self._begin_run()
            self._period_s = self._step.seconds
        arrived = self._arrival.take(block.samples, block.times_ns, self._period_s)
        if self._settling is None:
            self._settling = Settling(max(1, round(REACH_S / self._period_s)))
        if arrived.since_ns is not None:
            self._settling.void(arrived.since_ns)
        self._noises.append(noise_speed(self._settling.extend(arrived.times_ns, arrived.gaze, arrived.holes)))
        settled = self._settling.settle(self._threshold(arrived.gaze), whole=block.hole is not None)
        seen = arrived.gaze[np.isfinite(arrived.gaze[:, 0])]
        self._here = seen[-1] if len(seen) else np.full(2, np.nan)
        self._window.add(self._tally(block, arrived, settled))
        return self._window.file(told(settled.closed, self._config.least_fixation_s, self._config.longest_blink_s))

    def _rest(self) -> Told:
        """Return the events that were not certain at the update that a hole follows at once."""
        closed = self._settling.end().closed if self._settling is not None else []
        return self._window.file(told(closed, self._config.least_fixation_s, self._config.longest_blink_s))

    @property
    def _noise(self) -> float:
        """Velocity noise over the last NOISE_S, gaze units per s; NaN where nothing is known of it."""
        known = [noise for noise in self._noises if np.isfinite(noise)]
        return float(np.median(known)) if known else np.nan

    def _threshold(self, newest: Floats) -> float:
        """Gaze units per s that a saccade exceeds: above the noise, and above what any saccade has."""
        noise = self._noise if np.isfinite(self._noise) else np.inf
        if np.isfinite(self._deg):
            return max(SIGMAS * noise, self._config.least_velocity_deg_per_s / self._deg)
        around = spread(self._window.recent_gaze(NOISE_S) + sums_of(newest))
        return max(SIGMAS * noise, LEAST_SPREADS_PER_S * around)

    def _tally(self, block: Block, arrived: Arrived, settled: Settled) -> Tally:
        seconds = np.diff(settled.times_ns, append=settled.times_ns[-1:]) / SECOND_NS
        if len(seconds):
            seconds[-1] = self._period_s
        seconds = np.minimum(seconds, ABSENT * self._period_s)
        areas_s = np.array([seconds[area.holds(settled.gaze)].sum() for area in self._areas])
        rest = settled.velocity[(settled.kind == Kind.REST) & np.isfinite(settled.velocity[:, 0])]
        since_ns = int(block.times_ns[0]) if self._newest_ns is None else self._newest_ns
        self._newest_ns = block.end_ns
        spans = block.end_ns, block.end_ns - since_ns
        counts = arrived.samples, arrived.valid, arrived.missing, arrived.irregular, self._forward.late()
        drift = np.array([len(rest), *rest.sum(axis=0)])
        return Tally(*spans, *counts, arrived.stuck, sums_of(settled.gaze), drift, areas_s)

    def _update(self, block: Block, fresh: Told) -> EyeUpdate:
        window_s = block.window_s(self._config.window_s)
        window, deg = self._window, self._deg
        problem = self._problem()
        if problem:
            stamps = block.device_ns, block.received_ns
            return nothing(*stamps, window_s, fresh, deg, self._extra(fresh, window_s), problem)
        flickers = self._flickers(window_s)
        if flickers:
            fresh = fresh._replace(blinks=[])
        durations = [fixation.duration_ms for fixation in window.fixations]
        samples, valid = window.total("samples"), window.total("valid")
        return EyeUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=window_s,
            fixation_count=len(durations),
            fixation_duration_ms=mean(durations),
            fixation_timestamps=tuple(each.begin_ns for each in fresh.fixations),
            fixation_durations_ms=tuple(each.duration_ms for each in fresh.fixations),
            saccade_count=len(window.saccades),
            saccade_amplitude_deg=deg * mean([each.amplitude for each in window.saccades]),
            saccade_timestamps=tuple(each.begin_ns for each in fresh.saccades),
            saccade_durations_ms=tuple(each.duration_ms for each in fresh.saccades),
            saccade_amplitudes_deg=tuple(deg * each.amplitude for each in fresh.saccades),
            gaze_x=float(self._here[0]),
            gaze_y=float(self._here[1]),
            gaze_dispersion_deg=deg * spread(window.total("gaze")),
            gaze_entropy_bits=self._entropy_bits(),
            blink_count=-1 if flickers else len(window.blinks),
            blink_rate_per_min=np.nan if flickers else self._rate(len(window.blinks), window_s),
            blink_timestamps=tuple(each.begin_ns for each in fresh.blinks),
            blink_durations_ms=tuple(each.duration_ms for each in fresh.blinks),
            valid_ratio=float(valid / samples),
            signal_quality=self._quality(float((valid - window.total("stuck").sum() / 2) / samples), flickers),
            extra=self._extra(fresh, window_s),
            reasons=tuple(self._reasons(window_s)),
        )

    def _entropy_bits(self) -> float:
        """Of the fixations in the window and the one that has not ended."""
        rests = [(each.x, each.y, each.duration_ms) for each in self._window.fixations]
        now = self._settling.resting if self._settling is not None else None
        if now is not None:
            rests.append((float(now.centre[0]), float(now.centre[1]), 1000 * now.seconds))
        table = np.array(rests).reshape(-1, 3)
        return entropy_bits(table[:, :2], table[:, 2], self._cell)

    def _flickers(self, window_s: float) -> bool:
        """Whether gaze is lost more often than any lid closes: what it cuts is no fixation, and hides saccades."""
        return self._rate(len(self._window.blinks), window_s) > MOST_BLINKS_PER_MIN

    def _quality(self, valid: float, flickers: bool) -> float:
        n, x, y = self._window.total("rest")
        long = n * self._period_s >= NEEDS_S  # before that it is the eye's own
        drift, around = float(np.hypot(x, y) / n) if long else 0.0, spread(self._window.total("gaze"))
        calibrated = np.isfinite(self._deg)
        noise_at = WORST_DEG_PER_S / self._deg if calibrated else WORST_SPREADS_PER_S * around
        scatter_at = WORST_DEG / self._deg if calibrated else WORST_SPREADS * around
        drift_at = DRIFT_DEG_PER_S / self._deg if calibrated else DRIFT_SPREADS_PER_S * around
        samples, missing = self._window.total("samples"), self._window.total("missing")
        arrived = float(samples / (samples + missing))
        noise = max(share(self._noise, noise_at), share(self._precision(), scatter_at))
        return quality(valid, arrived, noise, share(drift, drift_at)) * (FLICKERS if flickers else 1.0)

    def _precision(self) -> float:
        """Standard deviation per axis of single samples, from that of velocity, were it white; gaze units."""
        reach = max(1, round(REACH_S / self._period_s))
        return float(self._noise * (reach + 1) * self._period_s * np.sqrt(reach / 2))

    def _problem(self) -> str:
        """Why nothing can be said of the window; empty where something can."""
        if not FS_HZ[0] <= 1 / self._period_s <= FS_HZ[1]:
            return f"{1 / self._period_s:.3g} samples per s came, {FS_HZ[0]:g} to {FS_HZ[1]:g} are needed"
        if self._arrival.frozen:
            return f"gaze is frozen: the same to the last digit for {FROZEN_S:g} s"
        if not self._window.total("valid") or np.isnan(self._noise):
            return "no gaze in the window: the tracker has lost the eyes"
        around, precision = spread(self._window.total("gaze")), self._precision()
        large = not precision * self._deg < NOISY_DEG
        if large and around > 0 and precision > NOISY * around / np.sqrt(2):
            return "gaze is noise: single samples scatter as far as gaze does over the window"
        return ""

    def _extra(self, fresh: Told, window_s: float) -> tuple[Feature, ...]:
        unit, per_s, window = self._unit, f"{self._unit}/s", self._window
        areas_s = window.total("areas_s")
        return (
            Feature("fixation_x", unit, tuple(each.x for each in fresh.fixations)),
            Feature("fixation_y", unit, tuple(each.y for each in fresh.fixations)),
            Feature("saccade_amplitudes", unit, tuple(each.amplitude for each in fresh.saccades)),
            Feature("saccade_peak_velocities", per_s, tuple(each.peak for each in fresh.saccades)),
            Feature("saccade_rate_per_min", "1/min", (self._rate(len(window.saccades), window_s),)),
            Feature("fixation_rate_per_min", "1/min", (self._rate(len(window.fixations), window_s),)),
            Feature("saccade_threshold", per_s, (self._threshold(np.empty((0, 2))),)),
            Feature("precision", unit, (self._precision(),)),
            Feature("entropy_cell", unit, (self._cell,)),
            *(Feature(name, "1", (float(window.total(of)),)) for name, of in COUNTED),
            *(Feature(f"dwell_{a.name}", "s", (float(s),)) for a, s in zip(self._areas, areas_s, strict=True)),
        )

    def _seen_s(self, window_s: float) -> float:
        """How much of the window is no hole."""
        return min(window_s, float(self._window.total("seen_ns")) / SECOND_NS)

    def _rate(self, count: int, window_s: float) -> float:
        """How often per minute without a hole; NaN for too little of it."""
        seen_s = self._seen_s(window_s)
        return 60 * count / seen_s if seen_s >= NEEDS_S else np.nan

    def _reasons(self, window_s: float) -> list[str]:
        reasons = []
        if np.isnan(self._here).any():
            reasons.append("no gaze at present: gaze_x, gaze_y")
        if not self._window.fixations:
            reasons.append("no fixation has ended in the window: fixation_duration_ms")
        if not self._window.saccades:
            reasons.append("no saccade in the window: saccade_amplitude_deg")
        for axis, other, count in zip("xy", "yx", self._window.total("stuck").tolist(), strict=True):
            if count:
                still = f"gaze_{axis} stayed the same to the last digit for {FROZEN_S:g} s and more"
                reasons.append(f"{still} while gaze_{other} moved: frozen, or not measured")
        if self._flickers(window_s):
            often = f"gaze is lost {self._rate(len(self._window.blinks), window_s):.0f} times a minute, as by no lid"
            reasons.append(f"{often}: blinks; fixations are cut and saccades missed")
        if self._seen_s(window_s) < NEEDS_S:
            reasons.append(f"blink_rate_per_min needs {NEEDS_S:g} s")
        if np.isnan(self._deg):
            reasons.append(f"uncalibrated: the unit is {self._unit} and px_per_deg is not known; deg are NaN")
        if SIGMAS * self._noise * self._deg > self._config.least_velocity_deg_per_s:
            slowest = SIGMAS * self._noise * self._deg
            reasons.append(f"noise: saccades with a peak below {slowest:.0f} deg/s are not told from it")
        return reasons
