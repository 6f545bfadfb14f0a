"""What more participants than were tried would take, on paper: the steepest stretch that was measured goes on."""

import math
from collections.abc import Sequence

import numpy as np

FULL_PERCENT = 100.0


def most_participants(participants: Sequence[int], percent: Sequence[float]) -> float:
    """Return with how many participants one process fills a core, which it cannot exceed; inf where none is too many.

    participants, percent of one core: shape (n,), n >= 2, as measured.
    """
    steepest = _steepest(participants, percent)
    return participants[-1] + (FULL_PERCENT - percent[-1]) / steepest if steepest > 0 else math.inf


def percent_with(participants: Sequence[int], percent: Sequence[float], wanted: int) -> float:
    """Return the CPU of one process with so many participants, more than were tried, in % of one core."""
    return percent[-1] + (wanted - participants[-1]) * _steepest(participants, percent)


def drivers_percent(participants: Sequence[int], percent: Sequence[float], wanted: int) -> float:
    """Return the CPU of the drivers of so many participants, in % of one core.

    Each costs itself, and a share for every other whose endpoints it holds: percent = a p + b p^2, by least squares,
    neither a nor b below 0.
    """
    number = np.asarray(participants, float)
    terms = np.column_stack([number, number**2])
    (each, pairs), *_ = np.linalg.lstsq(terms, np.asarray(percent, float), rcond=None)
    if each < 0 or pairs < 0:
        power = 1 if pairs < 0 else 2
        return float(wanted**power * (number**power @ percent) / (number ** (2 * power)).sum())
    return float(each * wanted + pairs * wanted**2)


def _steepest(participants: Sequence[int], percent: Sequence[float]) -> float:
    """The steepest stretch that was measured, in % of one core per participant; 0 where none rises."""
    return max(0.0, float((np.diff(percent) / np.diff(participants)).max()))
