"""Takes messages as bytes with all that the middleware says of each, by rcl's own function.

rclpy leaves out who published a message, without which its number says nothing where a topic has several publishers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from struct import Struct
from typing import NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation as rcl

OK, NOTHING = 0, 401
NO_NUMBER = 2**64 - 1
_INFO = Struct("@qqQQP16s?7x")  # rmw_message_info_t; Struct and not Structure: a third of the time
_RCL = ctypes.PyDLL("librcl.so")  # keeps the interpreter's lock, as rclpy does: giving it away costs up to 5 ms each
_RCUTILS = ctypes.PyDLL("librcutils.so")


class _Allocator(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("allocate", "free", "reallocate", "zeroed", "state")]


class _Bytes(ctypes.Structure):
    """rcutils_uint8_array_t."""

    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


_RCUTILS.rcutils_get_default_allocator.restype = _Allocator
_TAKE = _RCL.rcl_take_serialized_message
_TAKE.argtypes = [ctypes.c_void_p] * 4
_END = _RCUTILS.rcutils_uint8_array_fini
_END.argtypes = [ctypes.c_void_p]


class Taken(NamedTuple):
    """One message. sent_ns, received_ns: ROS time, 0 where not known. number: its publisher's, from 1; 0: has none."""

    cdr: bytes
    sent_ns: int
    received_ns: int
    number: int
    publisher: bytes


Take = Callable[[int], Taken | None]


class _Taker:
    """Takes into the same memory again and again."""

    def __init__(self) -> None:
        self._memory = _Bytes(allocator=_RCUTILS.rcutils_get_default_allocator())
        self._info = ctypes.create_string_buffer(_INFO.size)
        self._at = ctypes.addressof(self._memory), ctypes.addressof(self._info), None

    def __call__(self, pointer: int) -> Taken | None:
        """Return the next message of the rcl subscription there; None where none is left."""
        done = _TAKE(pointer, *self._at)
        if done == NOTHING:
            return None
        if done != OK:
            _RCUTILS.rcutils_reset_error()
            raise rcl.RCLError(f"no message can be taken: rcl says {done}")
        sent_ns, received_ns, number, _, _, publisher, _ = _INFO.unpack_from(self._info)
        cdr = ctypes.string_at(self._memory.buffer, self._memory.length)
        return Taken(cdr, sent_ns, received_ns, 0 if number == NO_NUMBER else number, publisher)

    def close(self) -> None:
        """Give back what the largest message needed."""
        _END(self._at[0])


@contextmanager
def taker() -> Iterator[Take]:
    """A function that takes messages; its memory is given back at the end."""
    made = _Taker()
    try:
        yield made
    finally:
        made.close()
