"""Opens recorded sessions as tables on one corrected timeline; export and withdrawal.

import sense4hri_session
session = sense4hri_session.open("recordings/20261121T101500Z")
session["p1/ecg/h10_1"].frame()
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from sense4hri_recording.errors import SessionError

if TYPE_CHECKING:
    from sense4hri_session.session import Session, open
    from sense4hri_session.stream import Stream

_HOMES = {"Session": "session", "open": "session", "Stream": "stream"}


def __getattr__(name: str) -> Any:
    """Load pandas only when a session is opened: the report, made beside a running recorder, does without."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


__all__ = ["Session", "SessionError", "Stream", "open"]
