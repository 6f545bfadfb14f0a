"""What the recorders of a session's parts wrote, as if one recorder had written all of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sense4hri_recording.recorder_json import RecorderJson, count


def joined(parts: Sequence[RecorderJson]) -> RecorderJson:
    """The account of all parts, given in their order: the last one's, with what those before it saw.

    That messages were missed before a later part began is left out: nothing was recorded then.
    """
    if len(parts) == 1:
        return parts[0]
    sessions = [part.session for part in parts if part.session is not None]
    return replace(
        parts[-1],
        session=_newest(sessions) if sessions else None,
        opened_ns=next((part.opened_ns for part in parts if part.opened_ns), None),
        topics=_topics(parts),
        refused=list({str(item.get("topic")): item for part in parts for item in part.refused}.values()),
        withheld=sorted({topic for part in parts for topic in part.withheld}),
        nodes=list({str(node.get("node")): node for part in parts for node in part.nodes}.values()),
        events=[event for part in parts for event in part.events],
        trouble="; ".join(dict.fromkeys(part.trouble for part in parts if part.trouble)),
        says_session=any(part.says_session for part in parts),
    )


def _newest(sessions: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {key: value for told in sessions for key, value in told.items() if value is not None}


def _topics(parts: Sequence[RecorderJson]) -> list[dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for part in parts:
        for name, told in part.by_topic.items():
            before = found.get(name)
            found[name] = told if before is None else before | _sum(before, told)
    return list(found.values())


def _sum(before: dict[str, Any], told: dict[str, Any]) -> dict[str, Any]:
    losses = [loss for each in (before, told) for loss in each.get("losses", [])]
    return {key: count(before.get(key)) + count(told.get(key)) for key in ("messages", "lost")} | {"losses": losses}
