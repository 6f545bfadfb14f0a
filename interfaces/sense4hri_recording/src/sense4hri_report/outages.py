"""When the recording itself stood still, whatever the streams did: a full disk, a recorder that hung or was stopped."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from sense4hri_recording.reader import Part, pauses
from sense4hri_recording.recorder_json import INTERRUPTED, RecorderJson, count
from sense4hri_recording.source import Source

from sense4hri_report.raw_findings import RawFindings
from sense4hri_report.watch import HostStep, Span
from sense4hri_report.window import Window

SILENCE_NS = 3_000_000_000
"""Drivers tell of themselves every second."""
AROUND_NS = 5_000_000_000
SPEAKERS = 3
"""So many topics, heard shortly before and shortly after a silence, do not fall silent together by themselves."""
MOST = 1000


@dataclass
class Silences:
    """Times in which nothing at all reached the recorder, by receipt of the messages around them."""

    found: list[Span] = field(default_factory=list)
    quiet: list[Span] = field(default_factory=list)
    """The same without asking whether anybody might have spoken."""
    _last_ns: int = 0
    _heard: deque[tuple[int, str]] = field(default_factory=lambda: deque(maxlen=4096))
    _waiting: tuple[Span, set[str], set[str]] | None = None

    def take(self, topic: str, log_ns: int) -> None:
        """A message of any topic."""
        if self._last_ns and log_ns - self._last_ns > SILENCE_NS:
            if len(self.quiet) < MOST:
                self.quiet.append(Span(self._last_ns, log_ns, "the disk took nothing"))
            before = {name for at_ns, name in self._heard if at_ns > self._last_ns - AROUND_NS}
            self._waiting = (Span(self._last_ns, log_ns, "nothing reached the recorder"), before, set())
        if self._waiting is not None:
            span, before, after = self._waiting
            after |= {topic} & before
            if log_ns > span.to_ns + AROUND_NS:
                self._waiting = None
            elif len(after) >= SPEAKERS and len(self.found) < MOST:
                self.found.append(span)
                self._waiting = None
        self._heard.append((log_ns, topic))
        self._last_ns = log_ns


def of_the_disk(notes: RecorderJson, quiet: Iterable[Span]) -> list[Span]:
    """When nothing came into the file while the recorder counted messages that the disk did not take."""
    losses = [loss for topic in notes.topics for loss in topic.get("losses", []) if loss.get("cause") == "disk"]
    edges = sorted((count(loss.get("after_ns")), count(loss.get("before_ns"))) for loss in losses)
    return [
        Span(from_ns, to_ns, span.what)
        for span in quiet
        for after_ns, before_ns in edges
        if 0 < after_ns <= before_ns
        and (to_ns := min(before_ns, span.to_ns)) - (from_ns := max(after_ns, span.from_ns)) > SILENCE_NS
    ]


def not_running(parts: list[Part]) -> list[Span]:
    """When no recorder ran between two folders of a session."""
    return [
        Span(pause.from_ns, pause.to_ns, f"no recorder ran, between {pause.before.name} and {pause.after.name}")
        for pause in pauses(parts)
        if pause.from_ns < pause.to_ns
    ]


def outages(
    notes: RecorderJson, silences: Silences, source: Source, window: Window, steps: Iterable[HostStep] = ()
) -> list[Span]:
    """All of a recording, in order and apart from each other; of several reasons that which says most.

    steps: of hosts' clocks; a silence that is one of the recorder's host is none.
    """
    own = [step for step in steps if step.host == notes.host]
    silent = [s for s in silences.found if all(step.left_of(s.from_ns, s.to_ns) > SILENCE_NS for step in own)]
    last_ns = source.last_ns
    tail = Span(last_ns, max(window.to_ns, notes.closed_ns or 0), "the disk took nothing")
    spans = [*not_running(source.parts), *of_the_disk(notes, [*silences.quiet, tail]), *silent]
    cut_off = notes.state == INTERRUPTED or any(span.to_ns >= last_ns for span in spans)
    if window.ends and cut_off and window.to_ns - last_ns > SILENCE_NS:
        spans.append(Span(last_ns, window.to_ns, "the recording had ended"))
    return joined(spans)


def joined(spans: list[Span]) -> list[Span]:
    """Those that touch as one, with the reason of the one that stands first in the list."""
    found: list[tuple[int, Span]] = []
    for rank, span in sorted(enumerate(spans), key=lambda ranked: ranked[1].from_ns):
        if found and span.from_ns <= found[-1][1].to_ns:
            best, last = found.pop()
            rank, what = min((best, last.what), (rank, span.what))
            span = Span(last.from_ns, max(last.to_ns, span.to_ns), what)
        found.append((rank, span))
    return [span for _, span in found]


def cost_samples(span: Span, raws: Iterable[RawFindings]) -> bool:
    """True where a stream has a hole there, or its last sample in it or shortly before."""
    return any(
        span.from_ns - AROUND_NS <= raw.last_log_ns < span.to_ns
        or any(hole.from_log_ns < span.to_ns and hole.to_log_ns > span.from_ns for hole in raw.holes)
        for raw in raws
        if raw.messages
    )
