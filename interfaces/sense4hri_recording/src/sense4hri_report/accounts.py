"""What others said of a stream, as entries of report.json: its driver, clock-sync and the registry of sensors."""

from __future__ import annotations

import math
from typing import Any

from sense4hri_report.raw_findings import KEPT
from sense4hri_report.watch import ClockWatch, HealthWatch, Span
from sense4hri_report.window import Json, Window


def driver_entry(health: HealthWatch | None, window: Window) -> Json | None:
    """The driver's own account, of the time of the recording."""
    if health is None:
        return None
    return {
        "host": health.host,
        "samples": health.counted("samples_total"),
        "lost_samples": health.counted("lost_samples_total"),
        "gaps": health.counted("gaps_total"),
        "duplicates": health.counted("duplicates_total"),
        "reconnects": health.counted("reconnects_total"),
        "reconnects_at": [window.at(at_ns) for at_ns in health.reconnects[:KEPT]],
        "restarts": health.restarts,
        "not_streaming": [span_entry(span, window) for span in health.not_streaming[:KEPT]],
        "rssi_dbm": values_entry(health.rssi),
        "latency_s": values_entry(health.latency),
    }


def clock_entry(clock: ClockWatch | None, window: Window) -> Json | None:
    """What clock-sync said of the stream while it was recorded; None where nothing came."""
    if clock is None:
        return None
    return {
        "models": clock.messages,
        "locked_share": rounded(clock.locked_share),
        "uncertainty_s": values_entry(clock.uncertainty_s),
        "latency_s": values_entry(clock.latency_s),
        "skew_ppm": rounded(clock.skew_ppm),
        "segments": [window.at(at_ns) | {"segment": segment} for at_ns, segment in clock.segments[:KEPT]],
        "not_locked": [span_entry(span, window) for span in clock.unlocked[:KEPT]],
    }


def contact_entry(health: HealthWatch | None, window: Window) -> Json | None:
    """The share of the driver's accounts that say `on the skin`, and when not; None where it is not known."""
    if health is None or math.isnan(health.contact_share):
        return None
    return {
        "share": rounded(health.contact_share),
        "off": [span_entry(span, window) for span in health.off_skin[:KEPT]],
    }


def sensor_facts(sensor: Any) -> Json | None:
    """What the registry said of the sensor; None where it said nothing."""
    if sensor is None:
        return None
    names = ("vendor", "model", "serial_number", "firmware_version", "body_location", "unit", "node", "host")
    return {name: str(getattr(sensor, name)) for name in names if getattr(sensor, name, "")}


def span_entry(span: Span, window: Window) -> Json:
    """Something that held for a while."""
    return {"from": window.at(span.from_ns), "to": window.at(span.to_ns), "what": span.what}


def values_entry(values: Any) -> Json | None:
    """Of a quantity over time; None where it was never known."""
    if math.isnan(values.first):
        return None
    return {
        "first": rounded(values.first),
        "last": rounded(values.last),
        "median": rounded(values.median()),
        "min": rounded(values.least()),
        "max": rounded(values.most()),
    }


def rounded(value: float | None) -> float | None:
    """To nine decimals; not known is null, never 0."""
    return None if value is None or not math.isfinite(value) else round(float(value), 9)
