"""report.html: one file that needs no network and no script, readable on screen, dark or light, and on paper."""

from __future__ import annotations

import json
from collections.abc import Iterable
from html import escape
from typing import Any

from sense4hri_report.collect import Findings
from sense4hri_report.drawings import colour, lanes, timeline
from sense4hri_report.rules import BROKEN, COMPLETE, GAPS, counted, duration
from sense4hri_report.style import STYLE
from sense4hri_report.svg import clock

Json = dict[str, Any]
SHOWN = 200
WORDS = {COMPLETE: ("complete", "●"), GAPS: ("gaps", "◐"), BROKEN: ("broken", "○")}
PRINT = "addEventListener('beforeprint',()=>document.querySelectorAll('details').forEach(d=>d.open=true))"
UNKNOWN = "not known"


def page(summary: Json, found: Findings) -> str:
    """The whole page. Everything that came over the graph is escaped."""
    title = _title(summary)
    sections = [
        _head(summary, title),
        _timeline(summary, found),
        _stream_table(summary),
        _happened(summary),
        _streams(summary, found),
        _markers(summary),
        _nodes(summary),
        _topics(summary),
        _rules(summary),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}: {summary['verdict']}</title>"
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<style>{STYLE}</style></head><body><main>{''.join(sections)}"
        f'<p class="foot">Made {escape(summary["made_at"])} by Sense4HRI. The same as data: <code>report.json</code>. '
        "Times are ROS time, corrected by the clock models where a stream has them.</p></main>"
        f"<script>{PRINT}</script></body></html>\n"
    )


def _title(summary: Json) -> str:
    session = summary["session"]
    if session is None:
        return f"Recording {summary['folder']}"
    return " · ".join(filter(None, (session["study"], session["session_id"], session["task"]))) or summary["folder"]


def _head(summary: Json, title: str) -> str:
    kind, sign = WORDS[summary["verdict"]]
    others = [p for p in summary["problems"] if p != summary["why"]]
    said = _list(others, "said") + _list(summary["remarks"], "said remarks")
    return (
        f'<p class="over">{escape(summary["folder"])}</p><h1>{escape(title)}</h1>'
        f'<section class="panel verdict {kind}"><span class="sign" aria-hidden="true">{sign}</span>'
        f"<strong>{escape(summary['verdict'].capitalize())}</strong>"
        f"<div><p>{escape(_sentence(summary['why']))}</p>{said}</div></section>"
        f'<section class="panel"><dl class="facts">{_facts(_head_facts(summary))}</dl></section>'
    )


def _head_facts(summary: Json) -> Iterable[tuple[str, str]]:
    session, recording, window = summary["session"], summary["recording"], summary["window"]
    if session is not None:
        yield "participants", ", ".join(session["human_ids"]) or "nobody named"
    yield ("start" if window["start_known"] else "first message"), _when(window["from"]["utc"])
    yield ("stop" if window["stop_known"] else "last message"), _when(window["to"]["utc"])
    yield "length", duration(window["seconds"])
    verdicts = [entry["verdict"] for entry in summary["streams"]]
    yield "streams", ", ".join(f"{verdicts.count(word)} {word}" for word in WORDS if word in verdicts) or "none"
    samples = sum(entry.get("samples") or 0 for entry in summary["streams"])
    yield "samples", f"{samples:,}".replace(",", "\u202f")
    yield "markers", str(summary["markers_total"])
    lost = [topic["lost"] for topic in summary["topics"] if topic["lost"] is not None]
    yield "lost on the way to the file", counted(sum(lost), "message") if lost else UNKNOWN
    yield (
        "files",
        f"{counted(len(recording['files']), 'file')}, {recording['bytes'] / 1e6:.1f} MB"
        + (", repaired" if recording["repaired"] else ""),
    )
    if recording["state"]:
        yield "closed", {"complete": "properly", "interrupted": "no: interrupted"}.get(recording["state"], "not yet")
    if recording["software"]:
        yield "recorded by", ", ".join(f"{key} {value}" for key, value in recording["software"].items() if value)
    if recording["host"]:
        yield "on", recording["host"]
    for key, value in list(session["metadata"].items() if session else ())[:12]:
        yield str(key), value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _timeline(summary: Json, found: Findings) -> str:
    keys = [
        ("background:linear-gradient(90deg,var(--ecg),var(--ppg))", "samples, in the modality's colour"),
        ("background:var(--hole)", "missing"),
        ("background:var(--bad);width:9px;border-radius:0;transform:rotate(45deg) scale(.8)", "restart, clock set"),
        (
            "background:var(--wait);width:9px;border-radius:0;transform:rotate(45deg) scale(.8)",
            "repeated, out of order",
        ),
        ("background:var(--marker);width:2px", "marker"),
        ("background:var(--text);width:2px", "start, stop"),
    ]
    key = "".join(f'<span><i style="{style}"></i>{word}</span>' for style, word in keys)
    return (
        '<h2>Timeline</h2><section class="panel timeline"><div class="wide">'
        f'{timeline(found, summary)}</div><div class="key">{key}</div></section>'
    )


def _stream_table(summary: Json) -> str:
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
        "on the way",
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
    missing = None if lost is None and not estimated else (lost or 0) + estimated
    required = ' <span class="muted">required</span>' if entry["required"] else ""
    disordered = (entry.get("reordered", 0) + entry.get("backwards", 0)) if raw else None
    return (
        f'<tr><td class="t">{_chip(entry["verdict"])}</td>'
        f'<td><span class="dot" style="{colour(_type(entry))}"></span>'
        f'<a href="#s{i}">{escape(entry["stream"])}</a>{required}</td>'
        f'<td class="n">{_hz(entry.get("declared_hz"))}</td><td class="n">{_hz(entry.get("measured_hz"))}</td>'
        f'<td class="n">{"" if coverage is None else f"{_floor(coverage)} %"}</td>'
        + _count(entry.get("gaps_total"))
        + _count(missing, "~" if estimated else "")
        + "".join(_count(value) for value in (entry.get("duplicates"), disordered, entry.get("resets")))
        + _count((entry.get("transport") or {}).get("lost"))
        + "</tr>"
    )


def _happened(summary: Json) -> str:
    if not summary["events"]:
        return ""
    rows = "".join(
        f'<tr><td class="t n">{_since(event)}</td><td class="t muted">{escape(event["source"])}</td>'
        f'<td class="fill">{escape(event["what"])}</td></tr>'
        for event in summary["events"][:SHOWN]
    )
    more = _more(len(summary["events"]))
    return f'<h2>What happened</h2><section class="panel wide"><table><tbody>{rows}</tbody></table>{more}</section>'


def _streams(summary: Json, found: Findings) -> str:
    by_key = {"/".join(name): stream for name, stream in found.streams.items()}
    parts = []
    for i, entry in enumerate(summary["streams"]):
        stream = by_key.get(entry["stream"])
        drawn = lanes(stream, entry, found, summary) if stream is not None else ""
        plot = f'<div class="plot wide">{drawn}</div>' if drawn else ""
        problems = _list(entry["problems"], "said") + _list(entry["remarks"], "said remarks")
        if not problems:
            problems = '<p class="muted">Nothing is missing, nothing was odd.</p>'
        parts.append(
            f'<section class="panel stream" id="s{i}"><div class="head">'
            f'<h3><span class="dot" style="{colour(_type(entry))}"></span>{escape(entry["stream"])}</h3>'
            f"{_chip(entry['verdict'])}</div>{problems}"
            f'<dl class="facts">{_facts(_stream_facts(entry))}</dl>{plot}'
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
        yield "first sample" if entry["kind"] == "raw" else "first message", _since(entry["first"])
        yield "last sample" if entry["kind"] == "raw" else "last message", _since(entry["last"])
    if entry.get("samples"):
        yield "samples", f"{entry['samples']:,} in {entry['messages']:,} messages".replace(",", "\u202f")
    elif entry.get("messages"):
        yield "messages", f"{entry['messages']:,}".replace(",", "\u202f")
    if entry.get("declared_hz") is not None or entry.get("measured_hz") is not None:
        yield (
            "rate: declared, measured",
            f"{_hz(entry.get('declared_hz')) or UNKNOWN}, {_hz(entry.get('measured_hz')) or UNKNOWN}",
        )
    driver = entry.get("driver")
    if driver and driver["lost_samples"] is not None:
        yield "lost, by its driver", counted(driver["lost_samples"], "sample")
    yield from _quality_facts(entry)
    if "topic" in entry and entry["kind"] != "absent":
        transport = entry.get("transport") or {}
        yield "on the way to the file", UNKNOWN if transport.get("lost") is None else f"{transport['lost']} lost"


def _quality_facts(entry: Json) -> Iterable[tuple[str, str]]:
    times = entry.get("clock")
    if times and times["models"]:
        uncertainty = times["uncertainty_s"]
        width = f"±{uncertainty['median'] * 1e3:.1f} ms" if uncertainty else UNKNOWN
        yield "clock", f"{width}, locked {times['locked_share'] or 0:.0%}"
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
        yield "on the skin", f"{entry['contact']['share']:.0%}"


def _gap_table(entry: Json) -> str:
    gaps = entry.get("gaps") or []
    if not gaps:
        return ""
    rows = "".join(
        f'<tr><td class="n t">{_since(gap["from"])}</td><td class="n t">{duration(max(gap["duration_s"], 0))}</td>'
        f'<td class="n">{"~" if gap["estimated"] else ""}{gap["lost_samples"]}</td>'
        f"<td>{escape(gap['cause'])}{'' if gap['in_session'] else ' (outside of the session)'}</td></tr>"
        for gap in gaps[:SHOWN]
    )
    head = '<th class="n">from</th><th class="n">for</th><th class="n">samples</th><th>lost where</th>'
    return _folded(f"{counted(entry['gaps_total'], 'gap')}", head, rows, entry["gaps_total"])


def _event_table(entry: Json) -> str:
    events = entry.get("events") or []
    if not events:
        return ""
    rows = "".join(
        f'<tr><td class="n t">{_since(event)}</td><td class="t">{escape(event["kind"])}</td>'
        f"<td>{escape(event['what'])}</td></tr>"
        for event in events[:SHOWN]
    )
    head = '<th class="n">at</th><th>what</th><th></th>'
    return _folded(counted(len(events), "event"), head, rows, len(events))


def _markers(summary: Json) -> str:
    if not summary["markers"]:
        return ""
    rows = "".join(
        f'<tr><td class="n t">{_since(marker)}</td><td>{escape(marker["name"])}</td><td>{escape(marker["value"])}</td>'
        f'<td class="muted">{escape(marker["human_id"])}</td><td class="muted">{escape(marker["source"])}</td></tr>'
        for marker in summary["markers"][:SHOWN]
    )
    head = '<th class="n">at</th><th>marker</th><th>value</th><th>participant</th><th>set by</th>'
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{_more(summary['markers_total'])}"
    return f'<h2>Markers</h2><section class="panel wide">{table}</section>'


def _nodes(summary: Json) -> str:
    if not summary["nodes"]:
        about = '<p class="muted">Versions and parameters of the nodes are not known: no node was asked for them.</p>'
        return f'<h2>Nodes</h2><section class="panel">{about}</section>'
    rows = "".join(
        f"<tr><td><code>{escape(node['node'])}</code></td><td>{escape(str(node['software_version'] or UNKNOWN))}</td>"
        f"<td>{_parameters(node['parameters'])}</td></tr>"
        for node in summary["nodes"]
    )
    head = "<th>node</th><th>version</th><th>parameters</th>"
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f'<h2>Nodes</h2><section class="panel wide">{table}</section>'


def _parameters(parameters: Json) -> str:
    if not parameters:
        return f'<span class="muted">{UNKNOWN}</span>'
    rows = "".join(
        f"<tr><td><code>{escape(str(name))}</code></td><td>{escape(_value(value))}</td></tr>"
        for name, value in sorted(parameters.items())
    )
    count = counted(len(parameters), "parameter")
    return f'<details style="margin:0"><summary>{count}</summary><table><tbody>{rows}</tbody></table></details>'


def _topics(summary: Json) -> str:
    rows = "".join(
        f'<tr><td><code>{escape(topic["topic"])}</code></td><td class="muted">{escape(topic["type"])}</td>'
        f'<td class="n">{topic["messages"]}</td>{_count(topic["lost"])}{_count(topic["missed_at_start"])}</tr>'
        for topic in summary["topics"]
    )
    counts = "".join(f'<th class="n">{word}</th>' for word in ("messages", "lost", "missed at start"))
    head = f"<th>topic</th><th>type</th>{counts}"
    withheld = summary["withheld"]
    said = [f"withheld, because it identifies people: {topic}" for topic in withheld]
    said += [f"not recorded: {item.get('topic')} ({item.get('why')})" for item in summary["refused"]]
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    fold = f'<details style="margin:0"><summary>{counted(len(summary["topics"]), "topic")}</summary>{table}</details>'
    return f'<h2>Everything that was recorded</h2><section class="panel wide">{fold}{_list(said, "said")}</section>'


def _rules(summary: Json) -> str:
    rows = "".join(
        f'<tr><td class="t">{_chip(rule["verdict"])}</td><td>{escape(rule["when"])}</td></tr>'
        for rule in summary["rules"]
    )
    about = (
        '<p class="muted">The worst rule that applies decides. Remarks (a repeated message, contact, quality, battery, '
        "a clock that never locked) change no verdict.</p>"
    )
    table = f"{about}<table><tbody>{rows}</tbody></table>"
    return f'<h2>How the verdict is made</h2><section class="panel wide">{table}</section>'


def _facts(facts: Iterable[tuple[str, str]]) -> str:
    return "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(str(value))}</dd></div>" for name, value in facts if value)


def _list(items: list[str], kind: str) -> str:
    if not items:
        return ""
    shown = "".join(f"<li>{escape(_sentence(item))}</li>" for item in items[:SHOWN])
    return f'<ul class="{kind}">{shown}</ul>{_more(len(items))}'


def _folded(summary: str, head: str, rows: str, total: int) -> str:
    return (
        f"<details><summary>{escape(summary)}</summary><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        f"{_more(total)}</details>"
    )


def _more(total: int) -> str:
    return f'<p class="muted">{total - SHOWN} more are in report.json</p>' if total > SHOWN else ""


def _chip(verdict: str) -> str:
    kind, sign = WORDS[verdict]
    return f'<span class="chip {kind}"><span aria-hidden="true">{sign}</span>{verdict}</span>'


def _count(value: int | None, before: str = "") -> str:
    if value is None:
        return '<td class="n zero">–</td>'
    shown = f"{before}{value:,}".replace(",", "\u202f")
    return f'<td class="n {"hit" if value else "zero"}">{shown}</td>'


def _hz(value: float | None) -> str:
    if value is None:
        return ""
    return "irregular" if value == 0 else f"{value:.2f} Hz".replace(".00 ", " ")


def _floor(share: float) -> str:
    """Per cent, never rounded up to a hundred."""
    return "100" if share >= 1 else f"{min(share * 100, 99.99):.2f}"


def _since(at: Json) -> str:
    return clock(round(at["since_start_s"], 2))


def _when(stamp: str) -> str:
    return stamp.replace("T", " ").replace("Z", " UTC")


def _value(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _sentence(text: str) -> str:
    """With a capital letter, unless it begins with the name of a stream."""
    return text if "/" in text.partition(" ")[0] else f"{text[:1].upper()}{text[1:]}"


def _type(entry: Json) -> str:
    parts = str(entry["stream"]).split("/")
    return parts[1] if len(parts) == 3 else "other"
