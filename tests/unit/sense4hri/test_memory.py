"""Memory of large messages, as the process of a recorder has it: in another process, as it is set for a whole one."""

import asyncio
import subprocess
import sys
from unittest.mock import MagicMock

import pytest
from sense4hri import run
from sense4hri.memory import TRIM_EVERY_S, trim

PROGRAM = """
import ctypes, sys, threading
from sense4hri.memory import give_large_blocks_back, trim

libc = ctypes.CDLL(None)
libc.malloc.restype, libc.malloc.argtypes, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_size_t], [ctypes.c_void_p]
LARGE, SMALL = 8_000_000, 100_000


def resident_bytes():
    return int(open("/proc/self/statm").read().split()[1]) * 4096


def take_in():
    small = libc.malloc(SMALL)  # of the arena of this thread
    for _ in range(3):
        block = libc.malloc(LARGE)
        ctypes.memset(block, 1, LARGE)
        libc.free(block)
    done.set()
    over.wait()
    libc.free(small)


if sys.argv[1] == "yes":
    give_large_blocks_back()
done, over = threading.Event(), threading.Event()
before = resident_bytes()
thread = threading.Thread(target=take_in)
thread.start()
done.wait()
trim()
print(resident_bytes() - before)
over.set()
thread.join()
"""


def kept_bytes(set_up: str) -> int:
    """What stays of three blocks of 8 MB that a thread had one after the other."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, set_up], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="/proc and glibc")
def test_a_large_message_leaves_nothing_behind_in_the_thread_that_took_it_in():
    """glibc would keep as much as the largest that came, in each thread."""
    assert kept_bytes("yes") < 1_000_000
    assert kept_bytes("no") > 7_000_000, "glibc gives it back by itself: then nothing of this is needed any more"


def test_every_service_gives_back_what_is_free():
    """Again and again, whoever it is: what a stranger's topics took is free only some time after they have left."""

    async def served() -> MagicMock:
        async def nothing(*_: object) -> None: ...

        service = MagicMock(stopped=asyncio.Event(), until_stopped=lambda main: main)
        await run._main(service, nothing, 1.0)
        return service

    service = asyncio.run(served())
    service.every.assert_any_call(TRIM_EVERY_S, trim)
