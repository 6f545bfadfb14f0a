"""The content of report.json: session, verdict, streams, events, markers, nodes, topics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sense4hri import strict_json
from sense4hri.patterns import Patterns
from sense4hri.stamps import SECOND_NS
from sense4hri_recording.errors import SessionError
from sense4hri_recording.parts import parts
from sense4hri_recording.recorder_json import number
from sense4hri_recording.source import RecordedTopic, Source, open_source
from sense4hri_recording.strange import why_strange

from sense4hri_report import rules
from sense4hri_report.collect import Findings, Marker
from sense4hri_report.judge import absent_entry, stream_entry, topic_entry
from sense4hri_report.outages import outages
from sense4hri_report.raw_findings import KEPT
from sense4hri_report.rules import Judgement, counted, duration
from sense4hri_report.verdict import judge_all
from sense4hri_report.window import Json, Window, utc

FORMAT = 1


def summarise(found: Findings, now_ns: int) -> Json:
    """Everything the report says, as JSON; null = not known."""
    session = _session(found)
    place = _parts(found.source, session)
    window = _window(found, session, place)
    steps = [step for host in found.hosts.values() for step in host.steps]
    found.outages = outages(found.notes, found.silences, found.source, window, steps)
    judged = _streams(found, window, session["required_streams"] if session else [])
    judgement = judge_all(found, session, window, judged, place, steps)
    return {
        "format": FORMAT,
        "folder": found.source.folder.name,
        "made_at": utc(now_ns),
        "verdict": judgement.verdict,
        "why": judgement.why if judgement.problems else _all_there(judged, window),
        "problems": [problem.sentence for problem in judgement.problems],
        "remarks": judgement.remarks,
        "session": session,
        "parts": place,
        "window": {"from": window.at(window.from_ns), "to": window.at(window.to_ns), "seconds": window.seconds,
                   "start_known": window.begins, "stop_known": window.ends},
        "recording": _recording(found),
        "streams": [entry for entry, _ in judged],
        "events": _events(found, window, steps),
        "host_clock_steps": [
            window.at(step.after_ns) | {"host": step.host, "step_s": step.step_ns * 1e-9} for step in steps
        ],
        "markers_total": found.markers_total,
        "markers": [_marker(marker, window) for marker in found.markers],
        "nodes": _nodes(found),
        "topics": [_topic(found, name) for name in sorted(found.source.topics)],
        "refused": found.notes.refused,
        "withheld": sorted(found.notes.withheld),
        "rules": [{"verdict": verdict, "when": when} for verdict, when in rules.RULES],
    }  # fmt: skip


def _session(found: Findings) -> Json | None:
    """The session by recorder.json, else by /study/session; None where the folder is none."""
    notes, heard = found.notes, found.sessions
    told = notes.session or {}
    if not told and (notes.says_session or not heard):
        return None
    session_id = str(told.get("session_id") or (list(heard)[-1] if heard else ""))
    known = heard.get(session_id, {})
    metadata = told.get("metadata")
    if not isinstance(metadata, dict):
        metadata = _object(known.get("metadata_json", ""))
    return {
        "session_id": session_id,
        "study": str(told.get("study") or known.get("study", "")),
        "task": str(told.get("task") or known.get("task", "")),
        "human_ids": _texts(told.get("human_ids") or known.get("human_ids")),
        "required_streams": _texts(told.get("required_streams") or known.get("required_streams")),
        "metadata": metadata,
        "start_at_ns": number(told.get("start_at_ns")) or known.get("start_at_ns"),
        "stop_at_ns": number(told.get("stop_at_ns")) or known.get("stop_at_ns"),
        "phases": [
            {"utc": utc(phase.at_ns), "phase": phase.phase, "detail": phase.detail}
            for phase in found.phases
            if phase.session_id == session_id
        ],
        "failed": next((p.detail for p in found.phases if p.session_id == session_id and p.phase == "FAILED"), None),
        "other_sessions": [other for other in heard if other != session_id],
    }


def _window(found: Findings, session: Json | None, place: Json) -> Window:
    """From the session's start to its stop; of a session in several folders this one's share of it.

    Where the clock was set back past the start, from the first message to the last, less what lies between.
    """
    start_ns = session["start_at_ns"] if session else None
    stop_ns = session["stop_at_ns"] if session else None
    source = found.source
    if place["continues"]:
        start_ns = None
    if place["continued_in"]:
        stop_ns = None
    if start_ns and stop_ns and stop_ns < start_ns:
        between = ((stop_ns, start_ns),)
        return Window(source.first_ns, source.last_ns, False, False, bool(place["continues"]), between)
    edges = start_ns or source.first_ns, stop_ns or source.last_ns
    return Window(*edges, bool(start_ns), bool(stop_ns), bool(place["continues"]))


def _marker(marker: Marker, window: Window) -> Json:
    return (
        window.at(marker.at_ns)
        | {"name": marker.name, "value": marker.value, "human_id": marker.human_id, "source": marker.source}
        | {"uncertainty_s": marker.uncertainty_s if marker.uncertainty_s >= 0 else None}
    )


def _all_there(judged: list[tuple[Json, Judgement]], window: Window) -> str:
    """The sentence of a complete recording."""
    samples = sum(entry.get("samples") or 0 for entry, _ in judged)
    where = "from the session's start to its stop" if window.begins and window.ends else "from first to last message"
    return f"nothing is missing: {counted(len(judged), 'stream')} {where}, {counted(samples, 'sample')}"


def _streams(found: Findings, window: Window, required: list[str]) -> list[tuple[Json, Judgement]]:
    """Absent ones first, then what is required, then everything else under the streams' names."""
    judged: list[tuple[Json, Judgement]] = []
    wanted: dict[str, str] = {}
    for pattern in required:
        matching = [topic for topic in sorted(found.source.topics) if Patterns([pattern]).match(topic)]
        recorded = [topic for topic in matching if found.source.topics[topic].messages]
        if not recorded:
            judged.append(absent_entry(found, pattern))
        for topic in recorded:
            wanted.setdefault(topic, pattern)
    physiological = {name.topic("raw"): stream for name, stream in sorted(found.streams.items())}
    for topic, stream in physiological.items():
        judged.append(stream_entry(found, stream, window, wanted.get(topic, "")))
    others = dict.fromkeys(sorted(topic.name for topic in _strange(found.source)), "") | wanted
    judged += [
        topic_entry(found, topic, window, pattern) for topic, pattern in others.items() if topic not in physiological
    ]
    return sorted(judged, key=lambda item: (not item[0]["required"], item[0]["kind"] != "absent"))


def _strange(source: Source) -> list[RecordedTopic]:
    return [t for t in source.topics.values() if t.messages and why_strange(t)]


def _parts(source: Source, session: Json | None) -> Json:
    """The folders this report is of, and further ones of the same session: what it continues, and where it goes on.

    pause_s, pause_after_s: between its messages and those of the folder before, and after; None where not known.
    """
    own = [part.path for part in source.parts]
    known = parts(source.folder) if session is not None and session["session_id"] else own
    first, last = known.index(own[0]), known.index(own[-1])
    before, after = known[first - 1] if first else None, known[last + 1 :]
    return {
        "folders": [folder.name for folder in own],
        "continues": before.name if before else None,
        "continued_in": [folder.name for folder in after],
        "pause_s": _pause_s(_edges(before)[1], source.first_ns) if before else None,
        "pause_after_s": _pause_s(source.last_ns, _edges(after[0])[0]) if after else None,
    }


def _edges(folder: Path) -> tuple[int, int]:
    """Receipt of the first and the last message of another folder; 0 where it cannot be read."""
    try:
        source = open_source(folder)
    except (SessionError, OSError):
        return 0, 0
    return source.first_ns, source.last_ns


def _pause_s(last_ns: int, first_ns: int) -> float | None:
    return round((first_ns - last_ns) * 1e-9, 3) if 0 < last_ns <= first_ns else None


def _recording(found: Findings) -> Json:
    notes, source = found.notes, found.source
    return {
        "files": [file.name for file in source.files],
        "repaired": [file.name for file in source.files if file.stem.endswith("_repaired")],
        "bytes": source.size_bytes,
        "messages": sum(topic.messages for topic in source.topics.values()),
        "first": utc(source.first_ns) if source.first_ns else None,
        "last": utc(source.last_ns) if source.last_ns else None,
        "seconds": (source.last_ns - source.first_ns) / SECOND_NS,
        "state": notes.state or None,
        "why": notes.why,
        "trouble": source.trouble,
        "host": notes.host or None,
        "software": notes.software,
        "notes": notes.trouble,
    }


def _events(found: Findings, window: Window, steps: list[Any]) -> list[Json]:
    """What happened to the session, in order of time: phases, notes, the recorder's word, clocks of hosts."""
    events = [(phase.at_ns, "session", _phase(phase.phase, phase.detail)) for phase in found.phases]
    events += [(m.at_ns, m.source or "note", m.value) for m in found.markers if m.name == "note"]
    events += [
        (at_ns, "recorder", str(item.get("what", "")))
        for item in found.notes.events
        if (at_ns := number(item.get("at_ns"))) is not None
    ]
    events += [
        (span.from_ns, "recorder", f"nothing recorded for {duration((span.to_ns - span.from_ns) * 1e-9)}: {span.what}")
        for span in found.outages
    ]
    events += [(move.at_ns, "wearer", str(move)) for move in found.wearers.moves(window)]
    events += [(s.after_ns, "host clock", f"{s.host}: set by {s.step_ns * 1e-9:+.3f} s") for s in steps]
    return [window.at(at_ns) | {"source": source, "what": what} for at_ns, source, what in sorted(events)[:KEPT]]


def _phase(phase: str, detail: str) -> str:
    return f"{phase}: {detail}" if detail else phase


def _nodes(found: Findings) -> list[Json]:
    """Nodes as the recorder asked them; drivers it did not ask as the registry of sensors did."""
    nodes = [_node(item) for item in found.notes.nodes]
    known = {node["node"] for node in nodes}
    for sensor in found.sensors.values():
        name, parameters = str(getattr(sensor, "node", "")), _object(str(getattr(sensor, "parameters_json", "")))
        if name and name not in known and parameters:
            known.add(name)
            nodes.append(_node({"node": name, "parameters": parameters}))
    return sorted(nodes, key=lambda node: str(node["node"]))


def _node(item: Json) -> Json:
    parameters = item.get("parameters")
    parameters = parameters if isinstance(parameters, dict) else {}
    seen_ns = number(item.get("seen_ns"))
    return {
        "node": str(item.get("node", "")),
        "seen": utc(seen_ns) if seen_ns else None,
        "software_version": parameters.get("software_version"),
        "parameters": parameters,
    }


def _topic(found: Findings, name: str) -> Json:
    topic, told = found.source.topics[name], found.notes.by_topic.get(name)
    recorded = None if told is None else number(told.get("messages")) or 0
    return {
        "topic": name,
        "type": topic.type_name,
        "messages": topic.messages,
        "messages_by_recorder": recorded,
        "lost": None if told is None else number(told.get("lost")) or 0,
        "missed_at_start": None if told is None else number(told.get("missed_at_start")) or 0,
        "undecodable": found.undecodable.get(name, 0),
    }


def _texts(value: object) -> list[str]:
    return [str(item) for item in value] if isinstance(value, list) else []


def _object(text: str) -> Json:
    try:
        content = strict_json.parse(text) if text else {}
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
