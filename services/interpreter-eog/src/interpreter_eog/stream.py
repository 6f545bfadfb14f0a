"""The state of one EOG: its two channels, the blinks and saccades of the last minute, and which way up blinks are."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.motion import Motion
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_eog.channel import BRIDGED_S, NOISE_AFTER_S, Blink, Channel, Look, Saccade
from interpreter_eog.config import Config
from interpreter_eog.mains import Mains
from interpreter_eog.wander import DOUBT, lids_are_sideways, wanders

FS_HZ = (50.0, 8000.0)
CHANNELS = ("heog", "veog")
SETTLED_S = 0.9  # after so long nothing changes a blink, or a saccade, any more
BLINK_HIDES_NS = (3 * SECOND_NS // 10, SECOND_NS // 2)  # before and after greatest closure: what moves is the lid
ONE_MOVEMENT_NS = SECOND_NS // 10  # saccades of both channels that begin within this are one
RATE_NEEDS_S = 10.0
MOST_BLINKS_PER_MIN = 100.0  # over a window; people blink 1 to 33 times a minute, most in talk (Doughty 2001)
Hump = tuple[int, float]  # time and signed height of what looks like a blink
ABSENT = Look(np.nan, np.nan, ([], []), [], "is not among the channels")


class EogUpdate(NamedTuple):
    """What the EOG message says; times on the event clock, NaN where something cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    blink_count: int
    blink_rate_per_min: float
    blink_duration_ms: float
    blink_timestamps: tuple[int, ...]
    blink_durations_ms: tuple[float, ...]
    saccade_count: int
    saccade_rate_per_min: float
    saccade_timestamps: tuple[int, ...]
    saccade_amplitudes_uv: tuple[float, ...]
    horizontal_uv: float
    vertical_uv: float
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


class Movement(NamedTuple):
    """A saccade of the eyes, which one or both channels show; vertical: veog moves further."""

    time_ns: int
    amplitude_uv: float
    vertical: bool


class Seen(NamedTuple):
    """Up to this time, since the one before: for how long blinks, and saccades, could be told."""

    until_ns: int
    blinks_s: float
    saccades_s: float


class Looks(NamedTuple):
    """What both channels show; ABSENT is one that the stream has not."""

    heog: Look
    veog: Look

    def without_veog(self, problem: str) -> "Looks":
        """Return them where veog says nothing."""
        return self._replace(veog=self.veog._replace(quality=0.0, saccades=[], problem=problem))

    def with_veog_doubted(self) -> "Looks":
        """Return them with a veog that says less."""
        return self._replace(veog=self.veog._replace(quality=self.veog.quality * DOUBT))


class Fresh(NamedTuple):
    """Events that no update has told yet."""

    blinks: list[Blink]
    saccades: list[Movement]


class EogStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no EOG has, and without a channel of one."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz = info.sampling_frequency_hz
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for EOG")
        names = [name.lower() for name in info.channel_names]
        self._columns = {name: names.index(name) for name in CHANNELS if name in names}
        if not self._columns:
            raise ValueError(f"channels are {', '.join(info.channel_names)}; EOG needs heog, veog or both")
        self._config, self._info, self._calibrated = config, info, info.unit == "uV"
        rails = info.range_min, info.range_max
        self._channels = {name: Channel(config, self._calibrated, *rails) for name in self._columns}
        self._mains = {name: Mains(fs_hz) for name in self._columns}
        self._blocks, self._motion = Blocks(config.update_interval_s, bridged_s=BRIDGED_S), Motion()
        self._restart()

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def push(self, timed: TimedChunk) -> list[EogUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _restart(self) -> None:
        for name, channel in self._channels.items():
            channel.restart()
            self._mains[name].restart()
        self._decided_ns = -(2**62)  # up to here every event has been told
        self._humps: list[Hump] = []  # of veog ...
        self._sideways: list[Hump] = []  # ... and heog
        self._blinks: list[Blink] = []
        self._saccades: list[Movement] = []
        self._seen: list[Seen] = []  # of the window

    def _interpret(self, block: Block) -> list[EogUpdate]:
        if block.begins:
            self._restart()
        for name, column in self._columns.items():
            self._channels[name].push(self._mains[name].without(block.samples[:, column]), block.times_ns)
        return [self._update(block, SETTLED_S)] if block.hole is None else self._finish(block, block.hole)

    def _finish(self, block: Block, hole: Hole) -> list[EogUpdate]:
        """A hole: what waits for what follows is told at once, with the last sample before it."""
        update = self._update(block, 0.0)
        for mains in self._mains.values():
            mains.interrupted()
        if hole is not Hole.CHAIN:
            self._restart()
        return [update] if update.blink_timestamps or update.saccade_timestamps else []

    def _update(self, block: Block, settled_s: float) -> EogUpdate:
        window_s = block.window_s(self._config.window_s)
        until_ns, start_ns = block.end_ns - round(settled_s * SECOND_NS), block.end_ns - round(window_s * SECOND_NS)
        looks = self._looks(block, window_s)
        self._humps = self._filed(self._humps, looks.veog, until_ns, start_ns)
        self._sideways = self._filed(self._sideways, looks.heog, until_ns, start_ns)
        lids = looks.veog.humps[0 if self._polarity() >= 0 else 1]  # to where most of the height points
        if problem := self._no_lid(window_s):
            looks, lids = looks.without_veog(problem), []
        fresh = self._fresh(looks, lids, until_ns)
        self._see(looks, until_ns, start_ns)
        self._file(fresh, until_ns, start_ns)
        doubt = "" if looks.veog.problem else self._doubt(block.end_ns, window_s)
        if doubt:
            looks = looks.with_veog_doubted()
        heog, veog = looks
        blinking, looking = not veog.problem, not (heog.problem and veog.problem)
        blinks_s, saccades_s = self._seen_s(window_s)
        uv = 1.0 if self._calibrated else np.nan
        return EogUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=window_s,
            blink_count=len(self._blinks) if blinking else -1,
            blink_rate_per_min=60 * len(self._blinks) / blinks_s if blinking else np.nan,
            blink_duration_ms=_mean([each.duration_ms for each in self._blinks]) if blinking else np.nan,
            blink_timestamps=tuple(each.time_ns for each in fresh.blinks),
            blink_durations_ms=tuple(each.duration_ms for each in fresh.blinks),
            saccade_count=len(self._saccades) if looking else -1,
            saccade_rate_per_min=60 * len(self._saccades) / saccades_s if looking else np.nan,
            saccade_timestamps=tuple(each.time_ns for each in fresh.saccades),
            saccade_amplitudes_uv=tuple(uv * each.amplitude_uv for each in fresh.saccades),
            horizontal_uv=heog.deflection,
            vertical_uv=veog.deflection,
            signal_quality=_mean([look.quality for look in looks]),
            extra=self._extra(heog, veog, fresh.saccades),
            reasons=tuple(self._reasons(heog, veog, not np.isnan(blinks_s + saccades_s), doubt)),
        )

    def _looks(self, block: Block, window_s: float) -> Looks:
        """What the channels show; where the device moves, they are doubtful."""
        doubts = 1 + self._motion.at(block.received_ns, self._config.window_s).strength
        looks = dict.fromkeys(CHANNELS, ABSENT)
        for name, channel in self._channels.items():
            look = channel.look(block.end_ns, window_s, self._decided_ns)
            looks[name] = look._replace(quality=look.quality**doubts)
        return Looks(**looks)

    def _no_lid(self, window_s: float) -> str:
        """Why what rises and falls on veog is no lid; empty where it may be."""
        if window_s < RATE_NEEDS_S or (rate_per_min := 60 * self._told() / window_s) <= MOST_BLINKS_PER_MIN:
            return ""
        return f"rises and falls {rate_per_min:.0f} times a minute, as no lid does"

    def _fresh(self, looks: Looks, lids: Sequence[Blink], until_ns: int) -> Fresh:
        """The events that are certain now and were not told before."""
        blinks = [each for each in lids if self._decided_ns < each.time_ns <= until_ns]
        moved = movements(looks.heog, looks.veog, lids)
        return Fresh(blinks, [each for each in moved if self._decided_ns < each.time_ns <= until_ns])

    def _file(self, fresh: Fresh, until_ns: int, start_ns: int) -> None:
        """Add the events to those of the window."""
        self._decided_ns = max(self._decided_ns, until_ns)
        self._blinks = [each for each in (*self._blinks, *fresh.blinks) if each.time_ns > start_ns]
        self._saccades = [each for each in (*self._saccades, *fresh.saccades) if each.time_ns > start_ns]

    def _see(self, looks: Looks, until_ns: int, start_ns: int) -> None:
        """File for how long something could be told of each channel since the last update."""
        heog_s, veog_s = (
            0.0 if look.problem else self._channels[name].known_s(self._decided_ns, until_ns)
            for name, look in zip(CHANNELS, looks, strict=True)
        )
        self._seen.append(Seen(until_ns, veog_s, max(heog_s, veog_s)))
        self._seen = [seen for seen in self._seen if seen.until_ns > start_ns]

    def _seen_s(self, window_s: float) -> tuple[float, float]:
        """For how long blinks, and saccades, could be told in the window; NaN where that is too short for a rate.

        What is being decided at its end, or hides no blink, counts as if it had been.
        """
        told_s = np.array([(seen.blinks_s, seen.saccades_s) for seen in self._seen]).sum(axis=0) + SETTLED_S + BRIDGED_S
        seen_s = np.minimum(told_s, window_s)
        blinks_s, saccades_s = np.where(seen_s >= RATE_NEEDS_S, seen_s, np.nan).tolist()
        return blinks_s, saccades_s

    def _filed(self, humps: list[Hump], look: Look, until_ns: int, start_ns: int) -> list[Hump]:
        """Those of the window, with the ones that are certain now."""
        found = [
            (each.time_ns, sign * each.height) for sign, side in zip((1, -1), look.humps, strict=True) for each in side
        ]
        fresh = [hump for hump in found if self._decided_ns < hump[0] <= until_ns]
        return [hump for hump in (*humps, *fresh) if hump[0] > start_ns]

    def _polarity(self) -> float:
        """1: a closing lid raises veog; -1: its electrodes are swapped; NaN as long as no blink was seen."""
        height = sum(height for _, height in self._humps)
        return float(np.sign(height)) if self._humps else np.nan

    def _doubt(self, end_ns: int, window_s: float) -> str:
        """Why blinks are not to be trusted; empty where they are."""
        if lids_are_sideways(_heights(self._sideways), _heights(self._humps)):
            return "blinks are seen in heog and hardly in veog, as where the channels are swapped"
        if self._wanders(end_ns, window_s):
            return "veog wanders as noise does, without rest or both ways alike"
        return ""

    def _wanders(self, end_ns: int, window_s: float) -> bool:
        """Whether veog moves as noise does; without a blink that takes NOISE_AFTER_S to tell."""
        if not self._blinks and window_s < NOISE_AFTER_S:
            return False
        levels = self._channels["veog"].levels(end_ns, window_s)
        return wanders(levels, _heights(self._humps))

    def _told(self) -> int:
        """How many humps of the window point where blinks do."""
        return sum(height * self._polarity() > 0 for _, height in self._humps)

    def _extra(self, heog: Look, veog: Look, moved: Sequence[Movement]) -> tuple[Feature, ...]:
        return (
            Feature("heog_quality", "1", (heog.quality,)),
            Feature("veog_quality", "1", (veog.quality,)),
            Feature("veog_polarity", "1", (self._polarity(),)),
            Feature("saccade_is_vertical", "1", tuple(float(each.vertical) for each in moved)),
        )

    def _reasons(self, heog: Look, veog: Look, enough: bool, doubt: str) -> list[str]:
        reasons = []
        if heog.problem:
            reasons.append(f"heog {heog.problem}: horizontal_uv, horizontal saccades")
        if veog.problem:
            reasons.append(f"veog {veog.problem}: vertical_uv, blinks, vertical saccades")
        elif not self._blinks:
            reasons.append("blink_duration_ms: no blink in the window")
        if doubt:
            reasons.append(f"{doubt}: blinks are doubtful")
        if not enough:
            reasons.append(f"blink_rate_per_min, saccade_rate_per_min need {RATE_NEEDS_S:g} s")
        if not veog.problem and self._polarity() < 0:
            reasons.append("veog is upside down: blinks lower it, electrodes may be swapped")
        if not self._calibrated:
            unit = self._info.unit or "unknown"
            reasons.append(f"uncalibrated: the unit is {unit}, uV are needed for amplitudes and deflections")
        return reasons


def movements(heog: Look, veog: Look, lids: Sequence[Blink]) -> list[Movement]:
    """Return saccades of either channel, those of both as one with the greater amplitude; none while a lid moves."""
    steps = [(each, name == "veog") for name, look in (("heog", heog), ("veog", veog)) for each in look.saccades]
    found: list[Movement] = []
    for saccade, vertical in sorted(steps):
        if any(-BLINK_HIDES_NS[0] < saccade.time_ns - lid.time_ns < BLINK_HIDES_NS[1] for lid in lids):
            continue
        if found and saccade.time_ns - found[-1].time_ns < ONE_MOVEMENT_NS:
            found[-1] = _joined(found[-1], saccade, vertical)
        else:
            found.append(Movement(saccade.time_ns, saccade.amplitude_uv, vertical))
    return found


def _joined(first: Movement, saccade: Saccade, vertical: bool) -> Movement:
    if abs(saccade.amplitude_uv) <= abs(first.amplitude_uv):
        return first
    return Movement(first.time_ns, saccade.amplitude_uv, vertical)


def _heights(humps: Sequence[Hump]) -> list[float]:
    return [height for _, height in humps]


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else np.nan
