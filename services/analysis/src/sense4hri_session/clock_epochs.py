"""Where a device's clock begins anew: it goes back, jumps for good, or the host's own clock was set."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sense4hri.host_account import HostAccount

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]

SECOND_NS = 1_000_000_000
JUMP_S = 1.0
BEFORE_S, AFTER_S = 60.0, 900.0  # a jump that drains within the latter was a stall
STEP_S = 2e-3
STRAY_S = 5.0
HOLE = 1.5  # usual steps between two stamps, from which on one has room between them
AHEAD_S, BESIDE = 0.02, 10  # a stamp is ahead where the delay is so much less than of so many packets before and after


def epochs(which: NDArray[np.int32], device: Ints, received: Ints, host_clock: Sequence[HostAccount]) -> Ints:
    """Number of the epoch of every packet, packets of all streams being in order of receipt.

    A packet whose stamp alone is wrong has an epoch of its own, after all others: no clock runs through it.
    """
    wrong = _wrong(which, device, received)
    found = np.zeros(len(device), np.int64)
    found[~wrong] = _in_order(which[~wrong], device[~wrong], received[~wrong], host_clock)
    found[wrong] = found.max() + 1 + np.arange(np.count_nonzero(wrong))
    return found


def _wrong(which: NDArray[np.int32], device: Ints, received: Ints) -> NDArray[np.bool_]:
    """True for a packet with less delay than all beside it, whose stamp comes a step too late and the next too early.

    A stamp that is ahead of the next one makes that go back, though on from the stamps before. And for one that is far
    behind alone, between two that follow each other without it.
    """
    y = ((received - received[0]) - (device - device[0])) * 1e-9
    found = np.zeros(len(device), bool)
    for stream in range(int(which.max()) + 1):
        own = np.flatnonzero(which == stream)
        if len(own) < 3:
            continue
        steps = np.diff(device[own]) * 1e-9
        late, early, usual = steps[:-1], steps[1:], float(np.median(steps))
        returns = (late > usual + AHEAD_S) & (np.abs(late + early - 2 * usual) < AHEAD_S)
        goes_back = (early < 0) & (late + early > 0)
        found[own[1:-1]] = (late < -JUMP_S) & (np.abs(late + early - 2 * usual) < AHEAD_S)
        for i in (np.flatnonzero(returns | goes_back) + 1).tolist():
            beside = np.concatenate([own[max(0, i - BESIDE) : i], own[i + 1 : i + 1 + BESIDE]])
            found[own[i]] |= y[own[i]] < y[beside].min() - AHEAD_S
    return found


def _in_order(which: NDArray[np.int32], device: Ints, received: Ints, host_clock: Sequence[HostAccount]) -> Ints:
    y = ((received - received[0]) - (device - device[0])) * 1e-9
    at = (received - received[0]) * 1e-9
    cuts = set(_host_steps(y, received, host_clock))
    for stream in range(int(which.max()) + 1):
        own = np.flatnonzero(which == stream)
        if len(own) < 2:
            continue
        set_back, late = _back(device[own], y[own])
        cuts.update(own[set_back].tolist())
        no_step = cuts.union(own[late].tolist())
        for i, change in zip(own[1:], np.diff(y[own]), strict=True):
            if abs(change) > JUMP_S and i not in no_step and _is_step(y, at, int(i), float(change)):
                cuts.add(int(i))
    cuts.discard(0)
    found = np.zeros(len(y), np.int64)
    number, last = 0, 0
    for cut in sorted(cuts):
        base = np.min(y[max(0, last) : cut])
        base_now = float(np.min(y[cut : cut + 20]))
        if number and cut - last < 50 and abs(y[cut] - np.min(y[last:cut])) < JUMP_S:
            continue  # another stream of the device tells the same news
        number, last = number + 1, cut
        found[cut:] = number
        near = np.flatnonzero(at[cut : cut + 2000] - at[cut] < STRAY_S) + cut
        strays = near[(which[near] != which[cut]) & (np.abs(y[near] - base) < np.abs(y[near] - base_now))]
        found[strays] = number - 1
    return found


def _back(device: Ints, y: Floats) -> tuple[list[int], list[int]]:
    """Indices of a stream's packets that go back: those from which on its clock was set back, and those that are late.

    After late ones the first newer packet has the delay of the one before them again. Where none comes any more, the
    late fill a hole that they left.
    """
    set_back: list[int] = []
    late: list[int] = []
    hole_ns = HOLE * float(np.median(np.diff(device)))
    for i in (np.flatnonzero(np.diff(device) < 0) + 1).tolist():
        first = max(set_back[-1] if set_back else 0, i - BESIDE)
        newest = first + int(np.argmax(device[first:i]))
        newer = np.flatnonzero(device[i : i + BESIDE] > device[newest])
        if len(newer):
            is_late = abs(y[i + newer[0]] - y[newest]) < abs(y[i + newer[0]] - y[i])
        else:
            is_late = len(device) - i < BESIDE and _width(device[:i], int(device[i])) > hole_ns
        (late if is_late else set_back).append(i)
    return set_back, late


def _width(device: Ints, at_ns: int) -> int:
    """How far apart the stamps around a time are; 0 for a time before them all."""
    before, after = device[device <= at_ns], device[device > at_ns]
    return int(after.min() - before.max()) if len(before) else 0


def _is_step(y: Floats, at: Floats, i: int, change: float) -> bool:
    """True where the packets from i on lie on another line: no stall that drains, nor the drain of one."""
    before = y[np.searchsorted(at, at[i] - BEFORE_S) : i]
    after = y[i : np.searchsorted(at, at[i] + AFTER_S)]
    return bool(abs(after.min() - before.min()) > 0.5 * abs(change)) if len(before) else False


def _host_steps(y: Floats, received: Ints, host_clock: Sequence[HostAccount]) -> list[int]:
    """Index of the first packet after each step of the host's clock; a host that was started anew made none."""
    found = []
    for before, after in pairwise(host_clock):
        step_s = (after.realtime_minus_monotonic_ns - before.realtime_minus_monotonic_ns) * 1e-9
        if abs(step_s) < STEP_S or after.is_of_a_new_start(before):
            continue
        low, high = sorted((before.stamp_ns, after.stamp_ns))
        around = np.flatnonzero((received >= low - 2 * SECOND_NS) & (received <= high + 2 * SECOND_NS))
        earlier = np.flatnonzero((received < low) & (received >= low - 60 * SECOND_NS))
        if not len(around) or not len(earlier):
            continue
        base = float(np.min(y[earlier]))
        if step_s < 0:
            below = around[y[around] < base + step_s / 2]
            found += [int(below[0])] if len(below) else []
        else:
            below = around[y[around] < base + step_s / 2]
            found += [int(below[-1]) + 1] if len(below) and below[-1] + 1 < len(y) else []
    return found
