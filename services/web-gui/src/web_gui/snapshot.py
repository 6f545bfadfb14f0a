"""The study as the JSON object the page shows. Pure; every number is finite or null, every text is just text."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from itertools import groupby
from typing import Any

from sense4hri.modalities import modality
from sense4hri.stamps import SECOND_NS

from web_gui import preflight
from web_gui.drawn import DERIVED, EVENTS
from web_gui.model import Moment, Study
from web_gui.problem_log import Entry, ProblemLog
from web_gui.readings import display_unit, further_reasons, number, rows, unit_beside
from web_gui.steady import Steady
from web_gui.stream import CLOCK_STATES, Stream
from web_gui.view import MOST_CHANNELS

MOST_ENDED, MOST_LASTING = 30, 200
MOST_EXTRA = 50

Json = dict[str, Any]


def study_message(study: Study, log: ProblemLog, now_ns: int) -> Json:
    """Return the message `study`: everything but signals and the strip."""
    return {
        "type": "study",
        "now_ms": _ms(study.axis.now_ns(now_ns)),
        "wall_ms": _ms(study.clock.wall_ns(now_ns)),
        "replay": study.axis.replaying(now_ns),
        "rate": study.axis.rate(now_ns),
        "history_s": study.history_s,
        "session": _session(study),
        "preflight": {
            "items": [item._asdict() for item in preflight.of_study(study, now_ns)],
            "bytes_per_s": round(preflight.bytes_per_s(study)),
        },
        "recorder": _recorder(study, now_ns),
        "participants": [_participant(study, human_id, now_ns) for human_id in study.humans()],
        "streams": [
            _stream(stream, now_ns) | {"notes": study.notes.get(stream.name.sensor_id, [])}
            for stream in study.ordered()
        ],
        "unseen": [{"node": driver, "why": why} for driver, why in study.unseen(now_ns).items()],
        "markers": [
            {"at_ms": _ms(m.at_ns), "name": m.name, "value": m.value, "human": m.human_id} for m in study.markers
        ],
        "problems": [_entry(entry, study.clock) for entry in log.lasting()[:MOST_LASTING]],
        "log": [_entry(entry, study.clock) for entry in log.ended()[:MOST_ENDED]],
    }


def trend_message(study: Study) -> Json:
    """Return the message `trend`: the strip at the bottom, one point per second."""
    return {
        "type": "trend",
        "span_s": study.trend_s,
        "participants": [
            {
                "id": human_id,
                "heart_rate": [[_ms(m.at_ns), _finite(m.heart_rate_bpm, 1)] for m in trend],
                "state": _stretches((m, m.state) for m in trend),
                "expression": _stretches((m, m.expression) for m in trend),
            }
            for human_id in study.humans()
            if (trend := study.trends.get(human_id))
        ],
    }


def shown_channels(stream: Stream) -> list[int]:
    """Return which channels of a stream its lane shows: of PPG the one in use, nowhere the confidence."""
    channels = stream.history.channels if stream.history else ()
    if stream.name.sensor_type == "ppg":
        used = stream.features.plain.get("channel_name") if stream.features else None
        if used in channels:
            return [channels.index(str(used))]
        return [i for i, name in enumerate(channels) if name != "ambient"][:1]
    return [i for i, name in enumerate(channels) if name != "confidence"][:MOST_CHANNELS]


def _session(study: Study) -> Json:
    session = study.session
    state = session.state
    return {
        "coordinator": session.coordinator,
        "replayed": session.replayed,
        "phase": session.phase,
        "id": state.get("session_id", ""),
        "study": state.get("study", ""),
        "task": state.get("task", ""),
        "humans": list(session.human_ids),
        "start_ms": _ms(session.start_ns),
        "checks": [check._asdict() for check in session.checks()],
        "detail": state.get("detail", ""),
        "directory": state.get("directory", ""),
        "report": session.report,
        "doubt": session.recorder.doubt,
        "unrecorded_s": round(session.recorder.unrecorded_s),
    }


def _recorder(study: Study, now_ns: int) -> Json | None:
    """Return the recorder, None where none is on the graph; whether one records that has gone silent is not known."""
    status = study.session.recorder.newest(now_ns)
    if status is not None:
        told = asdict(status)
        del told["report"]
        return told
    return {"recording": None} if "recorder" in study.services.nodes else None


def _participant(study: Study, human_id: str, now_ns: int) -> Json:
    value, note = study.heart_rate(human_id, now_ns)
    state = study.state(human_id, now_ns)
    streams = sorted(study.streams_of(human_id), key=lambda s: s.name.sensor_id)
    return {
        "id": human_id,
        "heart_rate": _finite(value, 1),
        "heart_rate_note": note,
        "state": str(state.get("state", "unknown")) if state else "unknown",
        "confidence": number(state.get("confidence")) if state else None,
        "reasons": [str(text) for text in state.get("reasons", ())] if state else ["no fused state on the graph"],
        "expression": study.expression(human_id, now_ns),
        "sensors": [
            _sensor(study, sensor_id, list(own), now_ns)
            for sensor_id, own in groupby(streams, key=lambda s: s.name.sensor_id)
        ],
    }


def _sensor(study: Study, sensor_id: str, streams: list[Stream], now_ns: int) -> Json:
    return {
        "id": sensor_id,
        "status": study.sensor_status(streams, now_ns),
        "streams": [stream.key for stream in streams],
        "battery": next(
            (b for s in streams if s.health and (b := number(s.health.plain.get("battery_percent")))), None
        ),
    }


def _stream(stream: Stream, now_ns: int) -> Json:
    features = stream.fresh_features(now_ns)
    history = stream.history
    kind = stream.name.sensor_type
    known = modality(kind)
    derived = DERIVED[kind] if stream.derived else None
    told = rows(kind, features or _absent(stream, now_ns), stream.device_values(now_ns))
    return {
        "key": stream.key,
        "human": stream.name.human_id,
        "type": kind,
        "sensor": stream.name.sensor_id,
        "unit": derived.unit if derived else display_unit(stream.info.unit if stream.info else ""),
        "channels": list(history.channels[:MOST_CHANNELS]) if history else [],
        "channels_total": len(history.channels) if history else 0,
        "shown": shown_channels(stream),
        "label": known.label,
        "stacked": known.stacked,
        "least": derived.least_span if derived else known.least_span,
        "newest_ms": _ms(history.newest_ns) if history and history.newest_ns is not None else None,
        "raw": stream.has_raw,
        "lane": stream.has_raw or stream.derived,
        "why_none": next((row["reason"] for row in told if derived and row["label"] == derived.name), ""),
        "status": stream.status(now_ns),
        "patience_s": round(stream.patience_s() + (stream.latencies[-1] if stream.latencies else 0.0), 2),
        "drawn": [{"name": one.name, "how": "tick" if derived else one.how} for one in stream.marks.kinds],
        "qualities": _qualities(stream, features),
        "interpreted": (bool(known.message) and not known.helper) or stream.features is not None,
        "quality": _finite(features.get("signal_quality") if features else None, 2),
        "rows": told,
        "reasons": further_reasons(kind, features) if features else [],
        "extra": _extra(features),
        "clock": _clock(stream, now_ns),
        "health": _health(stream, now_ns),
        "about": _about(stream),
        "preflight": [item._asdict() for item in preflight.of_stream(stream, now_ns)] if stream.has_raw else [],
    }


def _qualities(stream: Stream, features: Mapping[str, Any] | None) -> list[float | None]:
    """Return the quality of each channel in order, by `channel_quality` or its own `..._quality`; None: not told."""
    if features is None or stream.history is None:
        return []
    if stream.derived:
        return [_finite(features.get("signal_quality"), 2)]
    told = {str(item["name"]): item["values"] for item in features.get("extra", ())}
    named = dict(zip(features.get("channel_names", ()), features.get("channel_quality", ()), strict=False))
    channels = stream.history.channels[:MOST_CHANNELS]
    found = [_finite(named.get(name, told.get(f"{name}_quality")), 2) for name in channels]
    return found if any(quality is not None for quality in found) else []


def _absent(stream: Stream, now_ns: int) -> Mapping[str, Any]:
    if stream.features is None:
        return {"reasons": ["no features on the graph"]}
    return {"reasons": [f"no features for {stream.age_ns(stream.features.at_ns, now_ns) / SECOND_NS:.0f} s"]}


def _extra(features: Mapping[str, Any] | None) -> list[Json]:
    if features is None:
        return []
    return [
        {"name": str(item["name"]), "value": number(item["values"]), "unit": unit_beside(item["unit"])}
        for item in features.get("extra", ())[:MOST_EXTRA]
        if item["name"] not in EVENTS
    ]


def _clock(stream: Stream, now_ns: int) -> Json:
    if stream.history is not None and not stream.history.device_time:
        return {"state": "HOST", "note": "the device gives no time; placed by arrival on the host"}
    if stream.clock is None:
        return {"state": "NONE", "note": "no clock model on the graph; placed by arrival"}
    plain = stream.clock.plain
    state = int(plain.get("state", 0))
    age_s = stream.age_ns(stream.clock.at_ns, now_ns) / SECOND_NS
    return {
        "state": CLOCK_STATES[state] if state < len(CLOCK_STATES) and stream.fresh_clock(now_ns) else "NONE",
        "note": f"no news for {age_s:.0f} s" if age_s > 5 else "",
        "offset_s": plain["offset_ns"] / SECOND_NS,
        "skew_ppm": _finite(plain.get("skew_ppm"), 2),
        "uncertainty_ms": _scaled(plain.get("uncertainty_s"), 1e3, 2),
        "latency_ms": _scaled(plain.get("latency_s"), 1e3, 1),
        "latencies_ms": [round(1e3 * latency_s, 1) for latency_s in stream.latencies],
        "segment": plain.get("segment", 0),
        "provisional": stream.history.provisional if stream.history else True,
    }


def _health(stream: Stream, now_ns: int) -> Json | None:
    if stream.health is None:
        return None
    plain = stream.health.plain
    fresh = stream.fresh_health(now_ns) is not None
    age_s = stream.age_ns(stream.health.at_ns, now_ns) / SECOND_NS
    return {
        "stale": "" if fresh else f"no news from the driver for {age_s:.0f} s",
        "host": plain.get("host", ""),
        "nominal_hz": _finite(plain.get("nominal_rate_hz"), 1),
        "measured_hz": _finite(plain.get("measured_rate_hz"), 2) if fresh else None,
        "lost": _count(plain.get("lost_samples_total")),
        "gaps": _count(plain.get("gaps_total")),
        "duplicates": _count(plain.get("duplicates_total")),
        "reconnects": _count(plain.get("reconnects_total")),
        "battery": _finite(plain.get("battery_percent"), 0) if fresh else None,
        "rssi": _finite(plain.get("rssi_dbm"), 0) if fresh else None,
        "contact": _finite(plain.get("contact"), 0) if fresh else None,
        "reasons": [str(text) for text in plain.get("reasons", ())],
    }


def _about(stream: Stream) -> list[str]:
    if stream.info is None:
        return []
    known = stream.info.parameters
    return [str(known[key]) for key in ("vendor", "model", "serial_number", "body_location") if known.get(key)]


def _entry(entry: Entry, clock: Steady) -> Json:
    return {
        "key": entry.problem.key,
        "text": entry.problem.text,
        "severity": entry.problem.severity,
        "alert": entry.problem.alert,
        "stream": entry.problem.stream,
        "since_ms": _ms(clock.wall_ns(entry.since_ns)),
        "ended_ms": None if entry.ended_ns is None else _ms(clock.wall_ns(entry.ended_ns)),
    }


def _stretches(moments: Iterable[tuple[Moment, str]]) -> list[list[Any]]:
    """Return [from_ms, to_ms, text] of every stretch of one and the same non-empty text."""
    found: list[list[Any]] = []
    for moment, text in moments:
        at_ms, step_ms = _ms(moment.at_ns), _ms(moment.step_ns)
        if found and found[-1][2] == text and at_ms - found[-1][1] < 2.5 * step_ms:
            found[-1][1] = at_ms
        else:
            found.append([at_ms - step_ms + 1000, at_ms, text])
    return [stretch for stretch in found if stretch[2]]


def _ms(ns: int) -> int:
    return round(ns / 1e6)


def _count(value: Any) -> int | None:
    return int(value) if isinstance(value, int) and value >= 0 else None


def _scaled(value: Any, factor: float, digits: int) -> float | None:
    return round(value * factor, digits) if isinstance(value, float) and math.isfinite(value) else None


def _finite(value: Any, digits: int) -> float | None:
    found = number(value)
    return None if found is None else round(found, digits)
