"""The gaps of a stream, each with where its samples were lost."""

from __future__ import annotations

from sense4hri_report.collect import Findings, StreamFindings
from sense4hri_report.holes import Hole
from sense4hri_report.outages import not_running
from sense4hri_report.raw_findings import KEPT
from sense4hri_report.watch import Span
from sense4hri_report.window import Json, Window


def gaps(found: Findings, stream: StreamFindings, window: Window, own: Window, transport: Json) -> list[Json]:
    pauses, known = not_running(found.source.parts), bool(found.notes.by_topic)
    return [
        {
            "from": window.at(hole.from_ns),
            "to": window.at(hole.to_ns),
            "duration_s": round((hole.to_ns - hole.from_ns) * 1e-9, 4),
            "lost_samples": hole.lost,
            "estimated": hole.estimated,
            "in_session": own.share(hole.from_ns, hole.to_ns) > 0,
            "cause": _cause(hole, stream, transport, pauses, known),
        }
        for hole in (stream.raw.holes[:KEPT] if stream.raw is not None else [])
    ]


def _cause(hole: Hole, stream: StreamFindings, transport: Json, pauses: list[Span], known: bool) -> str:
    """Where the samples were lost, as far as anybody says. pauses: when no recorder ran."""
    for pause in pauses:
        if pause.from_ns < hole.to_log_ns and pause.to_ns > hole.from_log_ns:
            return f"recorder: {pause.what}"
    for loss in transport["losses"]:
        if loss["after_ns"] < hole.to_log_ns and loss["before_ns"] > hole.from_log_ns:
            return f"recorder: {loss['cause']}"
    if stream.health is not None:
        for span in stream.health.not_streaming:
            if span.from_ns <= hole.to_log_ns and span.to_ns >= hole.from_log_ns:
                return f"link: {span.what}"
    if hole.estimated and stream.raw is not None and stream.raw.has_device_time:
        return "the device restarted"
    return "before the recorder: sensor, radio or driver" if known else ""
