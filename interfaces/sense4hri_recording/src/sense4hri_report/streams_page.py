"""The streams on the report's page: one table of all, then each with its facts, its plot and its gaps."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from sense4hri_report.collect import Findings
from sense4hri_report.drawings import colour, lanes
from sense4hri_report.pieces import (
    SHOWN,
    UNKNOWN,
    Json,
    bullets,
    chip,
    count_cell,
    fact_list,
    folded,
    in_hz,
    per_cent,
    sensor_type,
    since_start,
)
from sense4hri_report.rules import counted, duration


def stream_table(summary: Json) -> str:
    """Return the table of all streams, a row each."""
    if not summary["streams"]:
        return ""
    heads = [
        "",
        "stream",
        "declared",
        "measured",
        "there",
        "gaps",
        "lost",
        "twice",
        "disordered",
        "resets",
        "lost on the way",
    ]
    cells = "".join(f'<th class="{"n" if i > 1 else ""}">{head}</th>' for i, head in enumerate(heads))
    rows = "".join(_stream_row(entry, i) for i, entry in enumerate(summary["streams"]))
    return (
        f'<h2>Streams</h2><section class="panel wide"><table><thead><tr>{cells}</tr></thead>'
        f'<tbody>{rows}</tbody></table></section>'
    )  # fmt: skip


def _stream_row(entry: Json, i: int) -> str:
    raw = entry["kind"] == "raw"
    coverage = entry.get("coverage")
    lost = entry.get("lost_samples")
    estimated = entry.get("lost_samples_estimated") or 0
    told = estimated + (entry.get("lost_samples_counted") or 0)
    missing = None if lost is None and not told else (lost or 0) + told
    required = ' <span class="muted">required</span>' if entry["required"] else ""
    disordered = (entry.get("reordered", 0) + entry.get("backwards", 0)) if raw else None
    return (
        f'<tr><td class="t">{chip(entry["verdict"])}</td>'
        f'<td class="stream-name"><span class="dot" style="{colour(sensor_type(entry))}"></span>'
        f'<a href="#s{i}">{escape(entry["stream"])}</a>{required}</td>'
        f'<td class="n">{in_hz(entry.get("declared_hz"))}</td><td class="n">{in_hz(entry.get("measured_hz"))}</td>'
        f'<td class="n">{"" if coverage is None else f"{per_cent(coverage)} %"}</td>'
        + count_cell(entry.get("gaps_total"))
        + count_cell(missing, "~" if estimated else "")
        + "".join(count_cell(value) for value in (entry.get("duplicates"), disordered, entry.get("resets")))
        + count_cell((entry.get("transport") or {}).get("lost"))
        + "</tr>"
    )


def streams(summary: Json, found: Findings) -> str:
    """Return a section for each stream."""
    by_key = {"/".join(name): stream for name, stream in found.streams.items()}
    parts = []
    for i, entry in enumerate(summary["streams"]):
        stream = by_key.get(entry["stream"])
        drawn = lanes(stream, entry, found, summary) if stream is not None else ""
        plot = f'<div class="plot wide">{drawn}</div>' if drawn else ""
        problems = bullets(entry["problems"], "said") + bullets(entry["remarks"], "said remarks")
        if not problems:
            problems = '<p class="muted">Nothing is missing, nothing was odd.</p>'
        parts.append(
            f'<section class="panel stream" id="s{i}"><div class="head">'
            f'<h3><span class="dot" style="{colour(sensor_type(entry))}"></span>{escape(entry["stream"])}</h3>'
            f"{chip(entry['verdict'])}</div>{problems}"
            f'<dl class="facts">{fact_list(_stream_facts(entry))}</dl>{plot}'
            f"{_gap_table(entry)}{_event_table(entry)}</section>"
        )
    return f"<h2>Stream by stream</h2>{''.join(parts)}" if parts else ""


def _stream_facts(entry: Json) -> Iterable[tuple[str, str]]:
    sensor = entry.get("sensor") or {}
    if sensor:
        yield "device", " ".join(sensor[k] for k in ("vendor", "model", "serial_number") if k in sensor)
        if "firmware_version" in sensor:
            yield "firmware", sensor["firmware_version"]
    if "first" in entry:
        yield "first sample" if entry["kind"] == "raw" else "first message", since_start(entry["first"])
        yield "last sample" if entry["kind"] == "raw" else "last message", since_start(entry["last"])
    if entry.get("samples"):
        yield "samples", f"{entry['samples']:,} in {entry['messages']:,} messages".replace(",", "\u202f")
    elif entry.get("messages"):
        yield "messages", f"{entry['messages']:,}".replace(",", "\u202f")
    if entry.get("declared_hz") is not None or entry.get("measured_hz") is not None:
        yield (
            "rate: declared, measured",
            f"{in_hz(entry.get('declared_hz')) or UNKNOWN}, {in_hz(entry.get('measured_hz')) or UNKNOWN}",
        )
    driver = entry.get("driver")
    if driver:
        lost = driver["lost_samples"]
        yield "lost, by its driver", UNKNOWN if lost is None else counted(lost, "sample")
    yield from _quality_facts(entry)
    if "topic" in entry and entry["kind"] != "absent":
        transport = entry.get("transport") or {}
        yield "on the way to the file", UNKNOWN if transport.get("lost") is None else f"{transport['lost']} lost"


def _quality_facts(entry: Json) -> Iterable[tuple[str, str]]:
    times = entry.get("clock")
    if times and times["models"]:
        uncertainty = times["uncertainty_s"]
        width = f"±{uncertainty['median'] * 1e3:.1f} ms" if uncertainty else UNKNOWN
        yield "clock", f"{width}, locked {100 * (times['locked_share'] or 0):.0f} %"
        if times["skew_ppm"] is not None:
            yield "skew", f"{times['skew_ppm']:+.1f} ppm".replace("-", "−")
        yield "clock segments", str(len(times["segments"]))
    elif entry["kind"] == "raw":
        yield "times from", entry["time_from"]
    quality = entry.get("signal_quality")
    if quality:
        yield "signal quality", f"median {quality['median']:.2f}, least {quality['min']:.2f}"
    battery = entry.get("battery_percent")
    if battery:
        yield "battery", f"{battery['first']:.0f} → {battery['last']:.0f} %"
    if entry.get("contact"):
        yield "on the skin", f"{100 * entry['contact']['share']:.0f} %"


def _gap_table(entry: Json) -> str:
    gaps = entry.get("gaps") or []
    if not gaps:
        return ""
    rows = "".join(
        f'<tr><td class="n t">{since_start(gap["from"])}</td><td class="n t">{duration(max(gap["duration_s"], 0))}</td>'
        f'<td class="n">{"~" if gap["estimated"] else ""}{gap["lost_samples"]}</td>'
        f"<td>{escape(gap['cause'])}{'' if gap['in_session'] else ' (outside of the session)'}</td></tr>"
        for gap in gaps[:SHOWN]
    )
    head = '<th class="n">from</th><th class="n">for</th><th class="n">samples</th><th>lost where</th>'
    return folded(f"{counted(entry['gaps_total'], 'gap')}", head, rows, entry["gaps_total"])


def _event_table(entry: Json) -> str:
    events = entry.get("events") or []
    if not events:
        return ""
    rows = "".join(
        f'<tr><td class="n t">{since_start(event)}</td><td class="t">{escape(event["kind"])}</td>'
        f"<td>{escape(event['what'])}</td></tr>"
        for event in events[:SHOWN]
    )
    head = '<th class="n">at</th><th>what</th><th></th>'
    return folded(counted(len(events), "event"), head, rows, len(events))
