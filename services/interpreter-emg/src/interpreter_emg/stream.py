"""The state of one EMG stream: samples in, one update per grid point out."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.rate import TrueRate
from sense4hri.resolution import least_step
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature, Marker
from sense4hri.stream_info import StreamInfo

from interpreter_emg import features
from interpreter_emg.bursts import REST_LEAST_S, Bursts, Event
from interpreter_emg.cleaning import BAND_HZ, Cleaner, at_rails, band_hz
from interpreter_emg.config import Config
from interpreter_emg.effort import Effort

FS_HZ, MOST_CHANNELS = (200.0, 20_000.0), 64
BRIDGED_S = 0.25  # a shorter hole ends no activity
KNOWN = 0.5  # share of the window that has to be a signal
RAILED = 0.01  # share of the samples: each takes SETTLE_S after it along
HEART_S = 10.0  # of the past in which the heart is looked for
HEART_LEAST_S = 6.0  # until which it may be there unseen
DRIFT_S = 10.0  # in which drift is told from muscles: one window alone varies too much
SIZE_S = 60.0  # in which a channel's loudest moment is its size, and a heart or a rectifier in it is not forgotten
NEVER_NS = -(2**62)
LEAST_ACTIVE_RMS = 0.5  # uV: no amplifier is as quiet
MOST_RMS = 20_000.0  # uV: electrodes on skin show up to 10 mV from peak to peak (De Luca 2002)

Floats = NDArray[np.float64]


class EmgUpdate(NamedTuple):
    """What the features message says; arrays follow channel_names. Times on the event clock."""

    device_ns: int | None
    received_ns: int
    window_s: float
    channel_names: tuple[str, ...]
    rms_uv: tuple[float, ...]
    mav_uv: tuple[float, ...]
    mean_frequency_hz: tuple[float, ...]
    median_frequency_hz: tuple[float, ...]
    mvc_percent: tuple[float, ...]
    channel_quality: tuple[float, ...]
    active: tuple[bool, ...]
    onset_timestamps: tuple[int, ...]
    onset_channels: tuple[str, ...]
    offset_timestamps: tuple[int, ...]
    offset_channels: tuple[str, ...]
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class Channel(NamedTuple):
    """One channel in the window; rms and mav in the stream's unit, NaN where it is no signal."""

    rms: float
    mav: float
    spectrum: features.Spectrum
    quality: float
    reasons: tuple[str, ...]


class EmgStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate, or so many channels, as no EMG has."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, names = info.sampling_frequency_hz, info.channel_names
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for EMG")
        if len(names) > MOST_CHANNELS:
            raise ValueError(f"channel_names has {len(names)} names, must be at most {MOST_CHANNELS} for EMG")
        self._config, self._info, self._names = config, info, names
        self._calibrated = info.unit == "uV"
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S, filled=True)
        self._rate = TrueRate(fs_hz)
        self._effort = Effort(fs_hz, names, config.mvc_s)
        self._newest_ns: int | None = None
        self._begin_segment()

    def marker(self, marker: Marker) -> None:
        """`mvc`: the greatest effort follows; the marker's value names the channel, none means all."""
        if marker.name == "mvc":
            self._effort.begin(marker.value, self._newest_ns)

    def push(self, timed: TimedChunk) -> list[EmgUpdate]:
        """Take the next samples; return the updates that became due."""
        blocks = self._blocks.take(timed)
        self._newest_ns = int(timed.times_ns[-1])
        return [update for block in blocks for update in self._interpret(block)]

    def _begin_segment(self) -> None:
        """Everything but the greatest effort begins anew, at the rate that is known now."""
        self._fs_hz, channels = self._rate.hz, len(self._names)
        self._cleaner = Cleaner(self._fs_hz, channels, (self._info.range_min, self._info.range_max))
        least_rms = LEAST_ACTIVE_RMS if self._calibrated else 0.0
        ratios = self._config.onset_ratio, self._config.offset_ratio
        self._bursts = Bursts(self._fs_hz, channels, ratios, least_rms)
        self._raw = self._clean = self._idle = np.empty((0, len(self._names)))
        self._times_ns = np.empty(0, np.int64)
        self._hum_rms = np.zeros(len(self._names))
        self._step = np.full(len(self._names), np.nan)  # of the converter
        self._loudest: deque[tuple[int, Floats]] = deque()
        spectra = max(1, round(DRIFT_S / self._config.update_interval_s))
        self._spectra = [deque[features.Spectrum](maxlen=spectra) for _ in self._names]
        self._hearts = [features.NO_HEART] * len(self._names)
        self._beaten_ns = np.full(len(self._names), NEVER_NS)  # when the heart was last seen in a channel ...
        self._rectified_ns = self._beaten_ns.copy()  # ... and magnitudes

    def _interpret(self, block: Block) -> list[EmgUpdate]:
        events: list[Event] = []
        if self._rate.take(block):
            events = self._bursts.end(int(block.times_ns[0]))
            self._begin_segment()
        events += self._take(block) if len(block.times_ns) else []
        if block.hole is None:
            return [self._update(block, events)]
        return self._finish(block, block.hole, events)

    def _finish(self, block: Block, hole: Hole, events: list[Event]) -> list[EmgUpdate]:
        """A hole: what is active ends with the last sample before it, which is told at once."""
        events += self._bursts.end(block.end_ns)
        update = self._update(block, events) if events else None
        self._cleaner.restart()
        if hole is not Hole.CHAIN:
            self._effort.end()
            self._begin_segment()
        return [update] if update is not None else []

    def _take(self, block: Block) -> list[Event]:
        """Keep what later updates look at; return the onsets and offsets of the block."""
        clean = self._cleaner.push(block.samples)
        self._hum_rms = clean.hum_rms
        kept_ns = block.end_ns - round(max(HEART_S, self._config.window_s) * SECOND_NS)
        kept = slice(int(np.searchsorted(self._times_ns, kept_ns, side="right")), None)
        self._times_ns = np.concatenate([self._times_ns[kept], block.times_ns])
        self._raw = np.concatenate([self._raw[kept], block.samples])
        self._clean = np.concatenate([self._clean[kept], clean.values])
        worked = self._bursts.active
        self._step = np.fmin(self._step, least_step(block.samples))
        hidden_rms = np.fmax(clean.hum_left_rms, self._step / np.sqrt(12))  # the latter: of rounding
        events = self._bursts.push(clean.values, block.times_ns, hidden_rms)
        self._idle = np.concatenate([self._idle[kept], np.where(worked | self._bursts.active, 0.0, clean.values)])
        self._hear(block.end_ns)
        self._look_for_magnitudes(block.end_ns)
        self._effort.push(clean.values, clean.railed, block.times_ns, self._bursts.rest_rms)
        return events

    def _look_for_magnitudes(self, end_ns: int) -> None:
        """An envelope that only rests, or only works, is known for SIZE_S; a number below zero refutes it."""
        seen = np.where(np.isfinite(self._clean), self._raw, np.nan)
        self._rectified_ns[[features.is_rectified(column, self._fs_hz) for column in seen.T]] = end_ns
        self._rectified_ns[(seen < 0).any(axis=0)] = NEVER_NS

    def _hear(self, end_ns: int) -> None:
        """Look for the heart where no muscle works; what beats in a channel is no burst, for as long as SIZE_S."""
        self._hearts = [features.heart(column, self._fs_hz) for column in self._idle.T]
        self._beaten_ns[[heart.rms > 0 for heart in self._hearts]] = end_ns
        unknown = end_ns - self._times_ns[0] < HEART_LEAST_S * SECOND_NS
        self._bursts.heart = (end_ns - self._beaten_ns < SIZE_S * SECOND_NS) | unknown

    def _update(self, block: Block, events: list[Event]) -> EmgUpdate:
        window_s = block.window_s(self._config.window_s)
        channels = self._channels(block.end_ns, window_s)
        scale = 1.0 if self._calibrated else np.nan
        rms = np.array([channel.rms for channel in channels])
        onsets, offsets = ([each for each in events if each.onset is onset] for onset in (True, False))
        return EmgUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=window_s,
            channel_names=self._names,
            rms_uv=_floats(scale * rms),
            mav_uv=tuple(scale * channel.mav for channel in channels),
            mean_frequency_hz=tuple(channel.spectrum.mean_hz for channel in channels),
            median_frequency_hz=tuple(channel.spectrum.median_hz for channel in channels),
            mvc_percent=_floats(100 * rms / self._effort.rms),
            channel_quality=tuple(channel.quality for channel in channels),
            active=tuple(bool(active) for active in self._bursts.active),
            onset_timestamps=tuple(each.time_ns for each in onsets),
            onset_channels=tuple(self._names[each.channel] for each in onsets),
            offset_timestamps=tuple(each.time_ns for each in offsets),
            offset_channels=tuple(self._names[each.channel] for each in offsets),
            signal_quality=float(np.mean([channel.quality for channel in channels])),
            extra=(
                Feature("rest_rms", self._info.unit, _floats(self._bursts.rest_rms)),
                Feature("mvc_rms", self._info.unit, _floats(self._effort.rms)),
            ),
            reasons=(*self._reasons(), *(reason for channel in channels for reason in channel.reasons)),
        )

    def _channels(self, end_ns: int, window_s: float) -> list[Channel]:
        """What the window shows of each channel."""
        start_ns = end_ns - round(self._config.window_s * SECOND_NS)
        here = slice(int(np.searchsorted(self._times_ns, start_ns, side="right")), None)
        raw, clean = self._raw[here], self._clean[here]
        self._remember(clean, end_ns)
        drift = features.wander(raw, self._fs_hz)
        return [self._channel(i, raw[:, i], clean[:, i], float(drift[i]), window_s) for i in range(len(self._names))]

    def _remember(self, clean: Floats, end_ns: int) -> None:
        """How loud each channel is now, but for pops."""
        size = round(features.PEAK_S * self._fs_hz)
        steady = [features.without_pops(column, size) for column in clean.T]
        self._loudest.append((end_ns, _rms(np.column_stack(steady))))
        while self._loudest[0][0] < end_ns - SIZE_S * SECOND_NS:
            self._loudest.popleft()

    @property
    def _least_rms(self) -> float:
        """uV of noise that every electrode on skin has in the band of this rate."""
        low_hz, high_hz = band_hz(self._fs_hz)
        return LEAST_ACTIVE_RMS * float(np.sqrt((high_hz - low_hz) / (BAND_HZ[1] - BAND_HZ[0])))

    def _channel(self, i: int, raw: Floats, clean: Floats, drift: float, window_s: float) -> Channel:
        known = clean[np.isfinite(clean)]
        filled = min(1.0, len(known) / max(1.0, self._fs_hz * window_s))
        if filled < KNOWN:
            return _no_signal(self._dead(i, raw))
        rms, size = float(np.sqrt(np.mean(known**2))), self._size_rms(i)
        if why := self._no_muscle(i, rms, size):
            return _no_signal(why)
        spectrum = features.spectrum(clean, self._fs_hz, band_hz(self._fs_hz))
        self._spectra[i].append(spectrum)
        drifts = features.is_drift(self._spectra[i])
        noise = rms if drifts else features.noise_rms(rms, spectrum.white, float(self._bursts.rest_rms[i]))
        size = max(size, features.LOUD_RMS) if self._calibrated else size
        quality = features.quality(noise, float(self._hum_rms[i]), drift, self._hearts[i].rms, size, filled)
        problem = self._no_frequency(spectrum, rms, drifts)
        reasons = tuple(f"{self._names[i]}: {each}" for each in (self._contamination(i, size), problem) if each)
        told = features.NO_SPECTRUM if problem else spectrum
        return Channel(rms, float(np.mean(np.abs(known))), told, quality, reasons)

    def _size_rms(self, i: int) -> float:
        """How loud the loudest moment of a channel was."""
        return max(float(each[i]) for _, each in self._loudest if np.isfinite(each[i]))

    def _no_muscle(self, i: int, rms: float, size: float) -> str:
        """Why what a channel shows is no muscle; empty where it may be one."""
        if self._calibrated and size < self._least_rms:
            return f"{self._names[i]}: below {self._least_rms:.2g} uV, which no muscle is"
        if self._calibrated and rms > MOST_RMS:
            return f"{self._names[i]}: above {MOST_RMS:g} uV, which no muscle is: is the unit right?"
        if self._times_ns[-1] - self._rectified_ns[i] < SIZE_S * SECOND_NS:
            return f"{self._names[i]} is never below zero: rectified, where the muscle's own signal is needed"
        return ""

    def _contamination(self, i: int, size: float) -> str:
        """How much of the heart a channel shows; empty where it shows none."""
        heart = self._hearts[i]
        if not heart.rms:
            return ""
        share = f"{100 * heart.rms / size:.0f} % of the muscle's amplitude"
        return f"ECG contamination, {heart.rate_bpm:.0f} beats/min, {share}"

    def _no_frequency(self, spectrum: features.Spectrum, rms: float, drifts: bool) -> str:
        """Why a channel has no frequency of a muscle in the window; empty where it has one, or its rate is too low."""
        if self._calibrated and rms < LEAST_ACTIVE_RMS:
            return f"below {LEAST_ACTIVE_RMS:g} uV, which no muscle is: mean_frequency_hz, median_frequency_hz"
        if spectrum.white > features.WHITE:
            return "the spectrum is that of noise, no muscle's: mean_frequency_hz, median_frequency_hz"
        if drifts:
            return "the spectrum is that of drift, no muscle's: mean_frequency_hz, median_frequency_hz"
        if np.isnan(spectrum.mean_hz) and self._fs_hz >= features.LEAST_FS_HZ:
            needed = f"{100 * (1 - features.MISSING):g} % of the window"
            return f"too many samples are no signal: mean_frequency_hz, median_frequency_hz need {needed}"
        return ""

    def _dead(self, i: int, raw: Floats) -> str:
        """Why a channel has no signal in the window."""
        name, finite = self._names[i], raw[np.isfinite(raw)]
        if len(finite) < KNOWN * len(raw):
            return f"{name} holds no number"
        railed = float(at_rails(finite[:, None], self._info.range_min, self._info.range_max).mean())
        if railed > RAILED:
            return f"{name} is saturated: {100 * railed:.0f} % of its samples are at an end of its range"
        if len(finite) > 1 and np.mean(np.diff(finite) == 0) > KNOWN:
            return f"{name} is flat: its value does not change"
        return f"{name} has too little signal in the window"

    def _reasons(self) -> list[str]:
        """What is true of the whole stream."""
        reasons = self._rate.reasons() + list(self._effort.problems.values())
        missing = [name for name, rms in zip(self._names, self._effort.rms, strict=True) if np.isnan(rms)]
        if missing:
            reasons.append(f"mvc_percent: no marker mvc with an effort yet for {', '.join(missing)}")
        if np.isnan(self._bursts.rest_rms).any():
            reasons.append(f"active needs {REST_LEAST_S:g} s of rest")
        if self._fs_hz < features.LEAST_FS_HZ:
            reasons.append(
                f"mean_frequency_hz, median_frequency_hz need {features.LEAST_FS_HZ:g} Hz, not {self._fs_hz:g}"
            )
        elif self._fs_hz < features.FULL_FS_HZ:
            upper_hz = band_hz(self._fs_hz)[1]
            reasons.append(f"mean_frequency_hz, median_frequency_hz are of {upper_hz:g} Hz and less: they may be low")
        if not self._calibrated:
            reasons.append(f"uncalibrated: the unit is {self._info.unit or 'unknown'}, rms_uv and mav_uv need uV")
        return reasons


def _no_signal(why: str) -> Channel:
    return Channel(np.nan, np.nan, features.NO_SPECTRUM, 0.0, (why,))


def _rms(values: Floats) -> Floats:
    """Root mean square, shape (channels,), of values, shape (n, channels); NaN where none is a number."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    return np.asarray(
        np.sqrt(np.where(count, (np.where(known, values, 0.0) ** 2).sum(axis=0), np.nan) / np.maximum(count, 1))
    )


def _floats(values: Floats) -> tuple[float, ...]:
    return tuple(values.tolist())
