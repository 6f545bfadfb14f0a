"""Small drawings as SVG text: lanes over one axis of time. Colours are the page's CSS variables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

Floats = NDArray[np.float64]

LEFT, RIGHT, WIDTH = 214, 14, 1140
STEPS_S = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 86400)
LARGEST = 1e30  # a number beyond that is no measurement, and the difference of two may be infinite
LETTER = 6.1  # about the width of one, in px


@dataclass(frozen=True)
class TimeScale:
    """ROS time to px. zero_ns: what the axis calls 0."""

    begin_ns: int
    end_ns: int
    zero_ns: int

    def x(self, at_ns: float) -> float:
        """Px of a time, kept inside of the drawing."""
        share = (at_ns - self.begin_ns) / max(self.end_ns - self.begin_ns, 1)
        return LEFT + min(max(share, 0.0), 1.0) * (WIDTH - LEFT - RIGHT)

    def ticks(self) -> list[tuple[float, str]]:
        """(px, label) of about ten round times."""
        span_s = (self.end_ns - self.begin_ns) / SECOND_NS
        step_s = next((step for step in STEPS_S if span_s / step <= 11), 86400)
        first = math.ceil((self.begin_ns - self.zero_ns) / SECOND_NS / step_s)
        last = math.floor((self.end_ns - self.zero_ns) / SECOND_NS / step_s)
        steps = [i * step_s for i in range(first, min(last, first + 60) + 1)]
        return [(self.x(self.zero_ns + step * SECOND_NS), clock(step)) for step in steps]


def clock(seconds: float) -> str:
    """`0`, `0.5`, `1:05`, `1:00:00`, with a minus before the zero."""
    sign, seconds = ("−" if seconds < -1e-9 else ""), abs(seconds)
    if seconds < 60:
        return f"{sign}{seconds:g} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{sign}{minutes}:{rest:02d}" if minutes < 60 else f"{sign}{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def svg(height: float, body: str, label: str) -> str:
    """A whole drawing; label: what a screen reader says."""
    return (
        f'<svg viewBox="0 0 {WIDTH} {height:g}" role="img" aria-label="{escape(label)}" '
        f'xmlns="http://www.w3.org/2000/svg">{body}</svg>'
    )


def text(x: float, y: float, content: str, kind: str = "", anchor: str = "start") -> str:
    """One line of text; content is escaped."""
    return f'<text x="{x:.1f}" y="{y:.1f}" class="{kind}" text-anchor="{anchor}">{escape(content)}</text>'


def rect(x: float, y: float, width: float, height: float, kind: str, title: str = "", radius: float = 0) -> str:
    """A box, with a title that shows on hovering."""
    corner = f' rx="{radius:g}"' if radius else ""
    inside = f"<title>{escape(title)}</title>" if title else ""
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{height:.1f}" class="{kind}"{corner}>'
        f"{inside}</rect>"
    )


def upright(x: float, top: float, bottom: float, kind: str, title: str = "") -> str:
    """A vertical line."""
    inside = f"<title>{escape(title)}</title>" if title else ""
    return f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{top:.1f}" y2="{bottom:.1f}" class="{kind}">{inside}</line>'


def level(y: float, kind: str, left: float = LEFT) -> str:
    """A horizontal line over the whole width."""
    return f'<line x1="{left:.1f}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" class="{kind}"/>'


def diamond(x: float, y: float, kind: str, title: str) -> str:
    """A mark for something that happened at once."""
    points = f"M{x:.1f} {y - 6:.1f}l5 6l-5 6l-5-6z"
    return f'<path d="{points}" class="{kind}"><title>{escape(title)}</title></path>'


def time_axis(scale: TimeScale, top: float, bottom: float) -> str:
    """Grid lines from top to bottom and their labels below."""
    parts = []
    for x, label in scale.ticks():
        parts.append(upright(x, top, bottom, "grid"))
        parts.append(text(x, bottom + 14, label, "tick", "middle"))
    return "".join(parts)


def merged(spans: Iterable[tuple[float, float]], least: float) -> list[tuple[float, float]]:
    """Spans in px, each at least so wide, joined where they touch: a thousand gaps need not be a thousand boxes."""
    out: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        end = max(end, begin + least)
        if out and begin <= out[-1][1] + 0.5:
            out[-1] = (out[-1][0], max(out[-1][1], end))
        else:
            out.append((begin, end))
    return out


def envelope(
    low: Floats, high: Floats, fresh: NDArray[np.bool_], top: float, height: float
) -> tuple[str, float, float]:
    """The path of a raw signal, and the values at its lower and upper edge. Interrupted where samples are missing."""
    known = np.flatnonzero((np.abs(low) < LARGEST) & (np.abs(high) < LARGEST))
    if not len(known):
        return "", math.nan, math.nan
    bottom_value, top_value = float(np.percentile(low[known], 0.5)), float(np.percentile(high[known], 99.5))
    if top_value <= bottom_value:
        middle = 0.5 * (top_value + bottom_value)
        bottom_value, top_value = middle - 0.5, middle + 0.5
    usual = max(float(np.median(np.diff(known))), 1.0) if len(known) > 1 else 1.0
    unit = (WIDTH - LEFT - RIGHT) / len(low)

    def y(values: Floats) -> Floats:
        share = np.clip((values - bottom_value) / (top_value - bottom_value), 0, 1)
        return top + height - 2 - share * (height - 4)

    xs, upper, lower = LEFT + (known + 0.5) * unit, y(high[known]), y(low[known])
    broken = np.concatenate([[True], (np.diff(known) > 3 * usual) | (fresh[known[1:]] & (np.diff(known) > 1))])
    path: list[str] = []
    for x, a, b, new in zip(xs.tolist(), upper.tolist(), lower.tolist(), broken.tolist(), strict=True):
        if path and path[-1] != "M" and not new:
            path.append(f"L{x:.1f} {a:.1f}")
        else:
            path.append(f"M{x:.1f} {a:.1f}")
        path.append(f"V{b + (0.6 if b - a < 0.6 else 0):.1f}")
    return f'<path d="{"".join(path)}" class="wave"/>', bottom_value, top_value


def curve(
    low: Floats, mean: Floats, high: Floats, top: float, height: float, bottom_value: float, top_value: float
) -> str:
    """A quantity told now and then: a line, and a band from its smallest to its largest. Silence breaks it."""
    known = np.flatnonzero(np.isfinite(mean))
    if not len(known):
        return ""
    unit = (WIDTH - LEFT - RIGHT) / len(mean)
    usual = max(float(np.median(np.diff(known))), 1.0) if len(known) > 1 else 1.0
    span = max(top_value - bottom_value, 1e-12)

    def y(values: Floats) -> list[float]:
        return (top + height - 2 - np.clip((values - bottom_value) / span, 0, 1) * (height - 4)).tolist()

    runs = np.split(np.arange(len(known)), np.flatnonzero(np.diff(known) > max(10.0, 5 * usual)) + 1)
    xs = (LEFT + (known + 0.5) * unit).tolist()
    middle, upper, lower = y(mean[known]), y(high[known]), y(low[known])
    parts = []
    for run in runs:
        there = " L".join(f"{xs[i]:.1f} {upper[i]:.1f}" for i in run)
        back = " L".join(f"{xs[i]:.1f} {lower[i]:.1f}" for i in run[::-1])
        line = " L".join(f"{xs[i]:.1f} {middle[i]:.1f}" for i in run)
        dot = " h0.1" if len(run) == 1 else ""
        parts.append(f'<path d="M{there} L{back}Z" class="band"/><path d="M{line}{dot}" class="curve"/>')
    return "".join(parts)


def places(wanted: Sequence[tuple[float, str]], lanes: int, right: float = WIDTH) -> list[tuple[float, int, str]]:
    """Labels that do not overlap: (px, lane, label); those that fit nowhere are left out."""
    ends = [0.0] * lanes
    out = []
    for x, label in sorted(wanted):
        width = len(label) * LETTER + 8
        start = min(x, right - width)
        for lane in range(lanes):
            if ends[lane] <= start:
                ends[lane] = start + width
                out.append((start, lane, label))
                break
    return out
