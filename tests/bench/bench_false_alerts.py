"""Alerts that fire although nothing is wrong: the study of bench_alerts.py, left alone for CLEAN_S (half an hour)."""

import os
from typing import Any

from bench_alerts import watched_study

CLEAN_S = float(os.environ.get("CLEAN_S", "1800"))
TARGET_S = 1800.0


def rows() -> list[dict[str, Any]]:
    """Return the measured row, none where Prometheus is not to be had."""
    with watched_study() as study:
        return [_row(study.fired_within(CLEAN_S))] if study else []


def _row(seen: set[tuple[str, str]]) -> dict[str, Any]:
    said = ", ".join(f"{name} of {whom}" for name, whom in sorted(seen)) or "none"
    what = f"false alerts in a clean {CLEAN_S / 60:.2g} min"
    return {
        "what": what,
        "target": "0 in 30 min",
        "measured": f"{len(seen)}: {said}",
        "ok": not seen if CLEAN_S >= TARGET_S else None,
    }
