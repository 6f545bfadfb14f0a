"""What one browser looks at, and what it has to be sent next. Pure."""

from dataclasses import dataclass

from sense4hri.names import StreamName
from sense4hri.stamps import SECOND_NS

from web_gui.frames import Frame, LanePart
from web_gui.history import History
from web_gui.model import Study
from web_gui.stream import Stream

MOST_CHANNELS = 255
SPARE = 1.1  # a page keeps a little more than it shows


@dataclass(frozen=True)
class LaneRequest:
    """One lane: a stream and its channels (None = all)."""

    stream: StreamName
    channels: tuple[int, ...] | None


@dataclass(frozen=True)
class Request:
    """A client's view. end_ns None = live: the right edge is now."""

    view: int
    columns: int
    window_ns: int
    end_ns: int | None
    lanes: tuple[LaneRequest, ...]


class Cursor:
    """How far one lane of one view has been sent."""

    def __init__(self, request: LaneRequest) -> None:
        self.request = request
        self._history: History | None = None
        self._version = -1
        self._upto_ns = 0
        self._samples = -1
        self._gaps: list[tuple[int, int]] = []
        self._marks = -1

    def part(self, index: int, stream: Stream, start_ns: int, end_ns: int, column_ns: int) -> LanePart | None:
        """Return what is new of the lane in [start_ns, end_ns), None where nothing is."""
        history = stream.history
        if history is None:
            return None
        full = history is not self._history or history.version != self._version
        if not full and history.samples_total == self._samples and stream.marks.total == self._marks:
            return None
        first_column_ns = start_ns // column_ns * column_ns
        from_ns = first_column_ns if full else max(self._upto_ns, first_column_ns)
        channels = self._channels(history)
        line = history.columns(from_ns, end_ns, column_ns, channels)
        gaps = history.gaps(start_ns, end_ns)
        new_marks = full or stream.marks.total != self._marks or gaps != self._gaps
        self._history, self._version, self._samples = history, history.version, history.samples_total
        self._marks, self._gaps = stream.marks.total, gaps
        newest_ns = history.newest_ns
        if newest_ns is not None:
            self._upto_ns = min(newest_ns, end_ns) // column_ns * column_ns
        if not (full or len(line.times_ns) or new_marks):
            return None
        if not new_marks:
            return LanePart(index, full, from_ns, line)
        return LanePart(index, full, from_ns, line, gaps, stream.marks.between(history, start_ns, end_ns))

    def _channels(self, history: History) -> list[int]:
        everything = range(len(history.channels))
        if self.request.channels is None:
            return list(everything)[:MOST_CHANNELS]
        return [channel for channel in self.request.channels if channel in everything]


class View:
    """One client's view of the study."""

    def __init__(self, request: Request) -> None:
        self.request = request
        self._cursors = [Cursor(lane) for lane in request.lanes]

    def frame(self, study: Study, number: int, now_ns: int) -> Frame:
        """Return what the client has not seen yet."""
        edge_ns = study.axis.now_ns(now_ns)
        request = self.request
        end_ns = edge_ns + SECOND_NS if request.end_ns is None else request.end_ns
        start_ns = (edge_ns if request.end_ns is None else end_ns) - round(SPARE * request.window_ns)
        column_ns = max(1, request.window_ns // request.columns)
        parts = []
        for index, cursor in enumerate(self._cursors):
            stream = study.streams.get(cursor.request.stream)
            if stream is None:
                continue
            part = cursor.part(index, stream, start_ns, end_ns, column_ns)
            if part is not None:
                parts.append(part)
        base_ns = min(edge_ns, end_ns) // SECOND_NS * SECOND_NS  # a frame reaches 35 min from there, the past an hour
        return Frame(request.view, number, edge_ns, base_ns, parts)
