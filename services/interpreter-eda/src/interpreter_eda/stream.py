"""The state of one EDA stream: the last minute on an even grid, its responses, the tonic line."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole, Presence
from sense4hri.chunk import TimedChunk
from sense4hri.living import frozen
from sense4hri.motion import Motion
from sense4hri.resolution import least_step
from sense4hri.slow import GRID_HZ, Slow, newest_run, smoothed
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_eda import features
from interpreter_eda.config import Config
from interpreter_eda.wander import DOUBT, breathes, wanders

FS_HZ = (2.0, 8000.0)
OHMS = ("ohm", "\u03c9")  # in units of resistance, in small letters
BRIDGED_S = 1.0  # a shorter hole hides nothing of a response
HELD_S, HELD_PERIODS = 0.3, 3.0  # exactly the same for longer, in s and in samples, is no signal
LOOK_S = 30.0  # of the past in which a response is looked for
APART_NS = SECOND_NS // 2  # between two peaks
NEEDS_S = 10.0  # of signal before rates and trends are told
FLAT_AFTER_S = 30.0
AT_RAIL = 0.5  # share of the last LEVEL_S at an end of the range that is called saturated
LEVEL_S = 5.0
ROUNDED = 1e-9  # of the range by which a mean of samples at its end may be off
JUDGED_NS = round((features.MIRROR_S + 2) * SECOND_NS)  # after its peak: whatever is near a response has come by then
MIRRORED = 0.1  # share of the window's responses; more of them that fall as they rise are doubted
AROUND_PEAK = 6  # points after a peak that smoothing has mixed into it

Floats = NDArray[np.float64]


class EdaUpdate(NamedTuple):
    """What the EDA message says; times on the event clock, NaN where something cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    tonic_us: float
    tonic_slope_us_per_min: float
    scr_count: int
    scr_rate_per_min: float
    scr_amplitude_us: float
    scr_rise_time_s: float
    scr_half_recovery_s: float
    phasic_auc_us_s: float
    scr_onset_timestamps: tuple[int, ...]
    scr_peak_timestamps: tuple[int, ...]
    scr_amplitudes_us: tuple[float, ...]
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


@dataclass
class Response:
    """A response that was published; its recovery comes later. amplitude: NaN where its peak is cut off."""

    onset_ns: int
    peak_ns: int
    amplitude: float
    half_recovery_s: float = np.nan
    mirrored: bool = False  # the conductance falls as steeply as it rose

    @property
    def rise_time_s(self) -> float:
        return (self.peak_ns - self.onset_ns) / SECOND_NS if np.isfinite(self.amplitude) else np.nan


class _Window(NamedTuple):
    """The points of the window. told: those of which something was told; moving: not held at the same value either."""

    seconds: float
    raw: Floats
    spread: Floats
    tonic: Floats
    told: NDArray[np.bool_]
    moving: NDArray[np.bool_]

    @property
    def known(self) -> Floats:
        """The points that are numbers."""
        return self.raw[np.isfinite(self.raw)]

    @property
    def trend_per_min(self) -> float:
        return features.trend_per_min(self.tonic)

    @property
    def told_s(self) -> float:
        """For how long something was told; the newest points of a slow sensor are to come."""
        return min(self.seconds, np.count_nonzero(self.told) / GRID_HZ + BRIDGED_S)

    @property
    def filled(self) -> float:
        """Share of the window's points that move."""
        return min(1.0, np.count_nonzero(self.moving) / max(1.0, self.seconds * GRID_HZ - 1))


class EdaStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no EDA has, or a resistance."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, names = info.sampling_frequency_hz, info.channel_names
        if fs_hz and not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be 0 or {FS_HZ[0]:g} to {FS_HZ[1]:g} for EDA")
        if any(word in info.unit.lower() for word in OHMS):
            raise ValueError(
                f"unit is {info.unit}, a resistance: it falls where skin responds; conductance in uS is needed"
            )
        self._config, self._info = config, info
        self._column = names.index("eda") if "eda" in names else 0
        self._scale = 1.0 if info.unit == "uS" else np.nan  # what makes amplitudes of the channel microsiemens
        self._period_s = 1 / fs_hz if fs_hz else 0.0
        self._held_s = max(HELD_S, HELD_PERIODS / fs_hz) if fs_hz else BRIDGED_S
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S, filled=True)
        self._slow, self._motion = Slow(1, BRIDGED_S), Motion()
        self._presence = Presence(round(config.window_s / config.update_interval_s))
        self._restart()

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def push(self, timed: TimedChunk) -> list[EdaUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _restart(self) -> None:
        self._slow.restart()
        self._raw, self._spread, self._tonic = np.empty(0), np.empty(0), np.empty(0)
        self._times_ns, self._withheld = np.empty(0, np.int64), np.empty(0, bool)  # withheld: of these nothing was told
        self._sample, self._steps = np.empty((0, 1)), np.empty(0)  # the newest; least step of each block of the window
        self._presence.restart()
        self._skin_ns = -(2**62)  # the last sample of skin
        self._loose_us = np.nan  # what an electrode that hangs loose shows
        self._responses: list[Response] = []
        self._told_ns = -(2**62)  # the last peak that was published, or withheld
        self._answered_ns = -(2**62)  # the last update that said something

    def _interpret(self, block: Block) -> list[EdaUpdate]:
        if block.begins:
            self._restart()
        self._extend(block)
        if block.hole is None:
            return [self._update(block, whole=False)]
        return self._finish(block, block.hole)

    def _finish(self, block: Block, hole: Hole) -> list[EdaUpdate]:
        """A hole: responses that wait for what follows are told at once, with the last sample before it."""
        update = self._update(block, whole=True)
        if hole is not Hole.CHAIN:
            self._restart()
        return [update] if update.scr_peak_timestamps else []

    def _extend(self, block: Block) -> None:
        samples = self._of_skin(block.samples[:, self._column], block.times_ns)
        samples = samples[:, None]
        blocks = round(self._config.window_s / self._config.update_interval_s)
        self._steps = np.append(self._steps, least_step(np.concatenate([self._sample, samples])))[-blocks:]
        self._presence.add(block.samples[:, [self._column]])
        self._sample = samples[-1:] if len(samples) else self._sample
        points = self._slow.push(samples, block.times_ns)
        raw = points.values[:, 0]
        self._tonic = np.append(self._tonic, self._line(raw))
        self._raw, self._spread = np.append(self._raw, raw), np.append(self._spread, points.spread)
        self._times_ns = np.append(self._times_ns, points.times_ns)
        self._withheld = np.append(self._withheld, np.zeros(len(raw), bool))
        kept = slice(-round((max(self._config.window_s, LOOK_S) + 2) * GRID_HZ), None)
        self._raw, self._spread, self._tonic = self._raw[kept], self._spread[kept], self._tonic[kept]
        self._times_ns, self._withheld = self._times_ns[kept], self._withheld[kept]

    def _of_skin(self, samples: Floats, times_ns: NDArray[np.int64]) -> Floats:
        """The samples, NaN where no skin with electrodes on it has such a conductance."""
        loose = (samples < self._config.least_level_us) | (samples > features.HIGHEST_US)
        if self._scale != 1 or not len(samples):
            return samples
        of_skin_ns = times_ns[np.isfinite(samples) & ~loose]
        self._skin_ns = int(of_skin_ns[-1]) if len(of_skin_ns) else self._skin_ns
        lasts = times_ns[-1] - self._skin_ns > round(BRIDGED_S * SECOND_NS)
        self._loose_us = float(np.median(samples[loose])) if loose[-1] and lasts else np.nan
        return np.where(loose, np.nan, samples)

    def _line(self, raw: Floats) -> Floats:
        """The tonic line under the newest points; after missing ones it begins anew."""
        begins = newest_run(raw)
        line = np.full(len(raw), np.nan)
        before = self._tonic[-1] if begins == 0 and len(self._tonic) else np.nan
        line[begins:] = features.tonic(raw[begins:], before)
        return line

    def _update(self, block: Block, whole: bool) -> EdaUpdate:
        window = self._window(block)
        problem = self._problem(window, block.end_ns)
        if problem:
            return self._withhold(block, window.seconds, problem)
        self._answered_ns = block.end_ns
        ripple = features.ripple(window.known, self._period_s)
        jumped = features.jumps(window.known, self._period_s, self._scale == 1)
        least = self._least_amplitude(ripple)
        fresh = self._found(least, whole)
        self._recover()
        self._forget(block.end_ns - round(window.seconds * SECOND_NS))
        quality = self._quality(window, ripple, jumped)
        quality **= 1 + self._motion.at(block.received_ns, self._config.window_s).strength
        doubt = self._doubt(window.raw[newest_run(window.raw) :]) if self._responses else ""
        enough = window.told_s >= NEEDS_S
        scale, found = self._scale, self._responses
        return EdaUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=window.seconds,
            tonic_us=scale * _mean(window.tonic),
            tonic_slope_us_per_min=scale * window.trend_per_min,
            scr_count=len(found),
            scr_rate_per_min=60 * len(found) / window.told_s if enough else np.nan,
            scr_amplitude_us=scale * _mean(np.array([each.amplitude for each in found])),
            scr_rise_time_s=_mean(np.array([each.rise_time_s for each in found])),
            scr_half_recovery_s=_mean(np.array([each.half_recovery_s for each in found])),
            phasic_auc_us_s=scale * float(np.nansum(window.raw - window.tonic)) / GRID_HZ,
            scr_onset_timestamps=tuple(each.onset_ns for each in fresh),
            scr_peak_timestamps=tuple(each.peak_ns for each in fresh),
            scr_amplitudes_us=tuple(scale * each.amplitude for each in fresh),
            signal_quality=quality * DOUBT if doubt else quality,
            extra=self._extra(scale * least, scale * window.tonic[-1]),
            reasons=tuple(self._reasons(enough, jumped, least, doubt)),
        )

    def _window(self, block: Block) -> _Window:
        here = self._times_ns > block.end_ns - round(self._config.window_s * SECOND_NS)
        held = frozen(self._raw[:, None], round(self._held_s * GRID_HZ))
        raw = self._raw[here]
        told = np.isfinite(raw) & ~self._withheld[here]
        seconds = block.window_s(self._config.window_s)
        return _Window(seconds, raw, self._spread[here], self._tonic[here], told, told & ~held[here])

    def _withhold(self, block: Block, window_s: float, problem: str) -> EdaUpdate:
        """Nothing can be said of the window, and nothing will be said later of what came since the last answer."""
        self._withheld |= self._times_ns > self._answered_ns
        self._told_ns = block.end_ns
        return self._nothing(block, window_s, problem)

    def _least_amplitude(self, ripple: float) -> float:
        """The amplitude from which on a rise is a response: the parameter, above noise and the converter's steps."""
        told_from = np.fmax(features.NOISE_MARGIN * ripple, features.STEPS * np.fmin.reduce(self._steps))
        return float(np.fmax(self._config.scr_threshold_us if self._scale == 1 else 0.0, told_from))

    def _quality(self, window: _Window, ripple: float, jumped: float) -> float:
        """Of the signal itself, whatever moved the sensor."""
        noise = float(np.nanmax([_median(window.spread), ripple]))
        filled = min(window.filled, self._presence.share())
        return features.quality(_median(window.tonic), noise, jumped, window.trend_per_min, filled)

    def _forget(self, until_ns: int) -> None:
        """Forget the responses that the window has left behind."""
        self._responses = [each for each in self._responses if each.peak_ns > until_ns]

    def _found(self, least: float, whole: bool) -> list[Response]:
        """Responses that were not told before, filed."""
        begins = max(newest_run(self._raw), len(self._raw) - round(LOOK_S * GRID_HZ))
        raw, times_ns = self._raw[begins:], self._times_ns[begins:]
        cut = self._railed(raw)
        fresh = [
            Response(
                int(times_ns[scr.onset]),
                int(times_ns[scr.peak]),
                np.nan if cut[scr.onset : scr.peak + AROUND_PEAK].any() else scr.amplitude,
            )
            for scr in features.responses(raw, least, whole)
            if times_ns[scr.peak] > self._told_ns + APART_NS
        ]
        self._responses += fresh
        self._told_ns = fresh[-1].peak_ns if fresh else self._told_ns
        return fresh

    def _recover(self) -> None:
        """Give the responses their recovery where it has come, and see which of them fall as they rose."""
        begins = newest_run(self._raw)
        if len(self._raw) == begins or not self._responses:
            return
        level, times_ns = smoothed(self._raw[begins:], features.SMOOTH_S), self._times_ns[begins:]
        ends = [*(each.onset_ns for each in self._responses[1:]), None]
        for each, end_ns in zip(self._responses, ends, strict=True):
            if each.peak_ns < times_ns[0]:
                continue
            onset, peak = (int(at) for at in np.searchsorted(times_ns, (each.onset_ns, each.peak_ns)))
            if times_ns[-1] - each.peak_ns < JUDGED_NS:
                each.mirrored |= features.mirrored(level, features.Scr(onset, peak, each.amplitude))
            if np.isnan(each.half_recovery_s):
                end = None if end_ns is None else int(np.searchsorted(times_ns, end_ns))
                each.half_recovery_s = features.half_recovery_s(level, features.Scr(peak, peak, each.amplitude), end)

    def _problem(self, window: _Window, end_ns: int) -> str:
        """Why nothing can be said of the window; empty where something can."""
        known = window.known
        if np.isfinite(self._loose_us):
            return f"loose electrode: {self._loose_us:.3g} uS is no conductance of skin with good contact"
        if not len(known) or end_ns - self._times_ns[-1] > (BRIDGED_S + 0.5) * SECOND_NS:
            return "eda holds no number"
        if self._railed(known[-round(LEVEL_S * GRID_HZ) :]).mean() > AT_RAIL:
            return "eda is saturated: at an end of its range"
        if self._is_flat(known, window.spread):
            return "eda is flat: nothing but noise moves it"
        ripple_least = self._config.scr_threshold_us if self._scale == 1 else 0.3 * float(np.std(known))
        if features.shows_pulse(window.raw[newest_run(window.raw) :], ripple_least):
            return "eda shows the heart's pulse: not skin conductance, or a loose electrode over an artery"
        return ""

    def _is_flat(self, known: Floats, spread: Floats) -> bool:
        """Whether nothing but noise moves the points of a window that is long enough to tell."""
        seconds = len(known) / GRID_HZ
        least = features.FLAT_US if self._scale == 1 else 0.0
        noise = _median(spread) if seconds > FLAT_AFTER_S else 0.0
        return seconds > NEEDS_S and features.is_flat(known, noise, least)

    def _doubt(self, raw: Floats) -> str:
        """Why responses of the window are no skin's, raw being its newest stretch; empty where they may be."""
        if wanders(raw):
            return "falls are as steep as rises, nothing is smooth"
        if breathes(raw):
            return "falls are as steep as rises and come as evenly as breaths"
        mirrored, responses = sum(each.mirrored for each in self._responses), len(self._responses)
        if mirrored > MIRRORED * responses:
            return f"{mirrored} of {responses} responses fall as steeply as they rise, as where a hand presses"
        return ""

    def _railed(self, raw: Floats) -> NDArray[np.bool_]:
        """Which points are at an end of the range."""
        low, high = self._info.range_min, self._info.range_max
        edge = ROUNDED * (high - low)
        return (raw <= low + edge) | (raw >= high - edge) if low < high else np.zeros(len(raw), bool)

    def _extra(self, threshold_us: float, now_us: float) -> tuple[Feature, ...]:
        return Feature("scr_threshold", "uS", (threshold_us,)), Feature("tonic_now", "uS", (float(now_us),))

    def _reasons(self, enough: bool, jumped: float, least: float, doubt: str) -> list[str]:
        reasons = []
        if not self._responses:
            reasons.append("no response in the window: scr_amplitude_us, scr_rise_time_s, scr_half_recovery_s")
        elif all(np.isnan(each.half_recovery_s) for each in self._responses):
            reasons.append("scr_half_recovery_s: no response has lost half of its height yet")
        if any(np.isnan(each.amplitude) for each in self._responses):
            reasons.append("a response was cut at an end of its range: its amplitude, rise and recovery are not known")
        if not enough:
            reasons.append(f"scr_rate_per_min, tonic_slope_us_per_min need {NEEDS_S:g} s")
        if jumped:
            reasons.append(f"jumps faster than skin: {100 * jumped:.0f} % of the window is doubtful")
        if doubt:
            reasons.append(f"{doubt}: no skin does that, responses are doubtful")
        if self._scale == 1 and least > self._config.scr_threshold_us:
            reasons.append(f"noise or resolution: responses below {least:.2g} uS are not told from it")
        if np.isnan(self._scale):
            unit = self._info.unit or "unknown"
            reasons.append(f"uncalibrated: the unit is {unit}, uS are needed for level and amplitudes")
        return reasons

    def _nothing(self, block: Block, window_s: float, problem: str) -> EdaUpdate:
        nan = np.nan
        stamps = block.device_ns, block.received_ns, window_s
        extra = self._extra(self._scale * self._config.scr_threshold_us, nan)
        return EdaUpdate(*stamps, nan, nan, -1, nan, nan, nan, nan, nan, (), (), (), 0.0, extra, (problem,))


def _mean(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else np.nan


def _median(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else np.nan
