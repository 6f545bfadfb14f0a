"""The state of one PPG stream: a window over the samples, its channels, what was published lately."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.hrv import Hrv, HrvWindow, variability, withheld
from sense4hri.lasting import IN_DOUBT
from sense4hri.motion import Motion
from sense4hri.stamps import SECOND_NS
from sense4hri.stream_info import StreamInfo

from interpreter_ppg import features
from interpreter_ppg.channel import MOST_PULSES_PER_S, Channel
from interpreter_ppg.config import POLARITIES, Config
from interpreter_ppg.detector import CONTEXT_S, CUT_LOOKAHEAD_S, LOOKAHEAD_S
from interpreter_ppg.device_rate import DeviceRate
from interpreter_ppg.doubts import Doubts
from interpreter_ppg.premature import NormalBeats, Taken, by_timing
from interpreter_ppg.unsure import LACKING, Unsure
from interpreter_ppg.window import Beat, Window

Floats = NDArray[np.float64]

NOT_PULSES = ("ambient", "confidence")  # channels that carry no pulse
LOWEST_RATE_HZ = 20.0
RATE_TOLERANCE = 0.02  # of a rate measured over a window
KEPT_S = CONTEXT_S + 1.0
BRIDGED_S = 0.1  # a shorter hole hides no pulse: the signal is drawn through it
UNEVEN = 1.5  # sampling intervals longer than this many mean ones are drawn through
TRUSTED = 0.85  # correlation with the template of both ends of an interval from which it serves the rate ...
PRECISE = 0.97  # ... and variability, which noise spoils sooner: ...
MOST_JITTER_S = 0.005  # ... this much adds 10 ms to an RMSSD of 2.5 ms, 3 to one of 25 (squares add, 6 times its own)
BETTER_BY, BETTER_FOR = 0.1, 3  # a channel must be that much better for that many updates to be chosen
MOTION_COST = 2.0  # in motion doubts count three times over
STEPS_COST = 0.31  # of the quality, where the pulses may be steps: a rate in doubt has no quality of 0.7
CLIPPED_SHARE = 0.02  # of samples at an end of the range that is called saturated
MOST_UNTOLD_MS = 3.0  # of an RMSSD that hangs on the newest interval, which may be that of a premature beat
UNTOLD = "whether the newest beat is premature is not known yet, rmssd_ms depends on it"


class PpgUpdate(NamedTuple):
    """What the PPG message says; times on the event clock, NaN where something cannot be computed."""

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
    pulse_amplitude: float
    channel_name: str
    signal_quality: float
    reasons: tuple[str, ...]


class PpgStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate too low for pulses or no channel with any."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        if 0 < info.sampling_frequency_hz < LOWEST_RATE_HZ:
            raise ValueError(f"sampling_frequency_hz is {info.sampling_frequency_hz:g}, below {LOWEST_RATE_HZ:g} Hz")
        if all(name.lower() in NOT_PULSES for name in info.channel_names):
            raise ValueError(f"no pulse channel among {', '.join(info.channel_names)}")
        self._config, self._info = config, info
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S)
        self._hrv = HrvWindow(config.hrv_window_s)
        self._unsure = Unsure(int(MOST_PULSES_PER_S * config.hrv_window_s))
        self._normal = NormalBeats(self._hrv, self._unsure)
        self._device, self._motion, self._doubts = DeviceRate(), Motion(), Doubts(config.window_s)
        self._fresh: list[Beat] = []  # to be published with the next update
        self._beats: deque[Beat] = deque(maxlen=int(MOST_PULSES_PER_S * config.window_s) + 8)
        self._forget_window()
        self._begin_segment(0)

    def push(self, timed: TimedChunk) -> list[PpgUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        """Take a value that the device computed itself."""
        self._device.add(name, value, received_ns)

    def _interpret(self, block: Block) -> list[PpgUpdate]:
        if block.begins:
            self._begin_segment(block.first_ns)
        if len(block.times_ns):
            self._extend_window(block)
        return [self._update(block, LOOKAHEAD_S)] if block.hole is None else self._finish(block, block.hole)

    def _finish(self, block: Block, hole: Hole) -> list[PpgUpdate]:
        """A hole: what came before it is finished.

        Its last pulses are told at once, in an update that belongs to the last sample before the hole: after it they
        would come too late, or in another clock.
        """
        update = self._update(block, CUT_LOOKAHEAD_S)
        self._forget_window()
        for channel in self._channels:
            channel.unlink()
        return [update] if update.peak_timestamps else []

    def _forget_window(self) -> None:
        self._times_ns = np.empty(0, np.int64)
        self._samples = np.empty((0, len(self._info.channel_names)))

    def _begin_segment(self, first_ns: int) -> None:
        polarity = POLARITIES[self._config.polarity]
        self._channels = [
            Channel(name, column, polarity, self._config.window_s)
            for column, name in enumerate(self._info.channel_names)
            if name.lower() not in NOT_PULSES
        ]
        self._first_ns = first_ns
        self._chosen = self._better_for = 0
        self._continues, self._correlation, self._jitter_s = False, np.nan, np.nan
        self._doubts.restart(first_ns)
        self._beats.clear()
        self._hrv.restart(first_ns)
        self._normal.restart()
        self._unsure.restart()

    def _extend_window(self, block: Block) -> None:
        times_ns = np.concatenate([self._times_ns, block.times_ns])
        samples = np.concatenate([self._samples, block.samples])
        newest_ns = times_ns[len(self._times_ns)]  # everything new stays, and enough of the past before it
        start = int(np.searchsorted(times_ns, newest_ns - round(KEPT_S * SECOND_NS)))
        self._times_ns, self._samples = times_ns[start:], samples[start:]

    def _update(self, block: Block, lookahead_s: float) -> PpgUpdate:
        reasons: list[str] = []
        self._look(reasons, lookahead_s)
        window = self._window(block)
        rate_bpm = features.heart_rate(window.rr_ms, window.trusted)
        quality = self._quality(block, window, rate_bpm, reasons)
        hrv, hrv_reasons = self._variability(block.end_ns)
        if quality < self._config.min_quality:
            rate_bpm, hrv = np.nan, withheld(hrv)
            reasons.append(f"signal_quality below {self._config.min_quality:g}: heart_rate_bpm and hrv withheld")
        else:
            reasons += [f"hrv: {reason}" for reason in hrv_reasons]
        device_bpm = self._device.at(block.received_ns)
        update = self._told(block, window, rate_bpm, hrv, quality)
        reasons += self._missing(update, device_bpm)
        return update._replace(device_heart_rate_difference_bpm=rate_bpm - device_bpm, reasons=tuple(reasons))

    def _window(self, block: Block) -> Window:
        """Return the pulses of the window that ends with the block; older ones are forgotten."""
        window_s = block.window_s(self._config.window_s)
        start_ns = block.end_ns - round(window_s * SECOND_NS)
        while self._beats and self._beats[0].time_ns < start_ns:
            self._beats.popleft()
        beats = list(self._beats)
        rr_ms, trusted = np.array([beat.rr_ms for beat in beats]), np.array([beat.trusted for beat in beats], bool)
        return Window(window_s, beats, rr_ms, trusted)

    def _told(self, block: Block, window: Window, rate_bpm: float, hrv: Hrv, quality: float) -> PpgUpdate:
        """Return the update, with the fresh pulses; the device's opinion and the reasons are still to come."""
        fresh, self._fresh = self._fresh, []
        return PpgUpdate(
            block.device_ns,
            block.received_ns,
            window.window_s,
            len(window.beats),
            tuple(beat.time_ns for beat in fresh),
            tuple(beat.rr_ms for beat in fresh),
            next((float(rr) for rr in window.rr_ms[::-1] if np.isfinite(rr)), np.nan),
            rate_bpm,
            hrv,
            np.nan,
            _mean(np.array([beat.amplitude for beat in window.beats])),
            self._channels[self._chosen].name,
            quality,
            (),
        )

    def _variability(self, end_ns: int) -> tuple[Hrv, tuple[str, ...]]:
        """Return the variability of the window that ends at end_ns, and why values are missing."""
        span = self._hrv.span(end_ns)
        left_out = by_timing(span.raw.rr_ms, span.raw.linked)
        hrv, reasons = variability(span, left_out)
        if left_out[-1:].any() and not left_out[-2:-1].any():  # the newest, of which the next one says more
            left_out[-1] = False
            without_ms, (hrv, reasons) = hrv.rmssd_ms, variability(span, left_out)
            if abs(without_ms - hrv.rmssd_ms) > MOST_UNTOLD_MS:
                return withheld(hrv), (UNTOLD,)
        if self._unsure.lacks(hrv, end_ns):
            return withheld(hrv), (LACKING,)
        return hrv, reasons

    def _quality(self, block: Block, window: Window, rate_bpm: float, reasons: list[str]) -> float:
        """Return how sure the pulses of the window are, 0..1; adds to reasons what lowers it."""
        channel = self._channels[self._chosen]
        moved = self._motion.at(block.received_ns, self._config.window_s)
        moves_alike = features.motion_doubt(moved, window.rr_ms)
        if moves_alike:
            reasons.append("signal_quality: the device moves at the rate of the pulses")
        quality = channel.quality ** (1 + MOTION_COST * moved.strength) * (1 - moves_alike * STEPS_COST)
        doubts = self._doubts.see(channel, block.end_ns, window, rate_bpm)
        reasons += doubts
        return IN_DOUBT if doubts and quality > IN_DOUBT else quality

    def _look(self, reasons: list[str], lookahead_s: float) -> None:
        """Let every channel look at the window, choose one, and take its fresh pulses."""
        times_s = (self._times_ns - self._first_ns) / SECOND_NS
        if len(times_s) < 2:
            return
        fs_hz = (len(times_s) - 1) / (times_s[-1] - times_s[0]) if times_s[-1] > times_s[0] else 0.0
        if fs_hz < LOWEST_RATE_HZ * (1 - RATE_TOLERANCE):
            reasons.append(f"sampling rate {fs_hz:.3g} Hz is below {LOWEST_RATE_HZ:g} Hz")
            return
        uneven = np.diff(times_s).max() * fs_hz > UNEVEN
        even_s = np.linspace(times_s[0], times_s[-1], len(times_s)) if uneven else times_s
        for channel in self._channels:
            channel.look(_drawn(self._samples[:, channel.column], times_s, even_s), even_s, fs_hz, lookahead_s)
        self._choose()
        channel = self._channels[self._chosen]
        reasons += self._faults(channel)
        self._take(channel)

    def _faults(self, channel: Channel) -> list[str]:
        """Return what the samples of a channel are unfit for."""
        faults, column = [], self._samples[:, channel.column]
        numbers = column[np.isfinite(column)]
        if not len(numbers):
            faults.append(f"{channel.name} holds no number")
        elif not np.ptp(numbers) > 0:
            faults.append(f"{channel.name} is flat")
        at_rail = np.count_nonzero((column <= self._info.range_min) | (column >= self._info.range_max))
        if self._info.range_min < self._info.range_max and at_rail > CLIPPED_SHARE * len(column):
            faults.append(f"{channel.name} is saturated")
        return faults

    def _choose(self) -> None:
        """Move to a clearly better channel, but not to and fro."""
        scores = [channel.score for channel in self._channels]
        best = int(np.argmax(scores))
        if scores[best] < scores[self._chosen] + BETTER_BY:
            self._better_for = 0
            return
        self._better_for += 1
        if self._better_for >= BETTER_FOR or not self._beats:
            self._chosen, self._better_for = best, 0
            self._continues = False

    def _take(self, channel: Channel) -> None:
        """File the fresh pulses of the chosen channel; after a change of channel the first ends no interval."""
        for pulse, jitter_s in zip(channel.fresh, channel.jitters_s(), strict=True):
            time_ns = self._first_ns + round(pulse.time_s * SECOND_NS)
            if self._beats and time_ns - self._beats[-1].time_ns < features.REFRACTORY_S * SECOND_NS:
                continue
            rr_ms = np.nan
            if self._continues and np.isfinite(pulse.rr_s):
                rr_ms = (time_ns - self._beats[-1].time_ns) / 1e6
            both = np.minimum(pulse.correlation, self._correlation)
            beat = Beat(time_ns, rr_ms, bool(both >= TRUSTED), pulse.amplitude)
            exact = both >= PRECISE and max(jitter_s, self._jitter_s) <= MOST_JITTER_S
            sure_ms = rr_ms if exact and time_ns > self._doubts.two_rhythms_to_ns else np.nan
            self._normal.add(Taken(time_ns, rr_ms, sure_ms, pulse.height))
            self._continues, self._correlation, self._jitter_s = True, pulse.correlation, jitter_s
            self._beats.append(beat)
            self._fresh.append(beat)

    def _missing(self, update: PpgUpdate, device_bpm: float) -> list[str]:
        """Why values of the update are NaN, where that was not said yet."""
        reasons = []
        if update.peak_count == 0:
            reasons.append(f"no pulse in the last {update.window_s:.0f} s")
        elif np.isnan(update.rr_interval_ms):
            reasons.append("rr_interval_ms needs two neighbouring pulses")
        if np.isnan(update.signal_quality):
            reasons.append("signal_quality needs more pulses")
        if np.isnan(update.heart_rate_bpm) and not update.signal_quality < self._config.min_quality:
            reasons.append("heart_rate_bpm needs three intervals")
        if np.isnan(update.pulse_amplitude) and update.peak_count:
            reasons.append("pulse_amplitude needs a whole pulse")
        if np.isnan(device_bpm):
            reasons.append("the device reports no heart rate")
        if not self._info.unit:
            reasons.append("unit of the raw stream is unknown")
        return reasons


def _drawn(ppg: Floats, times_s: Floats, even_s: Floats) -> Floats:
    """Return ppg at even_s: as it is, or with straight lines over what is missing or not a number."""
    finite = np.isfinite(ppg)
    if even_s is times_s and finite.all():
        return ppg
    return np.interp(even_s, times_s[finite], ppg[finite]) if finite.any() else np.zeros(len(ppg))


def _mean(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else np.nan
