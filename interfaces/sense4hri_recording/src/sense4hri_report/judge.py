"""The account of one stream or topic: its entry in report.json, and what that says of its completeness."""

from __future__ import annotations

from collections import Counter

from sense4hri.names import StreamName
from sense4hri_recording.recorder_json import count
from sense4hri_recording.strange import why_strange

from sense4hri_report import rules
from sense4hri_report.accounts import clock_entry, contact_entry, driver_entry, rounded, sensor_facts, values_entry
from sense4hri_report.collect import Findings, StreamFindings
from sense4hri_report.outages import cost_samples, not_running
from sense4hri_report.rules import Judgement, counted, duration
from sense4hri_report.sequence import KEPT, Hole, RawAccount
from sense4hri_report.tails import with_tail
from sense4hri_report.watch import Span
from sense4hri_report.window import Json, Window, at

STANDS_IN = "the recorder's own time stands in, but for a stream's first message"
CAUSES = ("middleware", "queue", "disk")


def stream_entry(found: Findings, stream: StreamFindings, window: Window, required: str) -> tuple[Json, Judgement]:
    """One physiological stream."""
    judgement = Judgement()
    name = stream.name
    topic = name.topic("raw")
    entry: Json = {"stream": "/".join(name), "topic": topic, "required": required, "kind": "raw"}
    transport = _transport(found, topic, window)
    raw = stream.raw
    if raw is None or not raw.messages:
        entry |= _without_raw(found, stream, raw, required, judgement)
    else:
        own = found.wearers.window_of(name, window)
        judged, end = with_tail(found, stream, raw, own or window)
        entry |= _samples(raw, window, judged)
        entry |= {"gaps": _gaps(found, stream, window, judged, transport)}
        entry["worn"] = None if own is window else _worn(own, window)
        if own is None and not required:
            judgement.remark("somebody else wore it all through the session: not judged")
        else:
            since = "the session's start" if judged.from_ns == window.from_ns else "it changed hands"
            end = end if judged.to_ns >= window.to_ns else "it changed hands"
            _judge_samples(raw, entry, judged, found.outages, judgement)
            _judge_edges(raw, entry, judged, since, end, judgement)
            _judge_raw(raw, judged, judgement)
        _judge_wearer(found, name, window, own, judgement)
    _judge_transport(transport, window, raw.first_ns if raw is not None and raw.messages else None, judgement)
    if name.fault:
        judgement.gaps(f"its name breaks the contract ({name.fault}): no service followed it")
    _remark(stream, entry, judgement)
    entry |= {
        "missed_at_start": transport["missed_at_start"],
        "transport": {key: value for key, value in transport.items() if key != "missed_at_start"},
        "driver": driver_entry(stream.health, window),
        "clock": clock_entry(stream.clock, window),
        "signal_quality": values_entry(stream.features.quality) if stream.features else None,
        "features_messages": stream.features.messages if stream.features else 0,
        "battery_percent": values_entry(stream.health.battery) if stream.health else None,
        "contact": contact_entry(stream.health, window),
        "sensor": sensor_facts(stream.sensor),
    }
    return _judged(entry, judgement), judgement


def topic_entry(found: Findings, topic: str, window: Window, required: str) -> tuple[Json, Judgement]:
    """A topic that is no raw stream: one that was required, or lies under the streams' names and is none."""
    judgement = Judgement()
    seen = found.source.topics[topic]
    _judge_strange(topic, seen.type_name, judgement)
    rhythm = found.rhythms[topic]
    transport = _transport(found, topic, window)
    span_s = max(seen.last_log_ns - seen.first_log_ns, 0) * 1e-9
    rate_hz = (seen.messages - 1) / span_s if span_s > 0 else None
    entry: Json = {"stream": topic, "topic": topic, "required": required, "kind": "topic", "type": seen.type_name}
    entry |= {"messages": seen.messages, "measured_hz": rounded(rate_hz), "time_from": "receipt by the recorder"}
    entry |= {"first": window.at(seen.first_log_ns), "last": window.at(seen.last_log_ns)}
    silent_s = rhythm.longest_ns * 1e-9
    entry["longest_silence"] = window.at(rhythm.silent_ns) | {"duration_s": round(silent_s, 3)}
    if seen.messages and (seen.last_log_ns < window.from_ns or seen.first_log_ns > window.to_ns) and seen.messages > 1:
        judgement.broken("no message came in the session")
    late_s = (seen.first_log_ns - window.from_ns) * 1e-9
    if rate_hz:
        limit_s = max(rules.SILENCE_S, rules.SILENCE_INTERVALS / rate_hz)
        if silent_s > limit_s and seen.messages > rules.SILENCE_INTERVALS:
            judgement.gaps(f"silent for {duration(silent_s)}, {at(rhythm.silent_ns, window)}")
        if window.begins and late_s > limit_s:
            judgement.gaps(f"its first message came {duration(late_s)} after the start")
        early_s = (window.to_ns - seen.last_log_ns) * 1e-9
        if window.ends and early_s > limit_s and seen.messages > rules.SILENCE_INTERVALS:
            judgement.gaps(f"its last message came {duration(early_s)} before the stop")
    undecodable = found.undecodable.get(topic, 0)
    if undecodable:
        judgement.gaps(f"{counted(undecodable, 'message')} cannot be decoded")
    _judge_transport(transport, window, seen.first_log_ns, judgement)
    entry |= {"missed_at_start": transport.pop("missed_at_start"), "transport": transport}
    return _judged(entry, judgement), judgement


def _judge_strange(topic: str, type_name: str, judgement: Judgement) -> None:
    why = why_strange(topic, type_name)
    if why and topic.endswith("/raw"):
        judgement.broken(f"its samples cannot be read: {why}")
    elif why:
        judgement.gaps(f"what it says cannot be read: {why}")


def absent_entry(found: Findings, pattern: str) -> tuple[Json, Judgement]:
    """A required stream that is not in the recording."""
    judgement = Judgement()
    refused = {str(item.get("topic")): str(item.get("why")) for item in found.notes.refused}
    if pattern in refused:
        judgement.broken(f"not recorded: {refused[pattern]}")
    elif pattern in found.notes.withheld:
        judgement.broken("not recorded: withheld, because it identifies people")
    else:
        judgement.broken("it was required and never came" + (" (no topic matches)" if "*" in pattern else ""))
    entry = {"stream": pattern, "topic": pattern, "required": pattern, "kind": "absent", "messages": 0}
    return _judged(entry, judgement), judgement


def _worn(own: Window | None, window: Window) -> list[Json]:
    """The stretches of a window in which its person wore the sensor."""
    if own is None:
        return []
    edges = [own.from_ns, *(edge for away in own.away for edge in away), own.to_ns]
    return [{"from": window.at(a), "to": window.at(b)} for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _judge_wearer(found: Findings, name: StreamName, window: Window, own: Window | None, judgement: Judgement) -> None:
    if own is not None and own is not window:
        judgement.remark(f"{name.human_id} wore it for {duration(own.seconds)} of the session: judged over that alone")
    for span in found.wearers.disagreements(name):
        if window.share(span.from_ns, span.to_ns):
            since = f"for {duration((span.to_ns - span.from_ns) * 1e-9)}, from {at(span.from_ns, window)}"
            told = f"the registry named {span.what} while its samples came as {name.human_id}'s"
            judgement.gaps(f"whose it is is doubtful: {since}, {told}")


def _samples(raw: RawAccount, window: Window, own: Window) -> Json:
    """own: the part of the window in which its person wore the sensor."""
    late_s = max((raw.first_ns - own.from_ns) * 1e-9, 0.0) if own.begins else None
    early_s = max((own.to_ns - raw.last_ns) * 1e-9, 0.0) if own.ends else None
    return {
        "messages": raw.messages,
        "samples": raw.samples,
        "channels": list(raw.channels),
        "declared_hz": rounded(raw.declared_hz),
        "measured_hz": rounded(raw.measured_hz),
        "device_time": raw.has_device_time,
        "time_from": "clock models" if raw.corrected else "receipt, less the smallest delay seen",
        "first": window.at(raw.first_ns),
        "last": window.at(raw.last_ns),
        "late_start_s": rounded(late_s),
        "early_end_s": rounded(early_s),
        "lost_samples": raw.lost,
        "lost_samples_estimated": raw.lost_estimated,
        "gaps_total": len(raw.holes),
        "lost_within_messages": raw.lost_within,
        "duplicates": raw.duplicates,
        "conflicting_stamps": raw.conflicts,
        "reordered": raw.reorders,
        "backwards": raw.backwards,
        "resets": raw.resets,
        "reboots": raw.counts["reboot"],
        "clock_resets": raw.counts["clock_reset"],
        "undecodable_messages": raw.undecodable,
        "messages_with_other_clock": raw.mixed,
        "events": [
            window.at(event.at_ns) | {"kind": event.kind, "what": event.what, "in_session": own.has(event.at_ns)}
            for event in raw.events
        ],
    }


def _gaps(found: Findings, stream: StreamFindings, window: Window, own: Window, transport: Json) -> list[Json]:
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


def _judge_samples(raw: RawAccount, entry: Json, window: Window, outages: list[Span], judgement: Judgement) -> None:
    """How many of the window's samples are there; of those missing while the recorder recorded, half are too many."""
    rate_hz = raw.measured_hz or raw.rate_hz or 0.0
    expected, missing = rate_hz * window.seconds, _missing(raw, entry, window, rate_hz)
    coverage = min(max(1.0 - missing / expected, 0.0), 1.0) if expected > 0 else None
    entry |= {"missing_in_session": round(missing), "coverage": None if coverage is None else round(coverage, 6)}
    recorded = window.without((span.from_ns, span.to_ns) for span in outages if cost_samples(span, [raw]))
    wanted = rate_hz * recorded.seconds
    if raw.last_ns < window.from_ns or raw.first_ns > window.to_ns:
        which, at_ns = ("last", raw.last_ns) if raw.last_ns < window.from_ns else ("first", raw.first_ns)
        judgement.broken(f"no sample in the session: the {which} one came {at(at_ns, window)}")
    elif wanted > 0 and 1.0 - _missing(raw, entry, recorded, rate_hz) / wanted < rules.BROKEN_COVERAGE:
        judgement.broken(f"only {coverage:.1%} of the session's samples are there")
    inside = [(hole, share) for hole in raw.holes if (share := window.share(hole.from_ns, hole.to_ns)) > 0]
    if inside:
        lost = sum(hole.lost * share for hole, share in inside)
        percent = f" ({missing / expected:.2%})" if expected > 0 else ""
        about = "about " if any(hole.estimated for hole, _ in inside) else ""
        longest = duration(max((hole.to_ns - hole.from_ns) * 1e-9 for hole, _ in inside))
        number = f"{counted(len(inside), 'gap')}, {about}{counted(round(lost), 'sample')} missing{percent}"
        judgement.gaps(f"{number}, the longest {longest}")


def _missing(raw: RawAccount, entry: Json, window: Window, rate_hz: float) -> float:
    """Samples that are missing in a window, before the first and after the last one too."""
    lost = sum(hole.lost * window.share(hole.from_ns, hole.to_ns) for hole in raw.holes)
    late = (window.from_ns, raw.first_ns) if _is_late(raw, entry["late_start_s"]) else (0, 0)
    early = (raw.last_ns, window.to_ns) if _is_late(raw, entry["early_end_s"]) else (0, 0)
    edges_s = sum(window.share(*span) * (span[1] - span[0]) * 1e-9 for span in (late, early) if span[1] > span[0])
    return lost + edges_s * rate_hz


def _is_late(raw: RawAccount, seconds: float | None) -> bool:
    return (seconds or 0.0) > rules.EDGE_S + raw.frame_s


def _judge_edges(raw: RawAccount, entry: Json, window: Window, since: str, end: str, judgement: Judgement) -> None:
    """since, end: what the window's edges are called."""
    if _is_late(raw, entry["late_start_s"]):
        judgement.gaps(f"begins {duration(min(entry['late_start_s'], window.seconds))} after {since}")
    if _is_late(raw, entry["early_end_s"]):
        judgement.gaps(f"ends {duration(min(entry['early_end_s'], window.seconds))} before {end}")


def _judge_raw(raw: RawAccount, window: Window, judgement: Judgement) -> None:
    happened = Counter(event.kind for event in raw.events if window.has(event.at_ns))
    if happened["reboot"]:
        judgement.gaps(f"the device restarted {counted(happened['reboot'], 'time')}")
    if happened["clock_reset"]:
        judgement.gaps(f"the device's clock was set {counted(happened['clock_reset'], 'time')}")
    if happened["reorder"]:
        judgement.gaps(f"{counted(happened['reorder'], 'message')} came after newer ones")
    if happened["backwards"]:
        judgement.gaps(f"stamps went back {counted(happened['backwards'], 'time')}")
    if happened["conflict"]:
        judgement.gaps(f"{counted(happened['conflict'], 'message')} with other samples under a stamp that came before")
    if raw.mixed:
        judgement.gaps(f"{counted(raw.mixed, 'message')} {'without' if raw.has_device_time else 'with'} device time, "
                       "unlike the others; not counted")  # fmt: skip
    if raw.lost_within:
        judgement.gaps(
            f"{counted(raw.lost_within, 'sample')} missing inside of messages, which are stretched over them"
        )
    if raw.undecodable:
        judgement.gaps(f"{counted(raw.undecodable, 'message')} cannot be decoded")
    if happened["duplicate"]:
        judgement.remark(f"{counted(happened['duplicate'], 'message')} came again and were left out")
    if happened["channels"]:
        partly = [name for name, always in raw.channels.items() if not always]
        changed = f"its channels changed {counted(happened['channels'], 'time')}"
        if partly:
            judgement.gaps(f"{changed}: {', '.join(partly)} came for a part of the time")
        else:
            judgement.remark(f"{changed}, in their order")
    if raw.untimed:
        judgement.remark(f"{counted(raw.untimed, 'message')} without device time: taken to follow those before")
    if raw.receipts.odd:
        odd = counted(raw.receipts.odd, "receipt stamp")
        judgement.remark(f"{odd} more than an hour off the others, as where a clock was set: {STANDS_IN}")
    before = sum(window.share(hole.from_ns, hole.to_ns) <= 0 for hole in raw.holes)
    if before:
        judgement.remark(f"{counted(before, 'gap')} outside of the session")
    if raw.declared_hz and raw.measured_hz and abs(raw.measured_hz / raw.declared_hz - 1) > rules.OFF_RATE:
        judgement.remark(f"declared as {raw.declared_hz:g} Hz, measured {raw.measured_hz:.2f} Hz")
    if raw.declared_hz is None:
        judgement.remark("nobody declared its rate; gaps are judged by the rate it had")
    if not raw.has_device_time:
        judgement.remark("the device gives no time: losses below about a second cannot be seen")


def _without_raw(
    found: Findings, stream: StreamFindings, raw: RawAccount | None, required: str, judgement: Judgement
) -> Json:
    if raw is not None and raw.undecodable:
        judgement.broken(f"none of its {counted(raw.undecodable, 'message')} can be decoded")
        return {"messages": raw.undecodable, "samples": 0, "undecodable_messages": raw.undecodable}
    sources = [o for o in found.streams if stream.name.sensor_id == f"{o.sensor_id}_{o.sensor_type}"]
    if sources or (stream.features is not None and stream.health is None):
        if not stream.features:
            judgement.remark("nothing was computed on it")
        return {"kind": "derived", "derived_from": "/".join(sources[0]) if sources else None, "samples": 0,
                "messages": stream.features.messages if stream.features else 0}  # fmt: skip
    states = sorted({span.what for span in stream.health.not_streaming}) if stream.health else []
    said = f"; its driver said {', '.join(states)}" if states else ""
    judgement.broken(f"no sample came{said}")
    return {"kind": "no samples", "messages": 0, "samples": 0}


def _transport(found: Findings, topic: str, window: Window) -> Json:
    """What the recorder counted on one topic; None where it says nothing."""
    told = found.notes.by_topic.get(topic)
    if told is None:
        return {"lost": None, "missed_at_start": None, "by_cause": None, "losses": []}
    losses: list[Json] = [
        {
            "after_ns": count(item.get("after_ns")),
            "before_ns": count(item.get("before_ns")),
            "count": count(item.get("count")),
            "cause": item["cause"] if item.get("cause") in CAUSES else "not known",
        }
        for item in told.get("losses") or []
        if isinstance(item, dict)
    ]
    for loss in losses:
        at_ns = loss["after_ns"] or loss["before_ns"]
        loss["in_session"] = window.share(at_ns, loss["before_ns"]) > 0
        loss["since_start_s"] = round((at_ns - window.from_ns) * 1e-9, 3)
    causes: dict[str, int] = {}
    for loss in losses:
        causes[loss["cause"]] = causes.get(loss["cause"], 0) + loss["count"]
    lost = max(count(told.get("lost")), sum(causes.values()))
    return {"lost": lost, "missed_at_start": count(told.get("missed_at_start")), "by_cause": causes, "losses": losses}


def _judge_transport(transport: Json, window: Window, first_ns: int | None, judgement: Judgement) -> None:
    """first_ns: when the first of its messages came; None where none did."""
    if transport["lost"]:
        outside = sum(loss["count"] for loss in transport["losses"] if not loss["in_session"])
        inside = transport["lost"] - outside
        causes = ", ".join(f"{number} by the {cause}" for cause, number in sorted(transport["by_cause"].items()))
        sentence = f"{counted(inside or outside, 'message')} sent and not recorded" + (f" ({causes})" if causes else "")
        if inside:
            judgement.gaps(sentence)
        else:
            judgement.remark(f"{sentence}, outside of the session")
    if transport["missed_at_start"]:
        missed = f"{counted(transport['missed_at_start'], 'message')} sent before"
        edge_ns = window.from_ns if window.begins else window.from_ns + round(rules.EDGE_S * 1e9)
        if window.continues or (first_ns is not None and first_ns <= edge_ns):
            judgement.remark(f"{missed} {'the session' if window.begins else 'this recording'} began")
        else:
            judgement.gaps(f"{missed} the recorder listened")


def _remark(stream: StreamFindings, entry: Json, judgement: Judgement) -> None:
    health, clock = stream.health, stream.clock
    if clock is not None and clock.impossible:
        judgement.remark(f"{counted(clock.impossible, 'clock model')} that no clock has: left out")
    if stream.features is not None and stream.features.quality.median() < rules.WEAK_QUALITY:
        judgement.remark(f"signal quality is weak: median {stream.features.quality.median():.2f} of 1")
    if clock is not None and clock.messages:
        if clock.locked_share == 0:
            judgement.remark("its clock model never locked: times are less certain")
        elif clock.uncertainty_s.median() > rules.WIDE_CLOCK_S:
            judgement.remark(f"its clock is known to {clock.uncertainty_s.median() * 1e3:.0f} ms only")
    elif entry.get("device_time"):
        judgement.remark("no clock model was recorded: times are those of receipt")
    if health is None:
        if entry["kind"] == "raw":
            judgement.remark("its driver publishes no health")
        return
    if health.contact_share < rules.LITTLE_CONTACT:
        judgement.remark(f"off the skin for {1 - health.contact_share:.0%} of the time")
    if health.battery.last < rules.LOW_BATTERY_PERCENT:
        judgement.remark(f"battery at {health.battery.last:.0f} % at the end")
    reconnects = len(health.reconnects)
    if reconnects:
        judgement.remark(f"the link was lost and came back {counted(reconnects, 'time')}")
    if health.restarts:
        judgement.remark(f"the driver started afresh {counted(health.restarts, 'time')}")


def _judged(entry: Json, judgement: Judgement) -> Json:
    return entry | {
        "verdict": judgement.verdict,
        "why": judgement.why,
        "problems": [problem.sentence for problem in judgement.problems],
        "remarks": judgement.remarks,
    }
