"""What features say that is drawn on a lane, as marks on the event clock: how fields of a message become marks. Pure.

Arrays that belong together may come in different lengths from a stranger: what has no partner is left out.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from web_gui.history import History
from web_gui.readings import Plain, at_path, number

MOST_MARKS = 8000  # of one stream: 13 a second for ten minutes
MOST_CHANNELS = 1024  # of which marks are told apart
LATEST_NS = 2**62
USABLE = 0.5  # quality below which a channel is poor, as in static/js/gutter.js
SECOND_NS, MS_NS = 1_000_000_000, 1_000_000
ALL = -1  # channel of a mark that belongs to all of them
MARK = np.dtype(
    [("from_ns", "i8"), ("to_ns", "i8"), ("kind", "u2"), ("channel", "i2"), ("x", "f4"), ("y", "f4"), ("goes_on", "?")]
)
KEPT = np.dtype([*MARK.descr, ("heard", "i8")])
"""heard: how many samples of the stream had come by then."""
Rows = NDArray[np.void]


class Mark(NamedTuple):
    """One thing in time, on the event clock. channel: its name, "" = all; x, y: its value or place, NaN = none."""

    from_ns: int
    to_ns: int
    channel: str = ""
    x: float = math.nan
    y: float = math.nan
    goes_on: bool = False


class Until(NamedTuple):
    """The stretch of a channel that goes on reaches to this time, None: no further than is known."""

    channel: str
    to_ns: int | None
    goes_on: bool


Reader = Callable[[Plain], Iterator[Mark | Until]]


class Kind(NamedTuple):
    """One kind of mark of a lane. name: what one is called; how: the way it is drawn (static/js/ways.js)."""

    name: str
    how: str
    read: Reader


def at(times: str) -> Reader:
    """One mark at each of the field's times."""
    return lambda plain: (Mark(t, t) for t in _items(plain, times))


def value(path: str) -> Reader:
    """One mark for each message, at its last sample: the field's value, of a list the mean."""

    def read(plain: Plain) -> Iterator[Mark]:
        found = number(_at(plain, path))
        yield Mark(_now(plain), _now(plain), x=math.nan if found is None else found)

    return read


def of_good(path: str) -> Reader:
    """One mark for each message, at its last sample: the mean of the channels whose `channel_quality` is enough."""

    def read(plain: Plain) -> Iterator[Mark]:
        pairs = zip(_items(plain, path), _items(plain, "channel_quality"), strict=False)
        found = number([of_channel for of_channel, quality in pairs if quality >= USABLE])
        yield Mark(_now(plain), _now(plain), x=math.nan if found is None else found)

    return read


def lasting(times: str, lasts_ms: str, x: str = "", y: str = "", centred: bool = False) -> Reader:
    """One stretch from each of the times on, or around it; x, y: fields with its place."""

    def read(plain: Plain) -> Iterator[Mark]:
        starts, durations = _items(plain, times), _items(plain, lasts_ms)
        nowhere = [math.nan] * len(starts)
        places = zip(_items(plain, x) if x else nowhere, _items(plain, y) if y else nowhere, strict=False)
        for start, ms, place in zip(starts, durations, places, strict=False):
            length_ns = round(ms * MS_NS) if math.isfinite(ms) else 0
            begin = start - length_ns // 2 if centred else start
            yield Mark(begin, begin + length_ns, "", *place)

    return read


def before(begins_s: str, ends_s: str) -> Reader:
    """One stretch for each pair of seconds before the message's last sample."""

    def read(plain: Plain) -> Iterator[Mark]:
        for begin_s, end_s in zip(_items(plain, begins_s), _items(plain, ends_s), strict=False):
            if math.isfinite(begin_s) and math.isfinite(end_s):
                yield Mark(_now(plain) - round(begin_s * SECOND_NS), _now(plain) - round(end_s * SECOND_NS))

    return read


def between(onset: str, offset: str, active: str) -> Reader:
    """One stretch of a channel from each onset to the next offset; until that comes it goes on while `active` says so.

    onset, offset: first words of the fields `*_timestamps` and `*_channels`.
    """

    def read(plain: Plain) -> Iterator[Mark | Until]:
        begins = zip(_items(plain, f"{onset}_timestamps"), _items(plain, f"{onset}_channels"), strict=False)
        ends = zip(_items(plain, f"{offset}_timestamps"), _items(plain, f"{offset}_channels"), strict=False)
        changes: list[Mark | Until] = [Mark(t, t, str(channel), goes_on=True) for t, channel in begins]
        changes += [Until(str(channel), t, goes_on=False) for t, channel in ends]
        yield from sorted(changes, key=lambda change: change.to_ns or 0)
        for channel, on in zip(_items(plain, "channel_names"), _items(plain, active), strict=False):
            yield Until(str(channel), _now(plain) if on else None, bool(on))

    return read


class Marks:
    """The marks of one stream, the newest MOST_MARKS of them."""

    def __init__(self, kinds: tuple[Kind, ...]) -> None:
        self.kinds = kinds
        self.total = 0
        """Changes so far: whoever knows this number of them has nothing to learn."""
        self._rows = np.empty(0, KEPT)
        self._channels: list[str] = []
        self._placed: tuple[tuple[History, int, int], Rows] | None = None

    @property
    def kept_bytes(self) -> int:
        """Memory that they take."""
        return 2 * self._rows.nbytes

    def take(self, plain: Plain, heard: int = 1) -> None:
        """Take what a features message says. heard: `samples_total` of the stream's history, at least 1."""
        for place, kind in enumerate(self.kinds):
            self._take(place, list(kind.read(plain)), heard)

    def halve(self) -> None:
        """Forget the older half."""
        self._rows, self._placed = _newest(self._rows, len(self._rows) - len(self._rows) // 2).copy(), None

    def between(self, history: History, start_ns: int, end_ns: int) -> Rows:
        """Return those that touch a range of the axis, shape (n,) of MARK, on the axis, channels by their place."""
        placed = self._on(history)
        return placed[(placed["from_ns"] <= end_ns) & (placed["to_ns"] >= start_ns)]

    def _take(self, kind: int, found: list[Mark | Until], heard: int) -> None:
        new: list[tuple[Any, ...]] = []
        for one in found:
            if isinstance(one, Until):
                self._flush(new)
                self._prolong(kind, one)
            elif 0 < one.from_ns <= one.to_ns < LATEST_NS:
                place = kind, self._channel(one.channel), one.x, one.y
                new.append((one.from_ns, one.to_ns, *place, one.goes_on, heard))
        self._flush(new)

    def _flush(self, new: list[tuple[Any, ...]]) -> None:
        if new:
            self.total += len(new)
            self._rows = _newest(np.concatenate((self._rows, np.array(new, KEPT))), MOST_MARKS)
            new.clear()

    def _prolong(self, kind: int, until: Until) -> None:
        rows, channel = self._rows, self._channel(until.channel)
        going = np.flatnonzero((rows["kind"] == kind) & (rows["channel"] == channel) & rows["goes_on"])
        if len(going):
            row = rows[going[-1] : going[-1] + 1]
            row["to_ns"] = max(int(row["from_ns"][0]), until.to_ns or int(row["to_ns"][0]))
            rows["goes_on"][going] = False
            row["goes_on"] = until.goes_on
            self.total += 1

    def _channel(self, name: str) -> int:
        if not name:
            return ALL
        if name not in self._channels and len(self._channels) < MOST_CHANNELS:
            self._channels.append(name)
        return self._channels.index(name) if name in self._channels else ALL

    def _on(self, history: History) -> Rows:
        """Return all of them on the axis; made anew when one is new or the clock has moved what is drawn."""
        key = (history, history.version, self.total)
        if self._placed is None or self._placed[0] != key:
            kept = self._rows[self._rows["heard"] > history.begun]
            rows = np.empty(len(kept), MARK)
            rows[:] = kept[list(MARK.names or ())]
            for end in ("from_ns", "to_ns"):
                rows[end] = history.axis_times(rows[end], kept["heard"])
            places = {name: place for place, name in enumerate(history.channels)}
            known = np.array([*(places.get(name, ALL) for name in self._channels), ALL], np.int16)
            rows["channel"] = known[rows["channel"]]
            self._placed = key, rows
        return self._placed[1]


def _newest(rows: Rows, most: int) -> Rows:
    """Return at most so many of the newest; what begins at one time stays, or goes, together: the page pairs it."""
    first = max(0, len(rows) - most)
    if first:
        others = np.flatnonzero(rows["from_ns"][first:] != rows["from_ns"][first - 1])
        first += int(others[0]) if len(others) else 0
    return rows[first:]


def _now(plain: Plain) -> int:
    """The event time of the last sample a message used, 0 where it has none."""
    return int(at_path(plain, "device_timestamp") or at_path(plain, "header.stamp") or 0)


def _at(plain: Plain, path: str) -> Any:
    """The value of a field, or of `extra.NAME`."""
    if not path.startswith("extra."):
        return at_path(plain, path)
    name = path.removeprefix("extra.")
    return next((item["values"] for item in plain.get("extra", ()) if item.get("name") == name), None)


def _items(plain: Mapping[str, Any], path: str) -> list[Any]:
    found = _at(plain, path)
    return found if isinstance(found, list) else []
