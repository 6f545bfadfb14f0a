"""What may come with every frame is a line at times."""

import logging
import time

import pytest
from sense4hri.log import Log


def test_of_each_thing_there_is_a_line_at_times(monkeypatch: pytest.MonkeyPatch, caplog) -> None:
    """Once in so long of each, however often it comes; and nothing is kept of what came long ago."""
    log, now_s = Log(logging.getLogger("test")), [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    for now_s[0] in (100.0, 105.0, 109.9, 110.0, 119.0):
        for device in ("h10", "h11"):
            log.warning_at_times(f"{device} at {now_s[0]:g}", 10.0, about=device)
    assert caplog.messages == ["h10 at 100", "h11 at 100", "h10 at 110", "h11 at 110"]
    now_s[0] = 200.0
    log.warning_at_times("h12 at 200", 10.0, about="h12")
    assert list(log._quiet_until_s) == ["h12"]
