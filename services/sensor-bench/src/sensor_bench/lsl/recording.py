"""An XDF of LabRecorder sent again as it was, on outlets like those it came from: stamps, pauses, and reboots."""

import asyncio
import math
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyxdf
from sense4hri import lsl
from sense4hri.signal_files.content import UnreadableFileError

from sensor_bench.device import DeviceKeys
from sensor_bench.lsl.feeds import FloatArray, Taken
from sensor_bench.lsl.machine import Outlet
from sensor_bench.lsl.sender import REBOOT_S, Sender
from sensor_bench.room import Room

LEAD_S = 1.5
"""Before its first sample a machine is up for so long, and a second at most beside it."""


class Track(NamedTuple):
    """The samples of one outlet from one start of its machine to the next; raw stamps, shape (n,)."""

    outlet: int
    stamps_s: FloatArray
    rows: "FloatArray | list[list[str]]"


class RecordedFeed:
    """Everything in the file, cut where the sender's clock began anew.

    parts: the tracks of each start of the machine. start_s: how much of the first part is left out.
    """

    def __init__(self, path: Path, start_s: float) -> None:
        try:
            streams, _ = pyxdf.load_xdf(
                str(path), synchronize_clocks=False, dejitter_timestamps=False, handle_clock_resets=False
            )
        except (OSError, ValueError, KeyError, IndexError, EOFError, SyntaxError) as err:
            raise UnreadableFileError(f"{path}: {err}") from err
        if not any(len(stream["time_stamps"]) for stream in streams):
            raise UnreadableFileError(f"{path}: no stream of it has a sample")
        self.outlets: Sequence[Outlet] = tuple(_outlet(stream["info"]) for stream in streams)
        self.types: Sequence[tuple[str, ...]] = [_types(each) for each in self.outlets]
        self.parts = _parts(streams)
        begin_s = min(track.stamps_s[0] for track in self.parts[0] if len(track.stamps_s)) + start_s
        self.parts[0] = [_from(track, begin_s) for track in self.parts[0]]
        if not any(len(track.stamps_s) for track in self.parts[0]):
            raise UnreadableFileError(f"{path}: nothing is left after {start_s:g} s")

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        raise NotImplementedError("a recording is taken part by part")


class RecordedSender(Sender):
    """Plays the parts one after the other, over and over; between two of them its machine is started again."""

    feed: RecordedFeed

    def __init__(self, room: Room, keys: DeviceKeys, feed: RecordedFeed, session: str, loss: float) -> None:
        super().__init__(room, keys, feed, session, loss)
        self._part, self._next = 0, False
        self._set_clock()

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        """What of the part now playing has its stamp in this span of the machine's clock."""
        tracks = self.feed.parts[self._part]
        if not self._next and to_s > max(track.stamps_s[-1] for track in tracks if len(track.stamps_s)) + REBOOT_S:
            self._next = True
            self._tasks.append(asyncio.create_task(self._reboot()))
        found = []
        for track in tracks:
            part = slice(*np.searchsorted(track.stamps_s, (from_s, to_s)).tolist())
            if part.start < part.stop:
                found.append(Taken(track.outlet, track.stamps_s[part], track.rows[part]))
        return found

    async def _reboot(self) -> None:
        await self._end()
        self._part = (self._part + 1) % len(self.feed.parts)
        self._set_clock()
        await self._boot()
        self._next = False

    def _set_clock(self) -> None:
        """Let the machine's clock be the one that the part's stamps were read from: whole seconds ahead."""
        first_s = min(track.stamps_s[0] for track in self.feed.parts[self._part] if len(track.stamps_s))
        self.ahead_s = float(math.floor(first_s - time.monotonic() - LEAD_S))


def _outlet(info: Any) -> Outlet:
    """Return the outlet that a stream was recorded from; what it did not describe stays undescribed."""
    described = ((info.get("desc") or [None])[0] or {}).get("channels") or [None]
    count = int(info["channel_count"][0])
    channels = (described[0] or {}).get("channel") or []
    parts = tuple(_described(each) for each in [*channels, *[{}] * count][:count])
    name, kind, source_id, form = (_first(info, tag) for tag in ("name", "type", "source_id", "channel_format"))
    return Outlet(name, kind, source_id, float(info["nominal_srate"][0]), form, parts)


def _described(channel: Any) -> tuple[str, str, str]:
    return _first(channel, "label"), _first(channel, "unit"), _first(channel, "type")


def _first(info: Any, tag: str) -> str:
    return (info.get(tag) or [""])[0] or ""


def _types(outlet: Outlet) -> tuple[str, ...]:
    return () if outlet.form == "string" else (lsl.sensor_type(outlet.content_type),)


def _parts(streams: list[Any]) -> list[list[Track]]:
    """Cut every stream where its stamps go back; a later part has all that came after as many restarts."""
    parts: dict[int, list[Track]] = {}
    for number, stream in enumerate(streams):
        stamps_s, rows = np.asarray(stream["time_stamps"], np.float64), stream["time_series"]
        edges = [0, *(np.flatnonzero(np.diff(stamps_s) < 0) + 1).tolist(), len(stamps_s)]
        for part, (first, end) in enumerate(pairwise(edges)):
            parts.setdefault(part, []).append(Track(number, stamps_s[first:end], rows[first:end]))
    return [parts[part] for part in sorted(parts)]


def _from(track: Track, begin_s: float) -> Track:
    first = int(np.searchsorted(track.stamps_s, begin_s))
    return Track(track.outlet, track.stamps_s[first:], track.rows[first:])
