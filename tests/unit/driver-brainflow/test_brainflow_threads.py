"""BrainFlow's own threads cost little: they sleep longer than they ask, and nobody else does."""

import threading
from pathlib import Path

import pytest
from driver_brainflow.transport import SLACK_NS, Session, _Shim, description

RATES_HZ = {"default": 250.0}


def slack_ns() -> int:
    """The timer slack of the thread that asks."""
    return int(Path(f"/proc/{threading.get_native_id()}/timerslack_ns").read_text())


def test_threads_of_brainflow_sleep_longer_and_this_one_does_not(monkeypatch):
    """What BrainFlow begins while it connects inherits the slack; the thread that connected has its own again."""
    description("SYNTHETIC")  # loads BrainFlow's library
    before_ns, seen_ns = slack_ns(), []

    def prepare_session(self):
        thread = threading.Thread(target=lambda: seen_ns.append(slack_ns()))
        thread.start()
        thread.join()
        raise RuntimeError("no board")

    monkeypatch.setattr(_Shim, "prepare_session", prepare_session)
    with pytest.raises(RuntimeError, match="no board"):
        Session("SYNTHETIC", {}, (), verbose=False).open(RATES_HZ)
    assert seen_ns == [SLACK_NS]
    assert slack_ns() == before_ns
