"""Opens recorded sessions as tables on one corrected timeline.

import sense4hri_session
session = sense4hri_session.open("recordings/20261121T101500Z")
session["p1/ecg/h10_1"].frame()
"""

from sense4hri_session.errors import SessionError
from sense4hri_session.session import Session, open
from sense4hri_session.stream import Stream

__all__ = ["Session", "SessionError", "Stream", "open"]
