"""What is done beside recording: in order, patiently, and never longer than there is time for."""

import asyncio
import os
import time
from pathlib import Path

import pytest
from processes import DEADLINE_S
from recorder import chores as chores_module
from recorder.chores import Chore, Chores

OK, FAILS = Chore("calendar", Path("2000")), Chore("json.tool", Path("nowhere.json"))
LONG = Chore("timeit", Path("__import__('time').sleep(60)"))


def runs(chore: Chore) -> bool:
    """Whether a child of this process does it now."""
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return any(str(chore.directory) in Path(f"/proc/{pid}/cmdline").read_text() for pid in children)


def done_with(*chores: Chore, session: bool = False, within_s: float = DEADLINE_S) -> tuple[list, list[Chore], float]:
    """What was said of each, what was left undone, and how long it took from the end."""

    async def work() -> tuple[list, list[Chore], float]:
        said: list = []
        todo = Chores(lambda chore, status, lines: said.append((chore, status, lines)))
        todo.session_runs(session)
        task = asyncio.create_task(todo.run())
        todo.add(*chores)
        async with asyncio.timeout(DEADLINE_S):
            while LONG in chores and not runs(LONG):
                await asyncio.sleep(0.02)
            while session and not said:
                await asyncio.sleep(0.02)
        begun = time.monotonic()
        left = await todo.finish(within_s)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return said, left, time.monotonic() - begun

    return asyncio.run(work())


def test_each_is_done_in_its_order_and_its_failure_told():
    """The one that fails says so with its status and its own words, and the next is done all the same."""
    said, left, _ = done_with(FAILS, OK)
    assert [(chore, status == 0) for chore, status, _ in said] == [(FAILS, False), (OK, True)]
    assert any("nowhere.json" in line for line in said[0][2])
    assert left == []


def test_at_the_end_a_long_one_is_ended_and_named():
    """What does not end in time is killed, and it and those behind it are told, with the command for each."""
    said, left, took_s = done_with(LONG, OK, within_s=0.5)
    assert (said, left) == ([], [LONG, OK])
    assert took_s < 30  # half of what it would take
    assert not runs(LONG)
    assert left[0].command == f"python -m timeit {LONG.directory}"


def test_the_patient_wait_while_a_session_is_recorded():
    """A report is not begun during a session, a repair is; once there is no session it is made."""
    patient = Chore("calendar", Path("2001"), patient=True)
    said, left, _ = done_with(patient, OK, session=True)
    assert ([chore for chore, _, _ in said], left) == ([OK, patient], [])


@pytest.mark.parametrize("times", [2, 5])
def test_the_same_is_done_once(times):
    """Asked for again before it was begun, it is still one."""
    said, _, _ = done_with(*[OK] * times)
    assert len(said) == 1


@pytest.mark.parametrize("refusals", [1, 3])
def test_a_machine_without_room_for_a_process_is_asked_again(monkeypatch, refusals):
    """A fork that fails is tried again; where it fails for good that is told with the command, and the next is done."""
    monkeypatch.setattr(chores_module, "FORK_PAUSE_S", 0.01)
    real, left = asyncio.create_subprocess_exec, [OSError(11, "Resource temporarily unavailable")] * refusals

    async def begin(*words, **how):
        if left:
            raise left.pop()
        return await real(*words, **how)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", begin)
    first = Chore("calendar", Path("2001"))
    said, undone, _ = done_with(first, OK)
    assert [(chore, status == 0) for chore, status, _ in said] == [(first, refusals < 3), (OK, True)]
    assert undone == []
    if refusals == 3:
        assert "Resource temporarily unavailable" in said[0][2][0]
        assert first.command in said[0][2][0]
