"""Small pieces of the report's page: lists, cells and values as HTML. Text that came over the graph is escaped."""

from __future__ import annotations

import json
from collections.abc import Iterable
from html import escape
from typing import Any

from sense4hri_report.rules import BROKEN, COMPLETE, GAPS
from sense4hri_report.svg import clock

Json = dict[str, Any]
SHOWN = 200
"""Of a list, so many are on the page; report.json has all."""
WORDS = {COMPLETE: ("complete", "●"), GAPS: ("gaps", "◐"), BROKEN: ("broken", "○")}
FEW = 10
"""Of a long table, so many rows are seen before it is opened."""
UNKNOWN = "not known"


def fact_list(facts: Iterable[tuple[str, str]]) -> str:
    """Return names with their values; an empty value is left out."""
    return "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(str(value))}</dd></div>" for name, value in facts if value)


def bullets(items: list[str], kind: str) -> str:
    """Return sentences as a list; kind: its CSS class."""
    if not items:
        return ""
    shown = "".join(f"<li>{escape(sentence(item))}</li>" for item in items[:SHOWN])
    return f'<ul class="{kind}">{shown}</ul>{more(len(items))}'


def folded(summary: str, head: str, rows: str, total: int) -> str:
    """Return a table that is opened by a click. total: rows there are, of which SHOWN are given at most."""
    return f"<details><summary>{escape(summary)}</summary>{_table(head, rows)}{more(total)}</details>"


def shortened(rows: list[str], total: int, head: str = "") -> str:
    """Return a table whose first FEW rows are seen at once, the others with a click. total: see `folded`."""
    first = _table(head, rows[:FEW])
    if len(rows) > FEW:
        first += f"<details><summary>and {total - FEW} more</summary>{_table(head, rows[FEW:])}{more(total)}</details>"
    return first


def _table(head: str, rows: Iterable[str]) -> str:
    titles = f"<thead><tr>{head}</tr></thead>" if head else ""
    return f"<table>{titles}<tbody>{''.join(rows)}</tbody></table>"


def more(total: int) -> str:
    """Say how many of a list are not on the page."""
    return f'<p class="muted">{total - SHOWN} more are in report.json</p>' if total > SHOWN else ""


def chip(verdict: str) -> str:
    """Return a verdict with its sign."""
    kind, sign = WORDS[verdict]
    return f'<span class="chip {kind}"><span aria-hidden="true">{sign}</span>{verdict}</span>'


def count_cell(value: int | None, before: str = "") -> str:
    """Return a table cell with a count; None = not known. before: such as `~`."""
    if value is None:
        return '<td class="n zero">–</td>'
    shown = f"{before}{value:,}".replace(",", "\u202f")
    return f'<td class="n {"hit" if value else "zero"}">{shown}</td>'


def in_hz(value: float | None) -> str:
    """Return a rate; 0 = irregular, None = nothing."""
    if value is None:
        return ""
    return "irregular" if value == 0 else f"{value:.2f} Hz".replace(".00 ", " ")


def per_cent(share: float) -> str:
    """Per cent, never rounded up to a hundred."""
    return "100" if share >= 1 else f"{min(share * 100, 99.99):.2f}"


def since_start(at: Json) -> str:
    """Return a moment as time since the session began."""
    return clock(round(at["since_start_s"], 2))


def as_utc(stamp: str) -> str:
    """Return an ISO stamp as it is read."""
    return stamp.replace("T", " ").replace("Z", " UTC")


def value_text(value: object) -> str:
    """Return a value of metadata or a parameter: text as it is, else JSON."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def sentence(text: str) -> str:
    """With a capital letter, unless it begins with the name of a stream or a file."""
    return text if any(sign in text.partition(" ")[0] for sign in "/._") else f"{text[:1].upper()}{text[1:]}"


def sensor_type(entry: Json) -> str:
    """Return the sensor type of a stream's entry."""
    parts = str(entry["stream"]).split("/")
    return parts[1] if len(parts) == 3 else "other"
