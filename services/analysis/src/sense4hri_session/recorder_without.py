"""recorder.json without a pseudonym."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sense4hri_recording.recorder_json import RecorderJson

from sense4hri_session.traces import Traces


def without(about: RecorderJson, traces: Traces) -> RecorderJson:
    """What the recorder knew, less whatever mentions the pseudonym of these traces; equal where nothing does."""
    nodes = [item for item in about.nodes if (item.get("parameters") or {}).get("human_id") != traces.human_id]
    return replace(
        about,
        why="" if traces.mentions(about.why) else about.why,
        host="" if traces.mentions(about.host) else about.host,
        software={name: text for name, text in about.software.items() if not traces.mentions(text)},
        topics=[item for item in about.topics if not traces.is_in(item)],
        refused=[item for item in about.refused if not traces.is_in(item)],
        withheld=[item for item in about.withheld if not traces.is_in(item)],
        events=[item for item in about.events if not traces.is_in(item)],
        nodes=[traces.value_without(item) if traces.is_in(item) else item for item in nodes],
        session=_session(about.session, traces),
        more={name: value for name, value in about.more.items() if not traces.is_in(value)},
    )


def _session(session: dict[str, Any] | None, traces: Traces) -> dict[str, Any] | None:
    if not session:
        return session
    names = {key: session[key] for key in ("session_id", "study", "task") if isinstance(session.get(key), str)}
    kept: dict[str, Any] = traces.typed.value_without(session)
    return kept | {key: traces.name_without(name) for key, name in names.items()}
