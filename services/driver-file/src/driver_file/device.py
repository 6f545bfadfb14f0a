"""A recording as a sensor: what it holds, when it was taken, over and over."""

import asyncio
import time
from collections.abc import AsyncGenerator, Iterator, Mapping
from itertools import count

import numpy as np
from sense4hri.arrivals import in_thread
from sense4hri.chunk import Chunk
from sense4hri.device import Declared, Item, Marked, Noted, Samples, Stream
from sense4hri.errors import ConfigError, DeviceLost
from sense4hri.signal_files.content import Event, IntArray
from sense4hri.stamps import SECOND_NS

from driver_file import transport
from driver_file.config import FileConfig
from driver_file.protocol import Recorded

SHOWN = 5  # names of events that are not played
RESET_NS = SECOND_NS  # a clock that falls back by more has begun anew; by less, samples came out of order


class FilePlayer:
    """A Device of the kit; a file that has ended stays lost."""

    def __init__(self, config: FileConfig, streams: Mapping[str, Stream]) -> None:
        self._config, self._ended = config, False

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Read the file, then yield its samples and markers at their times; DeviceLost at its end."""
        if self._ended:
            raise DeviceLost(f"{self._config.file} has ended")
        recorded, content = await in_thread(lambda: transport.read(self._config))
        for note in content.notes:
            yield Noted(f"{self._config.file}: {note}")
        tape = Tape(recorded, content.events if self._config.markers else (), self._config)
        if tape.unheard and not self._config.start_s and not self._config.duration_s:
            yield Noted(f"{self._config.file}: not played, before its first sample or after its last: {tape.unheard}")
        yield Declared({each.sensor_type: each.stream for each in tape.recorded})
        begun_s = time.monotonic()
        for frame in count() if self._config.loop else range(tape.frames):
            due_s = begun_s + (frame + 1) * self._config.frame_s / self._config.speed
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            for item in tape.items(frame, time.time_ns()):
                yield item
        self._ended = True
        raise DeviceLost(f"{self._config.file} has ended")


class Tape:
    """The part of a recording that is played, cut into frames of `frame_s`; pure.

    Times are the file's own, moved by whole seconds where they began at 0 or before, because 0 means no time; in every
    further round, which takes a frame at least, they go on where the last one ended. What comes after a clock in the
    file began anew is played a sample later. unheard: names of the events outside it.
    """

    def __init__(self, recorded: list[Recorded], events: tuple[Event, ...], config: FileConfig) -> None:
        first_ns = min(int(each.times_ns.min()) for each in recorded)
        moved_ns = max(0, -(first_ns // SECOND_NS) + 1) * SECOND_NS if first_ns <= 0 else 0
        begin_ns = first_ns + round(config.start_s * SECOND_NS)
        end_ns = begin_ns + round(config.duration_s * SECOND_NS) if config.duration_s else None
        self.recorded = [_part(each, begin_ns, end_ns, moved_ns) for each in recorded]
        if not all(len(each.times_ns) for each in self.recorded):
            raise ConfigError(f"start_s: {config.file} has no samples of every stream from {config.start_s:g} s on")
        for each in self.recorded:
            if len(each.times_ns) > 1 and not np.ptp(each.times_ns):
                raise ConfigError(f"time_column: {config.file} has one time for all samples of {each.sensor_type}")
        self.recorded = [_one_by_one(each) for each in self.recorded]
        self._speed = config.speed
        self._frame_ns = round(config.frame_s * SECOND_NS)
        self._due = [_due_ns(each) for each in self.recorded]
        self._begin_ns = min(int(due[0]) for due in self._due)
        ends_ns = [int(due[-1]) + _usual_ns(each) for each, due in zip(self.recorded, self._due, strict=True)]
        self._round_ns = max(self._frame_ns, max(ends_ns) - self._begin_ns)
        self.frames = -(-self._round_ns // self._frame_ns)
        moved = [event._replace(time_ns=event.time_ns + moved_ns) for event in events]
        within = [0 <= event.time_ns - self._begin_ns < self._round_ns for event in moved]
        self._events = [event for event, is_played in zip(moved, within, strict=True) if is_played]
        outside = [event.name for event, is_played in zip(moved, within, strict=True) if not is_played]
        self.unheard = ", ".join(outside[:SHOWN]) + (f" and {len(outside) - SHOWN} more" if outside[SHOWN:] else "")

    def items(self, frame: int, received_ns: int) -> Iterator[Item]:
        """Yield what lies in a frame, counted from 0 through all rounds."""
        begin_ns = frame * self._frame_ns
        first, last = begin_ns // self._round_ns, (begin_ns + self._frame_ns - 1) // self._round_ns
        for lap in range(first, last + 1):
            from_ns = self._begin_ns + max(0, begin_ns - lap * self._round_ns)
            to_ns = self._begin_ns + min(self._round_ns, begin_ns + self._frame_ns - lap * self._round_ns)
            for each, due in zip(self.recorded, self._due, strict=True):
                part = slice(*np.searchsorted(due, (from_ns, to_ns)).tolist())
                yield from _samples(each, part, lap * self._round_ns, received_ns)
            for event in self._events:
                if from_ns <= event.time_ns < to_ns:
                    later_ns = lap * self._round_ns
                    age_ns = begin_ns + self._frame_ns - (later_ns + event.time_ns - self._begin_ns)
                    event_ns = received_ns - round(age_ns / self._speed)
                    yield Marked(event_ns, event.time_ns + later_ns, event.name, event.value)


def _samples(recorded: Recorded, part: slice, later_ns: int, received_ns: int) -> Iterator[Samples]:
    """Yield the samples of a part, if there are any."""
    times_ns, values = recorded.times_ns[part] + later_ns, recorded.values[part]
    if len(times_ns):
        chunk = Chunk(recorded.stream.channel_names, values, int(times_ns[-1]), received_ns)
        yield Samples(recorded.sensor_type, chunk, times_ns)


def _part(recorded: Recorded, begin_ns: int, end_ns: int | None, moved_ns: int) -> Recorded:
    """Return the samples from begin to end, their times moved."""
    inside = recorded.times_ns >= begin_ns
    if end_ns is not None:
        inside &= recorded.times_ns < end_ns
    return recorded._replace(times_ns=recorded.times_ns[inside] + moved_ns, values=recorded.values[inside])


def _one_by_one(recorded: Recorded) -> Recorded:
    """Return irregular samples of which those of one time are 1 ns after each other: it would look like a reset."""
    if recorded.stream.sampling_frequency_hz:
        return recorded
    numbers = np.arange(len(recorded.times_ns))
    is_first = np.diff(recorded.times_ns, prepend=recorded.times_ns[:1] - 1) != 0
    later_ns = numbers - np.maximum.accumulate(np.where(is_first, numbers, 0))
    return recorded._replace(times_ns=recorded.times_ns + later_ns)


def _due_ns(recorded: Recorded) -> IntArray:
    """Return when each sample is played, by the clock as it was before it began anew."""
    steps_ns = np.diff(recorded.times_ns, prepend=recorded.times_ns[:1])
    later_ns = np.where(steps_ns < -RESET_NS, _usual_ns(recorded) - steps_ns, 0)
    return np.maximum.accumulate(recorded.times_ns + np.cumsum(later_ns))


def _usual_ns(recorded: Recorded) -> int:
    """Return the time from one sample to the next."""
    times_ns, fs_hz = recorded.times_ns, recorded.stream.sampling_frequency_hz
    usual_ns = SECOND_NS / fs_hz if fs_hz else float(np.median(np.diff(times_ns))) if len(times_ns) > 1 else SECOND_NS
    return max(1, round(usual_ns))
