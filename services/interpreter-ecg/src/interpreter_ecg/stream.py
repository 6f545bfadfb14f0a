"""The state of one ECG stream: samples in, one update per grid point out."""

import math
from collections import deque
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks
from sense4hri.chunk import TimedChunk
from sense4hri.early_beats import Irregular, irregular
from sense4hri.hrv import LONGEST_GAP_S, MOST_BEATS_PER_S, NO_NORMAL_RHYTHM, Hrv, HrvWindow, Span, variability, withheld
from sense4hri.living import Living
from sense4hri.motion import Motion
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_ecg.config import Config
from interpreter_ecg.detector import Beat, Detector
from interpreter_ecg.features import contrast, signal_quality
from interpreter_ecg.foretold import doubt_ms, newest_ms, unforeseen
from interpreter_ecg.intervals import (
    FEWEST_INTERVALS,
    Interval,
    agreement,
    known_share,
    of_noise_ms,
    rate_bpm,
    usual_ms,
)
from interpreter_ecg.morphology import Label, Morphology
from interpreter_ecg.span import Doubt, Jitters, Labels

FS_HZ = (50.0, 8000.0)
MOST_ECTOPIC_PERCENT = 12.0  # of the beats; from more, what is left between normal beats is no measure of the heart
MOST_UNTOLD_MS = 10.0  # of an RMSSD, by which two ways to tell premature beats may differ
UNTOLD = "hrv withheld: premature beats cannot be told from breathing"
MOST_OF_NOISE_MS = 8.0  # of an RMSSD, which is promised to 10 ms
MISSED = 1.5  # median intervals from which one with something like a beat in it most likely lacks that ...
UNREST = 0.25  # ... as one does that is as steep as this share of its beat: an electrode that is off picks up mains
CLEAN_VALLEY = 0.03  # energy between beats, as a share of theirs, up to which a strange beat is no noise
DOUBTFUL = 0.69  # the best quality where T waves and early beats, or pops and beats, cannot be told apart
EDGES, EDGES_FS_HZ = 0.85, 120.0  # no heart's beats are as angular (0.7 at 130 Hz); slower sampling makes them so
SILENT_S = 5.0  # a window this long with hardly a beat is not unknown, it is bad
LONGEST_INTERVAL_MS = 5000.0  # a longer one is a pause or an electrode that was off: nobody knows which
DEVICE_AGE_S = (1.0, 6.0)  # a device's own rate is compared when it came this long before the samples


class EcgUpdate(NamedTuple):
    """What the features message says; NaN where it cannot be computed. Times on the event clock."""

    device_ns: int | None
    received_ns: int
    window_s: float
    peak_count: int
    peak_timestamps: tuple[int, ...]
    rr_intervals_ms: tuple[float, ...]
    rr_interval_ms: float
    heart_rate_bpm: float
    hrv: Hrv
    device_heart_rate_difference_bpm: float
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class EcgStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no ECG has and a lead that is not there."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, channels = info.sampling_frequency_hz, info.channel_names
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for ECG")
        if config.channel and config.channel not in channels:
            raise ValueError(f"parameter 'channel' is {config.channel!r}, the stream has {', '.join(channels)}")
        self._config, self._calibrated = config, info.unit == "uV"
        self._lead = channels.index(config.channel) if config.channel else 0
        self._blocks = Blocks(config.update_interval_s)
        self._fs_hz = fs_hz
        self._detector = Detector(fs_hz)
        self._hrv = HrvWindow(config.hrv_window_s)
        self._fresh: list[Interval] = []  # beats decided on since the last update
        self._device_rates: deque[tuple[int, float]] = deque(maxlen=64)
        self._living, self._motion = Living(), Motion()
        self._alive = True
        self._begin_segment(0)

    def _begin_segment(self, first_ns: int) -> None:
        self._detector.restart()
        self._hrv.restart(first_ns)
        self._first_ns = self._alive_ns = first_ns  # of this segment; the last sample that was a signal
        self._window: deque[Interval] = deque()
        self._usual_ms = np.nan  # the median interval of the window, or of the last one that had any known
        self._previous_ns: int | None = None  # the last beat, unless a gap came after it
        self._previous = Label.UNCERTAIN
        self._morphology = Morphology()
        most = round(MOST_BEATS_PER_S * self._config.hrv_window_s)
        self._labels = Labels(most)
        self._jitters = Jitters(most)  # of the beats of variability
        self._doubt = Doubt(first_ns)  # whether premature beats are told
        self._missing_ns: NDArray[np.int64] = np.empty(0, np.int64)  # times of the newest values that are not numbers
        self._quality = np.nan

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        """Remember the heart rate in 1/min that the device itself computed; 0 means that it has none."""
        if name == "heart_rate" and value > 0:
            self._device_rates.append((received_ns, value))

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def push(self, timed: TimedChunk) -> list[EcgUpdate]:
        """Take the next samples; one update for every grid point they reach, one for a stretch that ends."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _interpret(self, block: Block) -> list[EcgUpdate]:
        if block.begins:
            self._begin_segment(block.first_ns)
        if len(block.times_ns):
            self._take(self._detected(block), block)
        return [self._update(block)] if block.hole is None else self._broken(block)

    def _detected(self, block: Block) -> list[Interval]:
        """The beats of a block. A stretch without a signal breaks the chain of intervals as missing samples do."""
        intervals = []
        ecg = block.samples[:, self._lead]
        missing_ns = np.concatenate((self._missing_ns, block.times_ns[~np.isfinite(ecg)]))
        self._missing_ns = missing_ns[missing_ns > block.end_ns - LONGEST_GAP_S * SECOND_NS]
        for stretch in self._living.split(ecg, block.times_ns):
            if stretch.alive:
                self._revive(int(stretch.times_ns[0]))
                intervals += self._chained(self._detector.push(stretch.values, stretch.times_ns))
                self._alive_ns = int(stretch.times_ns[-1])
            elif self._alive:
                intervals += self._chained(self._detector.cut(stretch.undone))
                self._previous_ns = None
            self._alive = stretch.alive
        return intervals

    def _revive(self, first_ns: int) -> None:
        """After a long time without a signal everything begins anew."""
        if not self._alive and first_ns - self._alive_ns > LONGEST_GAP_S * SECOND_NS:
            self._begin_segment(first_ns)

    def _chained(self, beats: list[Beat]) -> list[Interval]:
        intervals = []
        for beat in beats:
            rr_ms = self._rr_ms(beat)
            label = self._morphology.label(beat.shape, rr_ms, beat.complete and beat.valley < CLEAN_VALLEY)
            if self._is_angular(beat.edge):
                label = Label.UNCERTAIN
            disturbed = not beat.complete or beat.jumped or beat.unrest > UNREST
            lacks_one = disturbed and rr_ms > MISSED * self._usual_ms
            whole = not (lacks_one or rr_ms > LONGEST_INTERVAL_MS)
            intervals.append(Interval(beat, rr_ms, label, self._previous, whole, self._morphology.unlike))
            self._previous_ns, self._previous = beat.time_ns, label
            self._labels.add(beat.time_ns, label)
        return intervals

    def _rr_ms(self, beat: Beat) -> float:
        """Since the beat before; NaN after a gap, and where values that are missing most likely hid a beat."""
        if self._previous_ns is None:
            return np.nan
        rr_ms = (beat.time_ns - self._previous_ns) / 1e6
        if not rr_ms > MISSED * self._usual_ms:
            return rr_ms
        missing = np.any((self._missing_ns > self._previous_ns) & (self._missing_ns < beat.time_ns))
        return np.nan if missing else rr_ms

    def _broken(self, block: Block) -> list[EcgUpdate]:
        """A hole breaks the chain of intervals.

        Beats undecided on are told at once, in an update that belongs to the last sample before the hole: after it they
        would come too late, or in another clock.
        """
        self._take(self._chained(self._detector.cut()), block)
        self._previous_ns = None
        self._living.interrupted()
        return [self._update(block)] if self._fresh else []

    def _take(self, intervals: list[Interval], block: Block) -> None:
        """File beats under everything that is computed from them."""
        self._fresh += intervals
        self._window += intervals
        start_ns = self._start_ns(block)
        while self._window and self._window[0].beat.time_ns <= start_ns:
            self._window.popleft()
        known = [interval for interval in self._window if interval.known]
        usual = usual_ms(known)
        self._usual_ms = self._usual_ms if np.isnan(usual) else usual
        likeness, newest = self._likeness()
        self._file_for_variability(intervals, poor=likeness < self._config.hrv_min_quality)
        silent = np.isnan(likeness) and self._window_s(block) >= SILENT_S
        self._quality = 0.0 if silent else self._rated(min(likeness, newest), known, block)

    def _file_for_variability(self, intervals: list[Interval], poor: bool) -> None:
        """Intervals of a poor signal count as unknown."""
        for interval in intervals:
            beat, rr_ms = interval.beat, np.nan if poor else interval.rr_ms
            self._hrv.add(beat.time_ns, rr_ms, beat.complete, interval.normal, interval.unlike)
            if interval.normal and np.isfinite(rr_ms):
                self._jitters.add(beat.time_ns, beat.jitter_s)

    def _rated(self, likeness: float, known: list[Interval], block: Block) -> float:
        """The quality of the window: how alike its beats are, how sure its rate is, less by motion and by doubts."""
        start_ns = self._start_ns(block)
        sure = known_share(known, self._window) * agreement(known, self._window, start_ns)
        doubts = 1 + self._motion.at(block.received_ns, self._config.window_s).strength
        best = DOUBTFUL if self._doubtful() or self._angular() else 1.0
        return min((likeness * sure) ** doubts, best)

    def _doubtful(self) -> bool:
        """Whether something that would have been a beat of the window was taken for a T wave."""
        return any(interval.beat.doubtful for interval in self._window)

    def _angular(self) -> bool:
        """Whether most beats of the window come and go within one sample each, as pops and pulses do."""
        edges = [interval.beat.edge for interval in self._window]
        return bool(edges) and self._is_angular(median(edges))

    def _is_angular(self, edge: float) -> bool:
        return self._fs_hz >= EDGES_FS_HZ and edge > EDGES

    def _likeness(self) -> tuple[float, float]:
        """Likeness of the window's beats, and of the newest, to those of a heart, 0..1; NaN with fewer than three."""
        if not self._window:
            return np.nan, np.nan
        beats = [interval.beat for interval in self._window]
        clear = contrast([beat.valley for beat in beats])
        quality, newest = signal_quality(np.array([beat.shape for beat in beats]), [beat.energy for beat in beats])
        return quality * clear, newest * clear

    def _variability(self, end_ns: int) -> tuple[Hrv, tuple[str, ...], float]:
        """Variability, why it is missing, and the ectopic beats in percent."""
        span, start_ns = self._hrv.span(end_ns), end_ns - round(self._config.hrv_window_s * SECOND_NS)
        found = irregular(span.raw.rr_ms, span.raw.linked)
        hrv, reasons = variability(span, found.left_out)
        ectopic_percent = self._labels.ectopic_percent(start_ns, found.early)
        many, hangs = ectopic_percent > MOST_ECTOPIC_PERCENT, self._hangs(span, found, hrv.rmssd_ms)
        doubtful = many or (hangs and self._hidden(span, found, hrv.rmssd_ms))
        lasts = self._doubt.lasts(doubtful if math.isfinite(hrv.rmssd_ms) else None, end_ns)
        if many:
            return withheld(hrv), (f"hrv withheld: ectopic {ectopic_percent:.0f} %",), ectopic_percent
        if hangs and lasts:
            return withheld(hrv), (UNTOLD,), ectopic_percent
        of_noise = of_noise_ms(hrv.rmssd_ms, self._jitters.after(start_ns))
        if of_noise > MOST_OF_NOISE_MS:
            reason = f"hrv withheld: noise moves the R peaks, up to {of_noise:.0f} ms of rmssd_ms would be of it"
            return withheld(hrv), (reason,), ectopic_percent
        if NO_NORMAL_RHYTHM in reasons:  # where none is in time, none is early
            ectopic_percent = self._labels.ectopic_percent(start_ns, 0)
        return hrv, reasons, ectopic_percent

    @staticmethod
    def _hangs(span: Span, found: Irregular, rmssd_ms: float) -> bool:
        """Whether premature beats that were not told could move RMSSD."""
        return math.isfinite(rmssd_ms) and doubt_ms(span.raw.rr_ms, span.raw.linked, found.left_out) > MOST_UNTOLD_MS

    @staticmethod
    def _hidden(span: Span, found: Irregular, rmssd_ms: float) -> bool:
        """Whether RMSSD depends on intervals that may end with premature beats that were not told."""
        rr_ms, linked, left_out = span.raw.rr_ms, span.raw.linked, found.left_out
        more = unforeseen(rr_ms, linked, left_out)
        if newest_ms(rr_ms, linked, more) > MOST_UNTOLD_MS:
            return True
        if np.array_equal(more, left_out):
            return False
        return not abs(variability(span, more)[0].rmssd_ms - rmssd_ms) <= MOST_UNTOLD_MS

    def _start_ns(self, block: Block) -> int:
        """Where the window begins."""
        return block.end_ns - round(self._config.window_s * SECOND_NS)

    def _window_s(self, block: Block) -> float:
        return min((block.end_ns - self._first_ns) / SECOND_NS, self._config.window_s)

    def _update(self, block: Block) -> EcgUpdate:
        """What is told now: of the beats since the last update, of the window, and of the span of variability."""
        if not self._alive:
            self._quality = 0.0
        hrv, hrv_reasons, ectopic_percent = self._sure_variability(block.end_ns)
        trusted = self._trusted()
        rate = rate_bpm(trusted, self._start_ns(block))
        difference = rate - self._device_rate(block.received_ns)
        fresh, self._fresh = self._fresh, []
        return EcgUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=self._window_s(block),
            peak_count=len(self._window),
            peak_timestamps=tuple(interval.beat.time_ns for interval in fresh),
            rr_intervals_ms=tuple(interval.rr_ms for interval in fresh),
            rr_interval_ms=trusted[-1].rr_ms if trusted else np.nan,
            heart_rate_bpm=rate,
            hrv=hrv,
            device_heart_rate_difference_bpm=difference,
            signal_quality=self._quality,
            extra=self._extra(ectopic_percent),
            reasons=(*self._why_doubtful(block), *self._why_nan(trusted, rate, difference), *hrv_reasons),
        )

    def _sure_variability(self, end_ns: int) -> tuple[Hrv, tuple[str, ...], float]:
        """`_variability`, withheld while the quality is too low for it."""
        hrv, reasons, ectopic_percent = self._variability(end_ns)
        least = self._config.hrv_min_quality
        if self._quality < least and not ectopic_percent > MOST_ECTOPIC_PERCENT:
            return withheld(hrv), (f"hrv withheld: signal_quality below {least:g}",), ectopic_percent
        return hrv, reasons, ectopic_percent

    def _trusted(self) -> list[Interval]:
        """The intervals of the window that a rate may hang on; none while the quality is too low or not known."""
        if not self._quality >= self._config.min_quality:
            return []
        return [interval for interval in self._window if interval.known]

    def _why_doubtful(self, block: Block) -> list[str]:
        """Why the quality is low or not known."""
        doubts = []
        if not self._alive:
            silent_s = (block.end_ns - self._alive_ns) / SECOND_NS
            doubts.append(f"no signal: the value has not changed for {silent_s:.1f} s")
        if np.isnan(self._quality):
            doubts.append("signal_quality, rr_interval_ms need three beats")
        if self._doubtful():
            doubts.append("signal_quality: what follows the beats may be tall T waves or ventricular beats")
        if self._angular():
            doubts.append("signal_quality: the beats come and go within one sample, as pops do")
        return doubts

    def _why_nan(self, trusted: list[Interval], rate: float, difference: float) -> list[str]:
        """Why values other than the quality and variability are NaN."""
        missing, least = [], self._config.min_quality
        if self._quality < least:
            missing.append(f"heart_rate_bpm, rr_interval_ms withheld: signal_quality below {least:g}")
        elif np.isnan(rate):
            missing.append(f"heart_rate_bpm needs {FEWEST_INTERVALS} intervals")
        if self._quality >= least and not trusted:
            missing.append("rr_interval_ms: no interval in the window")
        if np.isnan(difference):
            missing.append("device_heart_rate_difference_bpm: no heart rate of the device to compare with")
        if not self._calibrated:
            missing.append("uncalibrated: r_amplitude needs the unit uV")
        return missing

    def _extra(self, ectopic_percent: float) -> tuple[Feature, ...]:
        heights = [abs(interval.beat.height) for interval in self._window]
        height_uv = median(heights) if heights and self._calibrated else np.nan
        return (
            Feature("r_amplitude", "uV", (height_uv,)),
            Feature("ectopic_percent", "%", (ectopic_percent,)),
        )

    def _device_rate(self, received_ns: int) -> float:
        """The newest rate the device reported 1 to 6 s before this receipt: old enough to be there in every replay."""
        for reported_ns, rate in reversed(self._device_rates):
            if DEVICE_AGE_S[0] <= (received_ns - reported_ns) / 1e9 <= DEVICE_AGE_S[1]:
                return rate
        return np.nan
