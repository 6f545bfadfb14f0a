"""BrainFlow's own threads sleep longer than they ask; the one that lets go of a lost Muse does not sleep at all."""

import asyncio
import ctypes
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from driver_brainflow import device
from driver_brainflow.config import BrainflowConfig, streams_of
from driver_brainflow.device import Board
from driver_brainflow.transport import SLACK_NS, Session, _Shim, description

PRESETS = ("default",)


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
        Session("SYNTHETIC", {}, (), verbose=False).open(PRESETS)
    assert seen_ns == [SLACK_NS]
    assert slack_ns() == before_ns


@pytest.mark.parametrize(
    ("board", "lost", "shortest_s", "longest_s"),
    [("MUSE_2", True, 0.0, 1.5), ("MUSE_2", False, 2.0, 60.0), ("GANGLION_NATIVE", True, 2.0, 60.0)],
)
def test_only_a_lost_muse_is_let_go_of_at_once(monkeypatch, board, lost, shortest_s, longest_s):
    """BrainFlow's release of a Muse sleeps in C, twice: woken where the board is lost; any other sleeps as it asks."""
    released_s = []

    def release_session(self):
        begun_s = time.monotonic()
        for _ in range(2):
            ctypes.CDLL(None).sleep(1)
        released_s.append(time.monotonic() - begun_s)

    monkeypatch.setattr(_Shim, "release_session", release_session)
    monkeypatch.setattr(_Shim, "prepare_session", lambda self: None)
    monkeypatch.setattr(_Shim, "get_board_sampling_rate", lambda self, preset: 250)
    monkeypatch.setattr(_Shim, "start_stream", lambda self, length: None)
    monkeypatch.setattr(_Shim, "is_prepared", lambda self: True)
    session, threads = Session(board, {}, (), verbose=False), threading.active_count()
    session.open(PRESETS)
    closing = threading.Thread(target=session.close, args=(lost,))
    closing.start()
    closing.join()
    assert shortest_s <= released_s[0] < longest_s
    assert threading.active_count() == threads


@pytest.mark.parametrize("is_stuck", [True, False])
def test_a_bluetooth_that_hangs_is_not_waited_for(monkeypatch, is_stuck):
    """BrainFlow's search that waits for itself ends the driver soon; one whose own thread runs has its time."""
    over = threading.Event()

    def prepare_session(self):
        thread = threading.Thread(target=over.wait if is_stuck else run, daemon=True)
        thread.start()
        over.wait(20 if is_stuck else 1.0)
        raise RuntimeError("searched to the end")

    def run():
        while not over.wait(0.001):
            pass

    monkeypatch.setattr(_Shim, "prepare_session", prepare_session)
    monkeypatch.setattr(device, "LOOK_S", 0.1)
    monkeypatch.setattr(device, "SLOW_S", 0.1)
    config = BrainflowConfig(sensor_id="muse_1", board="MUSE_2")

    async def connect():
        async for _ in Board(config, streams_of(config)).stream():
            pass

    try:
        with pytest.raises(RuntimeError, match="hangs in the search for MUSE_2" if is_stuck else "searched to the end"):
            asyncio.run(connect())
    finally:
        over.set()


CHILD = """
import asyncio, ctypes, sys, threading
from driver_brainflow import device
from driver_brainflow.config import BrainflowConfig, streams_of
from driver_brainflow.transport import _Shim

hangs = threading.Event()

def prepare_session(self):
    never = threading.Event()
    threading.Thread(target=never.wait, daemon=True).start()
    hangs.set()
    never.wait()

async def connect():
    config = BrainflowConfig(sensor_id="muse_1", board="MUSE_2")
    async for _ in device.Board(config, streams_of(config)).stream():
        pass

async def stop():
    connecting = asyncio.ensure_future(connect())
    await asyncio.to_thread(hangs.wait)
    connecting.cancel()
    await connecting

_Shim.prepare_session, device.LOOK_S, device.SLOW_S = prepare_session, 0.1, 0.1
libc = ctypes.CDLL(None)
libc.on_exit(libc.pause, None)
try:
    asyncio.run(globals()[sys.argv[1]]())
except asyncio.CancelledError:
    pass
"""


@pytest.mark.parametrize(("does", "status"), [("connect", 1), ("stop", 0)])
def test_the_process_ends_though_bluetooth_hangs(does, status):
    """SimpleBLE's exit handler would wait for its thread for ever: nothing waits for it, found out or told to stop."""
    done = subprocess.run([sys.executable, "-c", CHILD, does], timeout=30, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    assert ("hangs in the search" in done.stderr) is bool(status)
