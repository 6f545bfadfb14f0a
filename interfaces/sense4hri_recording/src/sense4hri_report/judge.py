"""The account of one stream or topic: its entry in report.json, and what that says of its completeness."""

from __future__ import annotations

from sense4hri.names import StreamName
from sense4hri_recording.source import RecordedTopic
from sense4hri_recording.strange import why_strange

from sense4hri_report import rules
from sense4hri_report.accounts import clock_entry, contact_entry, driver_entry, rounded, sensor_facts, values_entry
from sense4hri_report.collect import Findings, Rhythm, StreamFindings, declared_hz
from sense4hri_report.driver_losses import driver_losses
from sense4hri_report.gaps import gaps
from sense4hri_report.judge_samples import judge_edges, judge_raw, judge_samples
from sense4hri_report.raw_findings import RawFindings
from sense4hri_report.rules import Judgement, counted, duration
from sense4hri_report.tails import with_tail
from sense4hri_report.transport import judge_transport, transport_entry
from sense4hri_report.window import Json, Window, at


def stream_entry(found: Findings, stream: StreamFindings, window: Window, required: str) -> tuple[Json, Judgement]:
    """One physiological stream."""
    judgement = Judgement()
    name = stream.name
    topic = name.topic("raw")
    entry: Json = {"stream": "/".join(name), "topic": topic, "required": required, "kind": "raw"}
    transport = transport_entry(found, topic, window)
    raw = stream.raw
    if raw is None or not raw.messages:
        entry |= _without_raw(found, stream, raw, required, judgement)
    else:
        _judge_recorded(found, stream, raw, window, transport, entry, judgement)
    judge_transport(transport, window, raw.first_ns if raw is not None and raw.messages else None, judgement)
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


def _judge_recorded(
    found: Findings,
    stream: StreamFindings,
    raw: RawFindings,
    window: Window,
    transport: Json,
    entry: Json,
    judgement: Judgement,
) -> None:
    """What came of a stream while its person wore it; its samples, gaps and wearer are added to the entry."""
    own = found.wearers.window_of(stream.name, window)
    judged, end = with_tail(found, stream, raw, own or window)
    unseen = driver_losses(raw, stream.health)
    entry |= _samples(raw, window, judged) | {"lost_samples_counted": sum(loss.samples for loss in unseen)}
    entry |= {"gaps": gaps(found, stream, window, judged, transport)}
    entry["worn"] = None if own is window else _worn(own, window)
    if own is None and not entry["required"]:
        judgement.remark("somebody else wore it all through the session: not judged")
    else:
        since = "the session's start" if judged.from_ns == window.from_ns else "it changed hands"
        end = end if judged.to_ns >= window.to_ns else "it changed hands"
        judge_samples(raw, unseen, entry, judged, found.outages, judgement)
        judge_edges(raw, entry, judged, since, end, judgement)
        judge_raw(raw, judged, judgement)
    _judge_wearer(found, stream.name, window, own, judgement)


def topic_entry(found: Findings, topic: str, window: Window, required: str) -> tuple[Json, Judgement]:
    """A topic that is no raw stream: one that was required, or lies under the streams' names and is none."""
    judgement = Judgement()
    seen, rhythm = found.source.topics[topic], found.rhythms[topic]
    _judge_strange(seen, judgement)
    transport = transport_entry(found, topic, window)
    rate_hz, silent_s = _rate_hz(seen), _without_steps(found, rhythm) * 1e-9
    entry: Json = {"stream": topic, "topic": topic, "required": required, "kind": "topic", "type": seen.type_name}
    entry |= {"messages": seen.messages, "measured_hz": rounded(rate_hz), "time_from": "receipt by the recorder"}
    entry |= {"first": window.at(seen.first_log_ns), "last": window.at(seen.last_log_ns)}
    entry["longest_silence"] = window.at(rhythm.silent_ns) | {"duration_s": round(silent_s, 3)}
    if seen.messages > 1 and (seen.last_log_ns < window.from_ns or seen.first_log_ns > window.to_ns):
        judgement.broken("no message came in the session")
    if rate_hz:
        limit_s = max(rules.SILENCE_S, rules.SILENCE_INTERVALS / rate_hz)
        if silent_s > limit_s and seen.messages > rules.SILENCE_INTERVALS:
            judgement.gaps(f"silent for {duration(silent_s)}, {at(rhythm.silent_ns, window)}")
        _judge_ends(seen, window, limit_s, judgement)
    undecodable = found.undecodable.get(topic, 0)
    if undecodable:
        judgement.gaps(f"{counted(undecodable, 'message')} cannot be decoded")
    judge_transport(transport, window, seen.first_log_ns, judgement)
    entry |= {"missed_at_start": transport.pop("missed_at_start"), "transport": transport}
    return _judged(entry, judgement), judgement


def _rate_hz(topic: RecordedTopic) -> float | None:
    """Messages per s from the first to the last; None where that is no time."""
    span_s = max(topic.last_log_ns - topic.first_log_ns, 0) * 1e-9
    return (topic.messages - 1) / span_s if span_s > 0 else None


def _judge_ends(topic: RecordedTopic, window: Window, limit_s: float, judgement: Judgement) -> None:
    """Whether its first and last message came within limit_s of the start and the stop."""
    late_s = (topic.first_log_ns - window.from_ns) * 1e-9
    if window.begins and late_s > limit_s:
        judgement.gaps(f"its first message came {duration(late_s)} after the start")
    early_s = (window.to_ns - topic.last_log_ns) * 1e-9
    if window.ends and early_s > limit_s and topic.messages > rules.SILENCE_INTERVALS:
        judgement.gaps(f"its last message came {duration(early_s)} before the stop")


def _without_steps(found: Findings, rhythm: Rhythm) -> int:
    """The longest silence of a topic in ns, less what the recorder's clock was set ahead in it."""
    host = found.hosts.get(found.notes.host)
    left = [step.left_of(rhythm.silent_ns, rhythm.silent_ns + rhythm.longest_ns) for step in host.steps] if host else []
    return min(left, default=rhythm.longest_ns)


def _judge_strange(topic: RecordedTopic, judgement: Judgement) -> None:
    why = why_strange(topic)
    if why and topic.name.endswith("/raw"):
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


def _samples(raw: RawFindings, window: Window, own: Window) -> Json:
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


def _without_raw(
    found: Findings, stream: StreamFindings, raw: RawFindings | None, required: str, judgement: Judgement
) -> Json:
    if raw is not None and raw.undecodable:
        judgement.broken(f"none of its {counted(raw.undecodable, 'message')} can be decoded")
        return {"messages": raw.undecodable, "samples": 0, "undecodable_messages": raw.undecodable}
    sources = [o for o in found.streams if stream.name.sensor_id == f"{o.sensor_id}_{o.sensor_type}"]
    sources.sort(key=lambda source: source.human_id != stream.name.human_id)  # of those who wore it the same person
    if sources or (stream.features is not None and stream.health is None):
        if not stream.features:
            judgement.remark("nothing was computed on it")
        return {"kind": "derived", "derived_from": "/".join(sources[0]) if sources else None, "samples": 0,
                "messages": stream.features.messages if stream.features else 0}  # fmt: skip
    reported = found.source.topics.get(stream.name.topic("device"))
    if reported and reported.messages and stream.name.topic("raw") not in found.source.topics:
        return {"kind": "device", "messages": reported.messages, "samples": 0}
    if not required and declared_hz(stream) == 0 and stream.health and stream.health.last_state == "STREAMING":
        judgement.remark("nothing came: it sends when something happens (0 Hz), and its driver was streaming")
        return {"kind": "no samples", "messages": 0, "samples": 0, "declared_hz": 0.0}
    states = sorted({span.what for span in stream.health.not_streaming}) if stream.health else []
    said = f"; its driver said {', '.join(states)}" if states else ""
    judgement.broken(f"no sample came{said}")
    return {"kind": "no samples", "messages": 0, "samples": 0}


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
