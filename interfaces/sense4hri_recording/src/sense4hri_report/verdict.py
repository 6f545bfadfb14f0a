"""The verdict on a whole recording: what its streams, the session, the recorder and the clocks of hosts say."""

from __future__ import annotations

from typing import Any

from sense4hri.names import ROOT
from sense4hri_recording.reader import pauses

from sense4hri_report.collect import Findings
from sense4hri_report.outages import cost_samples, not_running
from sense4hri_report.rules import BROKEN, COMPLETE, Judgement, counted, duration
from sense4hri_report.transport import judge_transport, transport_entry
from sense4hri_report.watch import Span
from sense4hri_report.window import Json, Window, at

NEWEST_SAYS_ALL = ("/health", "/clock", "/study/session", "/study/sensors", "/study/assignments", "/study/ack")
"""Topics of which an older message tells nothing that a newer one, or the session's outcome, does not."""


def judge_all(
    found: Findings,
    session: Json | None,
    window: Window,
    judged: list[tuple[Json, Judgement]],
    place: Json,
    steps: list[Any],
) -> Judgement:
    """Judge the whole recording. judged: its streams; place: of the folder among those of its session."""
    judgement = Judgement()
    _judge_streams(judged, judgement)
    _judge_others(found, window, {entry["topic"] for entry, _ in judged}, judgement)
    _judge_recorder(found, judgement)
    _judge_outages(found, window, judgement)
    _judge_clocks(found, window, steps, judgement)
    if session is None:
        judgement.remark(
            "this is no session: what was recorded outside of one, judged from its first to its last message"
        )
    else:
        _judge_session(session, window, place, judgement)
    trouble = [found.notes.trouble] if found.notes.trouble else []
    for remark in [*trouble, *found.source.remarks, *sorted(found.unplaced), *not_recorded(found.notes.refused)]:
        judgement.remark(remark)
    return judgement


def _judge_streams(judged: list[tuple[Json, Judgement]], judgement: Judgement) -> None:
    if all(entry["verdict"] == BROKEN for entry, _ in judged):
        judgement.broken("no stream can be used" if judged else "there is no stream in it")
    for entry, own in judged:
        if entry["verdict"] == BROKEN and entry["required"]:
            judgement.broken(f"{entry['stream']}: {own.why}")
        elif entry["verdict"] != COMPLETE:
            judgement.gaps(f"{entry['stream']}: {own.why}")


def _judge_recorder(found: Findings, judgement: Judgement) -> None:
    """Whether the recorder came to its end, and what of its files cannot be read."""
    if found.notes.state == "interrupted":
        judgement.gaps("the recording was interrupted" + (f": {found.notes.why}" if found.notes.why else ""))
    elif found.notes.state == "recording":
        judgement.gaps("the recorder has not closed it: it is being recorded, or was cut off and is not repaired yet")
    for trouble in found.source.trouble:
        judgement.gaps(trouble)


def _judge_clocks(found: Findings, window: Window, steps: list[Any], judgement: Judgement) -> None:
    """Parts that begin before the one before has ended, and clocks of hosts that were set in the window."""
    for pause in pauses(found.source.parts):
        if pause.seconds < 0:
            judgement.gaps(pause.sentence)
    for step in steps:
        if window.meets(step.before_ns, step.after_ns):
            measured = found.sensor_hosts.clocks.knows(step.host)
            apart = "times before and after do not agree"
            doubt = "within seconds of it its times are less certain" if measured else apart
            set_by = f"the clock of {step.host} was set by {step.step_ns * 1e-9:+.3f} s"
            judgement.gaps(f"{set_by}, {at(step.after_ns, window)}: {doubt}")


def _judge_others(found: Findings, window: Window, streams: set[str], judgement: Judgement) -> None:
    """What lacks messages besides the streams: markers, features and states are missed, others are told together."""
    strangers, superseded = [], dict[str, int]()
    for topic in sorted({*found.notes.by_topic, *found.undecodable} - streams):
        own = Judgement()
        if undecodable := found.undecodable.get(topic):
            own.gaps(f"{counted(undecodable, 'message')} cannot be decoded")
        transport = transport_entry(found, topic, window)
        if not topic.endswith(NEWEST_SAYS_ALL):
            judge_transport(transport | {"missed_at_start": None}, window, None, own)
        elif transport["lost"]:
            superseded[topic] = transport["lost"]
        if topic.startswith((f"{ROOT}/", "/study/")):
            for problem in own.problems:
                judgement.gaps(f"{topic}: {problem.sentence}")
        elif own.problems:
            strangers.append(topic)
    if superseded:
        number, first = counted(sum(superseded.values()), "message"), next(iter(superseded))
        more = f" and {len(superseded) - 1} more" if len(superseded) > 1 else ""
        judgement.remark(f"{number} of {first}{more} sent and not recorded, of which newer ones say all: no loss")
    if strangers:
        more = f" and {len(strangers) - 1} more" if len(strangers) > 1 else ""
        judgement.remark(f"messages of {strangers[0]}{more} were lost: the topics' table says how many")


def not_recorded(refused: list[Json]) -> list[str]:
    """Return a sentence for each reason why topics could not be recorded: a stranger may have hundreds of them."""
    topics: dict[str, list[str]] = {}
    for item in refused:
        topics.setdefault(str(item.get("why")), []).append(str(item.get("topic")))
    return [
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''} could not be recorded: {why}"
        for why, names in topics.items()
    ]


def _judge_session(session: Json, window: Window, place: Json, judgement: Judgement) -> None:
    if session["failed"] is not None:
        judgement.gaps("the session failed" + (f": {session['failed']}" if session["failed"] else ""))
    set_back = 0 < (session["stop_at_ns"] or 0) < (session["start_at_ns"] or 0)
    stopped = next((phase["detail"] for phase in session["phases"] if phase["phase"] == "STOPPING"), "")
    if stopped:
        judgement.gaps(f"the session-coordinator said at the stop: {stopped}")
    elif set_back:
        judgement.gaps("by its stamps it stopped before it started: the host's clock was set back meanwhile")
    if not window.begins and not place["continues"] and not set_back:
        judgement.gaps("the session's start is not known: it is judged from the first message on")
    if not window.ends and not place["continued_in"] and not set_back:
        judgement.gaps("the session never stopped: it is judged up to the last message")
    if place["continues"]:
        pause_s = place["pause_s"]
        after = "" if pause_s is None else f", {duration(pause_s)} after the last message there"
        judgement.gaps(f"it continues the session in {place['continues']}{after}")
    if place["continued_in"]:
        pause_s = place["pause_after_s"]
        after = "" if pause_s is None else f", {duration(pause_s)} after the last message here"
        judgement.gaps(f"the session goes on in {', '.join(place['continued_in'])}{after}")
    if session["other_sessions"]:
        others = ", ".join(session["other_sessions"])
        judgement.remark(f"other sessions are in the same recording, not judged here: {others}")


def _judge_outages(found: Findings, window: Window, judgement: Judgement) -> None:
    for span in found.outages:
        seconds = (span.to_ns - span.from_ns) * 1e-9
        sentence = f"nothing was recorded for {duration(seconds)}, from {at(span.from_ns, window)}: {span.what}"
        cost = _cost(found, span)
        if cost and window.share(span.from_ns, span.to_ns):
            judgement.gaps(sentence)
        else:
            judgement.remark(sentence if cost else f"{sentence}; what came then was written later")


def _cost(found: Findings, span: Span) -> bool:
    """True where samples are missing for it; or no recorder ran, and nobody knows what else came."""
    if any(pause.from_ns < span.to_ns and pause.to_ns > span.from_ns for pause in not_running(found.source.parts)):
        return True
    return cost_samples(span, [stream.raw for stream in found.streams.values() if stream.raw is not None])
