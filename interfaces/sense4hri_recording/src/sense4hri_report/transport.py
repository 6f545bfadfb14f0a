"""What was lost between a publisher and the file, as the recorder counted it."""

from __future__ import annotations

from sense4hri_recording.recorder_json import count

from sense4hri_report import rules
from sense4hri_report.collect import Findings
from sense4hri_report.rules import Judgement, counted
from sense4hri_report.window import Json, Window

CAUSES = ("middleware", "queue", "disk")


def transport_entry(found: Findings, topic: str, window: Window) -> Json:
    """What the recorder counted on one topic; None where it says nothing."""
    told = found.notes.by_topic.get(topic)
    if told is None:
        return {"lost": None, "missed_at_start": None, "by_cause": None, "losses": []}
    losses: list[Json] = [
        {
            "after_ns": count(item.get("after_ns")),
            "before_ns": count(item.get("before_ns")),
            "count": count(item.get("count")),
            "cause": item["cause"] if item.get("cause") in CAUSES else "not known",
        }
        for item in told.get("losses", [])
    ]
    for loss in losses:
        at_ns = loss["after_ns"] or loss["before_ns"]
        loss["in_session"] = window.share(at_ns, loss["before_ns"]) > 0
        loss["since_start_s"] = round((at_ns - window.from_ns) * 1e-9, 3)
    causes: dict[str, int] = {}
    for loss in losses:
        causes[loss["cause"]] = causes.get(loss["cause"], 0) + loss["count"]
    lost = max(count(told.get("lost")), sum(causes.values()))
    return {"lost": lost, "missed_at_start": count(told.get("missed_at_start")), "by_cause": causes, "losses": losses}


def judge_transport(entry: Json, window: Window, first_ns: int | None, judgement: Judgement) -> None:
    """first_ns: when the first of its messages came; None where none did."""
    if entry["lost"]:
        outside = sum(loss["count"] for loss in entry["losses"] if not loss["in_session"])
        inside = entry["lost"] - outside
        causes = ", ".join(f"{number} by the {cause}" for cause, number in sorted(entry["by_cause"].items()))
        sentence = f"{counted(inside or outside, 'message')} sent and not recorded" + (f" ({causes})" if causes else "")
        if inside:
            judgement.gaps(sentence)
        else:
            judgement.remark(f"{sentence}, outside of the session")
    if entry["missed_at_start"]:
        missed = f"{counted(entry['missed_at_start'], 'message')} sent before"
        edge_ns = window.from_ns if window.begins else window.from_ns + round(rules.EDGE_S * 1e9)
        if window.continues or (first_ns is not None and first_ns <= edge_ns):
            judgement.remark(f"{missed} {'the session' if window.begins else 'this recording'} began")
        else:
            judgement.gaps(f"{missed} the recorder listened")
