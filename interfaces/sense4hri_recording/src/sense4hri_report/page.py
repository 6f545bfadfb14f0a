"""report.html: one file that needs no network and no script, readable on screen, dark or light, and on paper."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from sense4hri_report.collect import Findings
from sense4hri_report.drawings import timeline
from sense4hri_report.pieces import (
    SHOWN,
    UNKNOWN,
    WORDS,
    Json,
    as_utc,
    bullets,
    chip,
    count_cell,
    fact_list,
    sentence,
    shortened,
    since_start,
    value_text,
)
from sense4hri_report.rules import counted, duration
from sense4hri_report.streams_page import stream_table, streams
from sense4hri_report.style import STYLE

PRINT = "addEventListener('beforeprint',()=>document.querySelectorAll('details').forEach(d=>d.open=true))"


def page(summary: Json, found: Findings) -> str:
    """The whole page. Everything that came over the graph is escaped."""
    title = _title(summary)
    sections = [
        _head(summary, title),
        _timeline(summary, found),
        stream_table(summary),
        _happened(summary),
        streams(summary, found),
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
    said = bullets(others, "said") + bullets(summary["remarks"], "said remarks")
    return (
        f'<p class="over">{escape(summary["folder"])}</p><h1>{escape(title)}</h1>'
        f'<section class="panel verdict {kind}"><span class="sign" aria-hidden="true">{sign}</span>'
        f"<strong>{escape(summary['verdict'].capitalize())}</strong>"
        f"<div><p>{escape(sentence(summary['why']))}</p>{said}</div></section>"
        f'<section class="panel"><dl class="facts">{fact_list(_head_facts(summary))}</dl></section>'
    )


def _head_facts(summary: Json) -> Iterable[tuple[str, str]]:
    session, recording, window = summary["session"], summary["recording"], summary["window"]
    if session is not None:
        yield "participants", ", ".join(session["human_ids"]) or "nobody named"
    yield ("start" if window["start_known"] else "first message"), as_utc(window["from"]["utc"])
    yield ("stop" if window["stop_known"] else "last message"), as_utc(window["to"]["utc"])
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
        yield str(key), value_text(value)


def _timeline(summary: Json, found: Findings) -> str:
    keys = [
        ("background:linear-gradient(90deg,var(--ecg),var(--ppg))", "samples, in the modality's colour"),
        ("background:var(--ecg);opacity:.4", "before the start, after the stop"),
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


def _happened(summary: Json) -> str:
    if not summary["events"]:
        return ""
    rows = [
        f'<tr><td class="t n">{since_start(event)}</td><td class="t muted">{escape(event["source"])}</td>'
        f'<td class="fill">{escape(event["what"])}</td></tr>'
        for event in summary["events"][:SHOWN]
    ]
    table = shortened(rows, len(summary["events"]))
    return f'<h2>What happened</h2><section class="panel wide">{table}</section>'


def _markers(summary: Json) -> str:
    if not summary["markers"]:
        return ""
    rows = [
        f'<tr><td class="n t">{since_start(marker)}</td><td>{escape(marker["name"])}</td>'
        f"<td>{escape(marker['value'])}</td>"
        f'<td class="muted">{escape(marker["human_id"])}</td><td class="muted">{escape(marker["source"])}</td></tr>'
        for marker in summary["markers"][:SHOWN]
    ]
    head = '<th class="n">at</th><th>marker</th><th>value</th><th>participant</th><th>set by</th>'
    table = shortened(rows, summary["markers_total"], head)
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
        f"<tr><td><code>{escape(str(name))}</code></td><td>{escape(value_text(value))}</td></tr>"
        for name, value in sorted(parameters.items())
    )
    count = counted(len(parameters), "parameter")
    return f'<details style="margin:0"><summary>{count}</summary><table><tbody>{rows}</tbody></table></details>'


def _topics(summary: Json) -> str:
    rows = "".join(
        f'<tr><td><code>{escape(topic["topic"])}</code></td><td class="muted">{escape(topic["type"])}</td>'
        f'<td class="n">{topic["messages"]}</td>{count_cell(topic["lost"])}{count_cell(topic["missed_at_start"])}</tr>'
        for topic in summary["topics"]
    )
    counts = "".join(f'<th class="n">{word}</th>' for word in ("messages", "lost", "missed at start"))
    head = f"<th>topic</th><th>type</th>{counts}"
    withheld = summary["withheld"]
    said = [f"withheld, because it identifies people: {topic}" for topic in withheld]
    said += [f"not recorded: {item.get('topic')} ({item.get('why')})" for item in summary["refused"]]
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    fold = f'<details style="margin:0"><summary>{counted(len(summary["topics"]), "topic")}</summary>{table}</details>'
    return f'<h2>Everything that was recorded</h2><section class="panel wide">{fold}{bullets(said, "said")}</section>'


def _rules(summary: Json) -> str:
    rows = "".join(
        f'<tr><td class="t">{chip(rule["verdict"])}</td><td>{escape(rule["when"])}</td></tr>'
        for rule in summary["rules"]
    )
    about = (
        '<p class="muted">The worst rule that applies decides. Remarks (a repeated message, contact, quality, battery, '
        "a clock that never locked) change no verdict.</p>"
    )
    table = f"{about}<table><tbody>{rows}</tbody></table>"
    return f'<h2>How the verdict is made</h2><section class="panel wide">{table}</section>'
