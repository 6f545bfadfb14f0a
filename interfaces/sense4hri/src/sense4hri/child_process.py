"""Processes that end with the one that started them, where the kernel is Linux."""

import ctypes
import signal

SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)


def end_with_parent() -> None:
    """As `preexec_fn`: be ended when the parent is killed, so that no orphan holds a sensor, a socket or a port."""
    ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
