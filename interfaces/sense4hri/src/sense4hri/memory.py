"""Memory back to the machine, where the C library is glibc: what strangers send must not stay once they have left."""

import ctypes
from contextlib import suppress

LARGE_BYTES = 1 << 20
M_MMAP_THRESHOLD = -3  # malloc.h
TRIM_EVERY_S = 30.0


def give_large_blocks_back() -> None:
    """Have a block of a megabyte and more given back as soon as it is free.

    glibc raises that limit to the size of the largest block freed so far, and keeps twice as much free at the end of
    each thread's arena, where `trim` does not reach it. For services that hold large messages for a moment; one that
    computes on arrays of this size would have the machine fetch and clear their memory again and again.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE_BYTES)


def trim() -> None:
    """Give back what is free by now: some milliseconds where much is, as after a stranger with many topics has left."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
