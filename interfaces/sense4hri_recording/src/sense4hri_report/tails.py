"""Where a stream should have ended: outside of a session nobody says so but the recorder and its driver."""

from __future__ import annotations

from sense4hri_report import rules
from sense4hri_report.collect import Findings, StreamFindings
from sense4hri_report.raw_findings import RawFindings
from sense4hri_report.rules import counted
from sense4hri_report.window import Window

STREAMING = "STREAMING"
BACKLOG_NS = 600_000_000_000
"""The recorder closes a file so soon after its last message, even where it discarded what it had not written yet."""


def with_tail(found: Findings, stream: StreamFindings, raw: RawFindings, own: Window) -> tuple[Window, str]:
    """A window up to where the stream's samples are missed, and what its end is called in a sentence.

    The session's stop, where it is known. Else the recording's end where the driver sent, or said that it streamed, to
    the last: what ends more than rules.TAIL_S before that was lost. Else nobody knows, and nothing is missed.
    """
    if own.ends:
        return own, "the session's stop"
    last_ns, closed_ns, health = found.source.last_ns, found.notes.closed_ns or 0, stream.health
    end_ns = closed_ns if 0 < closed_ns - last_ns < BACKLOG_NS else last_ns
    tail_s = (end_ns - raw.last_log_ns) * 1e-9
    if health is None or tail_s < rules.TAIL_S + 10 * raw.frame_s:
        return own, ""
    sent = health.sent_since_raw
    if sent > (raw.measured_hz or raw.rate_hz or 1.0) * 2 * rules.EDGE_S:
        why = f"the recording's end; meanwhile its driver sent about {counted(sent, 'sample')}"
    elif health.last_state == STREAMING:
        why = "the recording's end; the last that its driver said is that it streams"
    else:
        return own, ""
    return own._replace(to_ns=max(end_ns, own.to_ns), ends=True), why
