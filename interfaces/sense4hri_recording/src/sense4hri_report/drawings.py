"""The report's pictures: the timeline of the session, and the lanes of one stream."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sense4hri.modalities import colour_of

from sense4hri_report import svg
from sense4hri_report.bins import Values
from sense4hri_report.collect import Findings, StreamFindings
from sense4hri_report.rules import duration
from sense4hri_report.svg import LEFT, RIGHT, WIDTH, TimeScale
from sense4hri_report.watch import ClockWatch

Json = dict[str, Any]
ROW, BAR, LANES = 26, 13, 3
PICTURE, SMALL = 50, 34
MOST_CHANNELS = 8
RESETS = {"reboot": "restart", "clock_reset": "clock set"}


def colour(sensor_type: str) -> str:
    """Return the style that gives an element its modality's colour."""
    return f"--c:{colour_of(sensor_type)}"


def scale_of(found: Findings, summary: Json) -> TimeScale:
    """From the earliest to the latest of recording and session; zero is the session's start."""
    begin, end = summary["window"]["from"]["ros_ns"], summary["window"]["to"]["ros_ns"]
    return TimeScale(found.axis.begin_ns, max(found.axis.end_ns, found.axis.begin_ns + 1), begin if end > begin else 0)


def timeline(found: Findings, summary: Json) -> str:
    """One row per stream; markers and steps of a host's clock cross all rows."""
    scale = scale_of(found, summary)
    rows = summary["streams"]
    labels = _labels(summary, scale)
    top = 8.0 + 13 * (1 + max((lane for _, lane, _ in labels), default=-1))
    bottom = top + ROW * max(len(rows), 1)
    window = summary["window"]
    parts = [svg.time_axis(scale, top, bottom)]
    for number, entry in enumerate(rows):
        parts.append(_row(entry, scale, top + number * ROW, window))
    for begin, end, known in (
        (scale.begin_ns, window["from"]["ros_ns"], window["start_known"]),
        (window["to"]["ros_ns"], scale.end_ns, window["stop_known"]),
    ):
        if known:
            parts.append(svg.rect(scale.x(begin), top, scale.x(end) - scale.x(begin), bottom - top, "outside"))
    for at, known, word in (
        (window["from"], window["start_known"], "start"),
        (window["to"], window["stop_known"], "stop"),
    ):
        if known:
            parts.append(svg.upright(scale.x(at["ros_ns"]), top, bottom, "edge", f"{word}: {at['utc']}"))
    parts += [
        svg.upright(scale.x(step["ros_ns"]), top, bottom, "step", f"{step['host']}: {step['step_s']:+.3f} s")
        for step in summary["host_clock_steps"]
    ]
    parts += [svg.upright(scale.x(m["ros_ns"]), top, bottom, "marker", _marker(m)) for m in _lines(summary, scale)]
    parts += [svg.text(x, top - 5 - 13 * lane, label, "marks") for x, lane, label in labels]
    return svg.svg(bottom + 22, "".join(parts), "timeline of all streams")


def _row(entry: Json, scale: TimeScale, top: float, window: Json) -> str:
    y, middle = top + (ROW - BAR) / 2, top + ROW / 2
    sign = {"complete": "●", "usable with gaps": "◐", "broken": "○"}[entry["verdict"]]
    name = entry["stream"]
    label = name if len(name) <= 31 else f"…{name[-30:]}"
    kind = {"complete": "complete", "usable with gaps": "gaps", "broken": "broken"}[entry["verdict"]]
    parts = [
        f'<g class="{kind}"><text x="2" y="{middle + 4:.1f}" style="fill:var(--v)">{sign}</text></g>',
        svg.text(18, middle + 4, label, "lane"),
        svg.rect(LEFT, y, WIDTH - LEFT - RIGHT, BAR, "track", radius=3),
    ]
    if entry["kind"] in ("absent", "no samples"):
        begin, end = scale.x(window["from"]["ros_ns"]), scale.x(window["to"]["ros_ns"])
        parts.append(svg.rect(begin, y + 0.5, end - begin, BAR - 1, "never", entry["why"], 3))
        parts.append(svg.text((begin + end) / 2, middle + 4, "never came", "small", "middle"))
    elif "first" in entry:
        parts.append(_bar(entry, scale, y, window))
        parts.append(_marks(entry, scale, middle))
    return f'<g style="{colour(_type(entry))}">{"".join(parts)}</g>'


def _bar(entry: Json, scale: TimeScale, y: float, window: Json) -> str:
    begin, end = scale.x(entry["first"]["ros_ns"]), scale.x(entry["last"]["ros_ns"])
    parts = [svg.rect(begin, y, max(end - begin, 1.5), BAR, "data", f"{entry['stream']}: {entry['why']}", 3)]
    start, stop = scale.x(window["from"]["ros_ns"]), scale.x(window["to"]["ros_ns"])
    if (entry.get("late_start_s") or 0) > 1 and begin > start:
        parts.append(svg.rect(start, y, begin - start, BAR, "hole", f"begins {duration(entry['late_start_s'])} late"))
    if (entry.get("early_end_s") or 0) > 1 and stop > end:
        parts.append(svg.rect(end, y, stop - end, BAR, "hole", f"ends {duration(entry['early_end_s'])} early"))
    spans = [(scale.x(gap["from"]["ros_ns"]), scale.x(gap["to"]["ros_ns"])) for gap in entry.get("gaps", ())]
    joined = svg.merged(spans, 2.0)
    about = _gap_titles(entry, scale, joined)
    parts += [svg.rect(a, y - 1, b - a, BAR + 2, "hole", title) for (a, b), title in zip(joined, about, strict=True)]
    return "".join(parts)


def _gap_titles(entry: Json, scale: TimeScale, joined: list[tuple[float, float]]) -> list[str]:
    """What hovering over a gap, or over many drawn as one, says."""
    titles, gaps, at = [], sorted(entry.get("gaps", ()), key=lambda gap: gap["from"]["ros_ns"]), 0
    for _, end in joined:
        count = lost = 0
        while at < len(gaps) and scale.x(gaps[at]["from"]["ros_ns"]) <= end:
            count, lost, at = count + 1, lost + gaps[at]["lost_samples"], at + 1
        titles.append(f"{count} gap{'s' * (count != 1)}, {lost} samples missing")
    return titles


def _marks(entry: Json, scale: TimeScale, middle: float) -> str:
    found: dict[tuple[int, str], list[Json]] = defaultdict(list)
    for event in entry.get("events", ()):
        kind = "reset" if event["kind"] in RESETS else "odd"
        found[round(scale.x(event["ros_ns"]) / 4), kind].append(event)
    parts = []
    for (_, kind), events in found.items():
        first = events[0]
        title = f"{len(events)} times {first['kind']}" if len(events) > 1 else f"{first['kind']}: {first['what']}"
        parts.append(svg.diamond(scale.x(first["ros_ns"]), middle, kind, title))
    return "".join(parts)


def _lines(summary: Json, scale: TimeScale) -> list[Json]:
    """The markers to draw: of those that fall on the same half px, the first."""
    lines: dict[int, Json] = {}
    for marker in summary["markers"]:
        if scale.begin_ns <= marker["ros_ns"] <= scale.end_ns:
            lines.setdefault(round(scale.x(marker["ros_ns"]) * 2), marker)
    return list(lines.values())


def _labels(summary: Json, scale: TimeScale) -> list[tuple[float, int, str]]:
    """(px, lane, label) of the markers whose label finds room; notes are in the list of what happened."""
    wanted = [(scale.x(m["ros_ns"]) - 2, _label(m)) for m in _lines(summary, scale) if m["name"] != "note"]
    return svg.places(wanted, LANES, WIDTH)


def lanes(stream: StreamFindings, entry: Json, found: Findings, summary: Json) -> str:
    """Raw signal, quality, battery and clock of one stream, one above the other over the same time."""
    scale = scale_of(found, summary)
    parts, y = _channel_lanes(stream, entry, 4.0)
    if stream.features is not None:
        y = _add_curve(parts, y, "signal quality", stream.features.quality, 1.0, "")
    if stream.health is not None:
        y = _add_curve(parts, y, "battery", stream.health.battery, 100.0, " %")
    drawn, y = _clock_lanes(stream, scale, y)
    parts.append(drawn)
    if y < 10:
        return ""
    spans = [(scale.x(gap["from"]["ros_ns"]), scale.x(gap["to"]["ros_ns"])) for gap in entry.get("gaps", ())]
    behind = [svg.time_axis(scale, 2, y)]
    behind += [svg.rect(a, 2, b - a, y - 2, "holeline") for a, b in svg.merged(spans, 1.0)]
    front = [svg.upright(scale.x(m["ros_ns"]), 2, y, "marker", _marker(m)) for m in _lines(summary, scale)]
    front += [
        svg.upright(scale.x(event["ros_ns"]), 2, y, "step", f"{event['kind']}: {event['what']}")
        for event in entry.get("events", ())[:200]
        if event["kind"] in RESETS
    ]
    body = f'<g style="{colour(stream.name.sensor_type)}">{"".join(behind + parts + front)}</g>'
    return svg.svg(y + 20, body, f"signals of {entry['stream']}")


def _channel_lanes(stream: StreamFindings, entry: Json, y: float) -> tuple[list[str], float]:
    """Return the raw signal, a lane for each channel, and where the next lane begins."""
    parts: list[str] = []
    if stream.picture is None:
        return parts, y
    unit = (entry.get("sensor") or {}).get("unit", "")
    for name, (low, high) in list(stream.picture.channels.items())[:MOST_CHANNELS]:
        path, bottom_value, top_value = svg.envelope(low, high, stream.picture.fresh, y, PICTURE)
        parts.append(_lane(y, PICTURE, name, _edge(top_value, unit), _edge(bottom_value, unit), path))
        y += PICTURE + 4
    more = len(stream.picture.channels) - MOST_CHANNELS
    if more > 0:
        parts.append(svg.text(2, y + 12, f"and {more} more channels", "small"))
        y += 18
    return parts, y


def _add_curve(parts: list[str], y: float, name: str, values: Values, top: float, unit: str) -> float:
    """Add a lane from 0 to top, where there are values; return where the next lane begins."""
    if not values.count.any():
        return y
    drawn = svg.curve(values.low, values.mean, values.high, y, SMALL, 0.0, top)
    parts.append(_lane(y, SMALL, name, f"{top:g}{unit}", f"0{unit}", drawn))
    return y + SMALL + 4


def _clock_lanes(stream: StreamFindings, scale: TimeScale, y: float) -> tuple[str, float]:
    """Return the lanes of the clock models' offset and its uncertainty, and where the next lane begins."""
    clock = stream.clock
    if clock is None or not clock.messages:
        return "", y
    parts = []
    residual_ms = _without_drift(clock)
    known = residual_ms[np.isfinite(residual_ms)]
    if len(known) > 2:
        most = max(2 * float(np.percentile(np.abs(known), 90)), 0.05)  # the warm-up may leave the picture
        drawn = svg.curve(residual_ms, residual_ms, residual_ms, y, SMALL, -most, most)
        parts.append(_lane(y, SMALL, "clock offset less drift", f"+{most:.2g} ms", f"−{most:.2g} ms", drawn))
        y += SMALL + 4
    if clock.uncertainty_s.count.any():
        parts.append(_uncertainty_lane(clock, scale, y))
        y += SMALL + 4
    return "".join(parts), y


def _without_drift(clock: ClockWatch) -> NDArray[np.float64]:
    """Return the offset in ms, less the line through that of each segment; one per column, NaN where none is known."""
    residual_ms = np.full(len(clock.uncertainty_s.count), np.nan)
    for segment in {point[0] for point in clock.points.values()}:
        at = np.array([column for column, point in clock.points.items() if point[0] == segment])
        times_ns = np.array([clock.points[c][1] for c in at.tolist()], float)
        offsets_ns = np.array([clock.points[c][2] - clock.points[int(at[0])][2] for c in at.tolist()], float)
        residual_ms[at] = offsets_ns * 1e-6
        if len(at) > 2 and np.ptp(times_ns) > 0:
            centred = times_ns - times_ns.mean()
            residual_ms[at] -= np.polyval(np.polyfit(centred * 1e-9, residual_ms[at], 1), centred * 1e-9)
        else:
            residual_ms[at] -= residual_ms[at].mean()
    return residual_ms


def _uncertainty_lane(clock: ClockWatch, scale: TimeScale, y: float) -> str:
    values = clock.uncertainty_s
    most = max(2 * values.median() * 1e3, 0.1)
    drawn = svg.curve(values.low * 1e3, values.mean * 1e3, values.high * 1e3, y, SMALL, 0.0, most)
    segments = "".join(
        svg.upright(scale.x(at_ns), y, y + SMALL, "step", f"clock segment {segment}")
        for at_ns, segment in clock.segments[1:200]
    )
    return _lane(y, SMALL, "clock uncertainty", f"{most:.2g} ms", "0", drawn + segments)


def _lane(y: float, height: float, name: str, high: str, low: str, drawn: str) -> str:
    return (
        svg.level(y + height + 2, "rule", 0)
        + svg.text(2, y + height / 2 + 4, name if len(name) < 24 else f"{name[:22]}…", "lane")
        + svg.text(LEFT - 8, y + 10, high, "small", "end")
        + svg.text(LEFT - 8, y + height - 2, low, "small", "end")
        + drawn
    )


def _edge(value: float, unit: str) -> str:
    """A value at a lane's edge: four digits, thousands apart, with its unit where that is short."""
    if not math.isfinite(value):
        return ""
    digits = max(3 - math.floor(math.log10(abs(value))), 0) if value else 0
    shown = f"{value:,.{digits}f}".replace(",", "\u202f") if 1e-4 < abs(value) < 1e7 or not value else f"{value:.4g}"
    return f"{shown} {unit.replace('^2', '²') if len(unit) < 9 else ''}".strip().replace("-", "−")


def _marker(marker: Json) -> str:
    return f"{_label(marker)} ({svg.clock(round(marker['since_start_s'], 2))})"


def _label(marker: Json) -> str:
    content = f"{marker['name']} {marker['value']}".strip()
    return content if len(content) <= 34 else f"{content[:33]}…"


def _type(entry: Json) -> str:
    parts = str(entry["stream"]).split("/")
    return parts[1] if len(parts) == 3 else "other"
